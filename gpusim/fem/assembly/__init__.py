"""Assembly: from elements to a matrix of 3x3 blocks, and the system that it makes.

In the order in which data passes:

- `element_batches`: Elements with their matrices, before assembly: equal ones share a matrix.
- `node_graph`: Pairs of nodes that share an element, and numbers in which they lie close together
  in memory.
- `assembly`: Assembly: from element matrices to block rows, many elements at a time.
- `stiffness_rounding`: What the rounding of the stiffness itself does to the displacements, and
  products without it.
- `system`: The scaled system of a model, whatever solves it.
- `reduced_system`: The system of a model with constraints, by congruence: with u = T v (see
  ``Elimination``)
- `element_responses`: The elements of a model at large displacements, by law, cell type and
  formulation.
- `equation`: The equation of equilibrium at large displacements: residual forces and their tangent.
- `shifted_system`: The system of K + s M: stiffness and a share of the mass.
- `equation_of_motion`: The linear equation of motion, M a + K u = f: products with mass and
  stiffness.
- `geometric_stiffness`: Geometric stiffness: what stress adds to the stiffness of a body, by
  turning with it.
"""
