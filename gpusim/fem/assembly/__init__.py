"""Assembly: from elements to a matrix of 3x3 blocks, and its products.

In the order in which data passes:

- `element_batches`: Elements with their matrices, before assembly: equal ones share a matrix.
- `block_rows`: The assembled stiffness as a table of distinct block rows, and its diagonal blocks.
- `matrix_product`: Host matrix-vector products on all processors: rows are shared out, so the sums
  don't change.
- `node_graph`: Pairs of nodes that share an element, and numbers in which they lie close together
  in memory.
- `assembly`: Assembly: from element matrices to block rows, many elements at a time.
- `stiffness_rounding`: What the rounding of the stiffness itself does to the displacements, and
  products without it.
- `system`: The scaled system of a model, whatever solves it.
"""
