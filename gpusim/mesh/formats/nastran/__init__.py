"""Nastran: bulk data.

In the order in which data passes:

- `cards`: Nastran's bulk data as a list of cards: a name and its fields, continuations joined.
- `card_names`: Which cards of Nastran's bulk data make a mesh, which can't change it, and which
  are refused.
- `values`: Numbers in Nastran's fields.
- `coordinate_systems`: Nastran's coordinate systems, and nodes that are given in them.
- `reader`: Nastran's bulk data (.bdf, .nas, .fem, .dat): nodes and solid and shell elements.
"""
