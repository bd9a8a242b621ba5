"""Krylov iterations, and what is known of their error.

In the order in which data passes:

- `error_estimates`: When to stop: from the coefficients of conjugate gradients to an error in
  displacement.
- `cg`: Preconditioned conjugate gradients: the loop, its NumPy twin and its driver.
- `multigrid_preconditioner`: Its preconditioner: a multigrid V-cycle over a hierarchy of levels.
- `outer_iteration`: The outer loop: runs of conjugate gradients inside a float64 refinement, load
  case by load case.
- `truncated_cg`: Conjugate gradients as far as an iteration around them wants them, of Newton's
  method or for eigenvalues.
- `gmres`: Generalised minimum residuals, for matrices that are indefinite or not symmetric.
"""
