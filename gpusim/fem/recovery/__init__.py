"""Recovery: what follows from displacements.

In the order in which data passes:

- `stress`: Stress recovery: at quadrature points, averaged at nodes, and how far the two
  disagree.
"""
