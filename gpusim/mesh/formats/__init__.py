"""Formats: mesh files of other programs.

In the order in which data passes:

- `text`: The lines of a text file from anywhere: line ends of every system, comments in Latin-1.
- `file_numbers`: Messages about a mesh, in the numbers of the file that it comes from.
- `coordinate_systems`: Coordinate systems in which files give nodes: rectangular, cylindrical,
  spherical.
- `handedness`: Cells turned right-handed where a file format leaves the sense of their corners
  open.
- `cell_blocks`: What mesh files hold before it is a `Mesh`: blocks of any dimension, with named
  groups.
- `meshio_types`: meshio, with the two cell types that its version 5.3 knows but has no dimension
  for.
- `med`: MED files (Salome, Code_Aster): one mesh of one computing step, with its groups.
- `reader`: Reading mesh files, by the ending of their name.
- `abaqus`: Meshes in input files.
- `nastran`: Bulk data.
- `gmsh`: Its files, and CAD files that it meshes.
- `vtk`: Unstructured grids.
- `exodus`: Exodus II.
- `surfaces`: Files of faces without solids.
"""
