"""Lattices: rectilinear bricks, whose rows repeat.

In the order in which data passes:

- `lattice`: Rectilinear hex8 meshes: nodes on a lattice make neighbours, repeats and coarsening
  cheap.
- `lattice_runs`: Vectors on a lattice as runs of nodes, and products with the rows of blocks that
  repeat there.
- `stencil`: Host products on a lattice whose rows repeat: small dense matrices in place of a sparse
  one.
"""
