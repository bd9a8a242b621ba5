"""VTK: unstructured grids.

In the order in which data passes:

- `cell_types`: VTK's cell types, and its lists of cells as blocks of one kind.
- `vtk`: Legacy VTK files (.vtk): unstructured grids, versions 1 to 5, as text or binary.
- `vtu_arrays`: The numbers of VTK's XML files: as text, base64 or raw, inline or appended,
  compressed or not.
- `vtu`: VTK's unstructured grids in XML (.vtu): all pieces, one after another, as VTK appends
  them.
"""
