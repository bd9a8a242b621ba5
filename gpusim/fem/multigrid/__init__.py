"""Multigrid: levels, transfer, smoothers, the coarsest level.

In the order in which data passes:

- `geometric_coarsening`: Coarser levels by geometry: midside nodes dropped, lattice planes left
  out.
- `mapped_coarsening`: Bricks that are numbered along three axes as on a lattice, wherever their
  nodes lie.
- `column_blocks`: Columns of nodes across flat cells, as blocks that are smoothed and aggregated as
  a whole.
- `smoothers`: Block-Jacobi and Chebyshev smoothing, host side; ``relaxation`` has the device's.
- `smoothed_aggregation`: Smoothed aggregation, host side: aggregates, prolongators and coarse
  matrices.
- `transfer`: Interpolation between levels, host side: by planes of lattices, by nodes, by
  aggregates.
- `coarse_solver`: The coarsest level of multigrid, solved exactly: a band where the body is long,
  or an inverse.
- `hierarchy`: The levels of multigrid: geometry first, then smoothed aggregation.
"""
