"""Direct solvers, and the choice between them and multigrid.

In the order in which data passes:

- `banded_cholesky`: A direct solver for long bodies: banded Cholesky factors in float64, on the
  host.
- `substructuring`: A direct solver for long lattices: congruent sections are condensed once.
- `iterative_refinement`: Iterative refinement around a direct solver, and the error that it
  shows.
- `solver_choice`: Which solver a problem gets: the cheapest one by an estimate made before
  anything is factorised.
"""
