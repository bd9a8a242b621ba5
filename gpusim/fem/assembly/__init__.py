"""Assembly: from elements to a matrix of 3x3 blocks, and its products.

In the order in which data passes:

- `element_batches`: Elements with their matrices, before assembly: equal ones share a matrix.
- `scipy_kernels`: SciPy's own kernels for sparse matrices, which its classes don't let one call
  without copies.
- `node_numbering`: Node numbers in which neighbours lie close together in memory.
- `node_graph`: Pairs of nodes that share an element: the pattern of a matrix, and where its
  blocks add up.
- `block_rows`: The assembled stiffness as a table of distinct block rows.
- `diagonal_blocks`: Small diagonal blocks and their inverses, with fixed or empty unknowns left
  out.
- `matrix_product`: Host matrix-vector products on all processors: rows are shared out, so the
  sums don't change.
- `assembly`: Assembly: from element matrices to block rows, many elements at a time.
- `element_deformation`: K u by what deforms each element: its displacements without a rigid
  motion.
- `stiffness_rounding`: What the rounding of the stiffness itself does to the displacements, and
  what it comes from.
- `definiteness`: The errors for stiffnesses that float64 can't hold: indefinite ones, and numbers
  beyond it.
- `system`: The scaled system of a model, whatever solves it.
"""
