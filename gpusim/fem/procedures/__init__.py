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
- `rigid_body_modes`: Rigid-body modes: motions that cost no energy, known exactly before any other
  mode.
- `davidson`: Block Davidson iteration: the greatest mu of B x = mu A x, A positive definite.
- `rayleigh_quotients`: Rayleigh-Ritz: the eigenvalues in a span of vectors, as sharp as float64 has
  the stiffness.
- `modes`: Modal analysis: natural frequencies and mode shapes, K u = omega^2 M u.
- `buckling`: Linear buckling: factors of the load at which stiffness is lost, (K + factor K_g) u =
  0.
- `modal_basis`: Modal bases: modes, and what static responses have beyond them.
- `forced_vibration`: Forced vibration: a model as it is discretised, and the one load that drives
  it.
- `harmonic`: Harmonic response: steady vibration under loads, or on a base, that vary as
  exp(i omega t).
- `frequency_response`: Frequency-response functions: what one point does per unit of force at
  another.
- `random_response`: Random response: stationary vibration under a load, or on a base, known by its
  spectral density.
- `initial_value_problem`: Initial value problems of a body: what moves, from where, and what acts
  on it when.
- `modal_superposition`: Modal superposition: each mode by itself, exactly where loads are linear in
  between instants.
- `time_integration`: Time integration: Newmark's method, HHT-alpha and generalized-alpha, step by
  step.
- `nonlinear_motion`: Motion at large displacements: equilibrium with the forces of inertia, by
  Newton's method.
- `transient`: Transients: a body's response in time, by modes or step by step.
"""
