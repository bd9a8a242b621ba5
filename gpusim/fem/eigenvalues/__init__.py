"""Eigenvalue analyses: natural frequencies and mode shapes, and loads at which bodies buckle.

In the order in which data passes:

- `rigid_body_modes`: Rigid-body modes: motions that cost no energy, known exactly before any other
  mode.
- `davidson`: Block Davidson iteration: the greatest mu of B x = mu A x, A positive definite.
- `rayleigh_quotients`: Rayleigh-Ritz: the eigenvalues in a span of vectors, as sharp as float64 has
  the stiffness.
- `modes`: Modal analysis: natural frequencies and mode shapes, K u = omega^2 M u.
- `buckling`: Linear buckling: factors of the load at which stiffness is lost, (K + factor K_g) u =
  0.
"""
