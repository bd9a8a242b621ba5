"""Direct solvers of long bodies, and refinement around them.

In the order in which data passes:

- `banded_cholesky`: A direct solver for long bodies: banded Cholesky factors in float64, on the
  host.
- `substructuring`: A direct solver for long lattices: congruent sections are condensed once.
- `iterative_refinement`: Iterative refinement around a direct solver, and the error that it shows.
"""
