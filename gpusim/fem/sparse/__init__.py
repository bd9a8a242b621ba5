"""Sparse matrices of 3x3 blocks, and their products on the host.

In the order in which data passes:

- `block_rows`: The assembled stiffness as a table of distinct block rows, and its diagonal blocks.
- `matrix_product`: Host matrix-vector products on all processors: rows are shared out, so the sums
  don't change.
- `stiffness_product`: The stiffness operator y = K u by differences of displacements.
"""
