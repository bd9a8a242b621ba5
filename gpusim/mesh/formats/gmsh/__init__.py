"""Gmsh: its files, and CAD files that it meshes.

In the order in which data passes:

- `element_types`: Gmsh's element types and node orders. Pure data, for its files and for its
  Python interface.
- `msh_numbers`: The bytes of a .msh file: lines, sections' numbers as text or binary, and what is
  wrong.
- `msh`: Gmsh's .msh files, versions 2.2 and 4.1, as text or binary.
- `element_sizes`: Element sizes for Gmsh: a greatest size, curvature, named places and boxes.
- `cad`: CAD files (STEP, BREP, STL) meshed by Gmsh, which is an optional dependency.
"""
