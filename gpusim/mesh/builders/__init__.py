"""Builders: meshes made by number, and meshes made from other meshes.

In the order in which data passes:

- `notches`: Notches: slots of given position, width and depth, and grids that are fine there.
- `grids`: Mesh builders on rectangular grids: a box, a beam, a tower crane.
- `plates`: Builders of structured hexahedral plates with round holes.
- `conversion`: Meshes of other cell types from a mesh: midside nodes added, linear cells split.
"""
