"""Formats: mesh files of other programs.

In the order in which data passes:

- `abaqus`: Meshes in input files of Abaqus and CalculiX.
- `nastran_cards`, `nastran`: Nastran's bulk data: its cards, and the mesh that they make.
- `vtk`, `vtu`: VTK's unstructured grids: legacy files, XML.
- `exodus`: Exodus II files: meshes, and the nodal results that a solver wrote over time.
- `med`: MED files (Salome, Code_Aster): one mesh of one computing step, with its groups.
- `msh_numbers`, `msh`: Gmsh's .msh files: their bytes, and the mesh that they hold.
- `element_sizes`, `cad`: CAD files meshed by Gmsh, which is an optional dependency.
- `cad_cache`: Meshes of CAD files, kept in the user's cache folder.
- `reader`: Reading mesh files, by the ending of their name.
- `gltf`: glTF files: their triangles and base colours.
- `obj`: Wavefront's OBJ: faces, their texture coordinates and the names of their materials.
- `surfaces`: Faces without solids in STL, PLY, OBJ, OFF and glTF files.
- `textures`: What OBJ and glTF files say of how their faces look.
"""
