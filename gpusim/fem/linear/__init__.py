"""Linear solvers: prepared for a matrix, solved with, and updated where its values change.

In the order in which data passes:

- `solve_plan`: Every choice of a solve, made once before work, each with its reason.
- `methods`: A system solved as a plan says.
"""
