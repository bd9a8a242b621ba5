"""Krylov iterations, and what is known of their error.

In the order in which data passes:

- `rounding_error`: What the rounding of the stiffness leaves open in displacements: the part of
  an error estimate that no residual shows (see `gpusim.fem.assembly.stiffness_rounding`).
- `stopping_criterion`: When to stop: from the coefficients of conjugate gradients to an error in
  displacement.
- `soft_modes`: Soft modes that the loads hardly feel, found by conjugate gradients from a rough
  right-hand side.
- `error_estimates`: What is known of the error of an iteration: least eigenvalues, and bounds
  that rest on them.
- `cg`: Preconditioned conjugate gradients: the loop, its NumPy twin and its driver.
- `outer_iteration`: The outer loop: runs of conjugate gradients inside a float64 refinement.
- `load_cases`: Load cases iterated each by itself, beside one another where that gains.
"""
