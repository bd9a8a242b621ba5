"""Procedures: what is solved step by step with an equation and a linear solver.

In the order in which data passes:

- `linear_static`: Linear statics: K u = f to a stated displacement error.
- `line_search`: How far to go along a step of Newton's method, by the work that is left to gain.
- `newton`: Newton's method for one load step.
- `arc_length`: Arc length: the path of equilibria past limit points, where load factors turn back.
- `load_steps`: Load steps: one equilibrium after another, with smaller steps where Newton's method
  fails, and by arc length past limit points.
- `load_path_checks`: Checks of a load path that has been followed: what is doubtful about its
  equilibria, the strains of its last one, its cells and its materials.
- `nonlinear_static`: Nonlinear statics: equilibrium at large displacements, load step by load step.
- `statics`: Statics: displacements of a model, by linear theory or at large displacements.
- `expansion`: What large displacements add to linear ones, to third order in the load.
"""
