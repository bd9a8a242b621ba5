"""Abaqus and CalculiX: meshes in input files.

In the order in which data passes:

- `cards`: Input files as a list of cards: a keyword line and its data lines.
- `keywords`: Which keywords make the mesh, which can't change it, and which are refused.
- `nodes`: Nodes: given, in systems of their own, and generated.
- `elements`: Elements: their types, given and generated.
- `content`: What a file says about its mesh, sets and surfaces, by its own numbers.
- `assembly`: Parts and their instances: which card belongs where, and where it is placed.
- `reader`: Meshes from input files.
"""
