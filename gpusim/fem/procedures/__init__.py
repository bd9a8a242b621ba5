"""Procedures: what is solved step by step with an equation and a linear solver.

In the order in which data passes:

- `linear_static`: Linear statics: K u = f to a stated displacement error.
"""
