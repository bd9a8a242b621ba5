"""Builders: meshes made by number, and meshes made from other meshes.

In the order in which data passes:

- `grading`: Node coordinates along one axis: exact at every break, fine where asked, growing in
  between.
- `grids`: Mesh builders on rectangular grids: a box, a beam, a tower crane.
- `blocks`: Structured blocks in a plane, joined at their common borders and extruded to
  hexahedra.
- `plates`: Builders of structured hexahedral plates with round holes: a flat plate, and a bent
  bracket.
- `notches`: Notches: slots of given position, width and depth, cut from a mesh along its cell
  borders.
- `midside_nodes`: From a linear mesh to a quadratic one: shared midside nodes on straight edges.
- `cell_splitting`: Linear cells split into tetrahedra or wedges, conforming between neighbours,
  sets kept.
"""
