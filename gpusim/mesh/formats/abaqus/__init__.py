"""Abaqus and CalculiX: meshes in input files.

In the order in which data passes:

- `lines`: Lines of Abaqus and CalculiX input files, with the text of included files in place.
- `cards`: Abaqus and CalculiX input files as a list of cards: a keyword line and its data lines.
- `keywords`: Which keywords of an input file make its mesh, which can't change it, and which are
  refused.
- `element_types`: Element types of Abaqus and CalculiX: nodes and faces. Pure data.
- `values`: Names and numbers in input files.
- `assembly`: Parts and their instances in Abaqus files: which card belongs where, and where it is
  placed.
- `nodes`: Nodes of an Abaqus or CalculiX file: given, in systems of their own, and generated.
- `elements`: Elements of an Abaqus or CalculiX file: given and generated.
- `content`: What an Abaqus or CalculiX file says about its mesh, by the file's own numbers.
- `sets`: Sets and surfaces of an Abaqus or CalculiX file, from their cards.
- `geometry`: Nodes, elements and sets of an Abaqus or CalculiX file, from its cards.
- `reader`: Meshes from Abaqus and CalculiX input files.
"""
