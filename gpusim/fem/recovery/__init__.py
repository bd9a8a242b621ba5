"""Recovery: what follows from displacements.

In the order in which data passes:

- `stress`: Stress recovery: at quadrature points, averaged at nodes, and how far the two
  disagree.
- `cauchy_stress`: Stress recovery at large displacements: Cauchy stress and logarithmic strain of
  elements.
- `linear_theory`: How far linear theory is off where a body turns.
"""
