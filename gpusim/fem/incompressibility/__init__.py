"""Nearly incompressible bodies: displacements and pressures.

In the order in which data passes:

- `volume_split`: K = A + B^T C^-1 B: nearly incompressible mean-dilatation bricks with a pressure
  per cell.
- `checkerboards`: A preconditioner for the pressures of trilinear bricks: mass, and checkerboards
  of all sizes.
- `pressure_chebyshev`: A preconditioner for the pressures of trilinear bricks on any mesh: a
  sparse matrix's Chebyshev.
- `saddle_point`: Conjugate gradients on displacements and pressures together (Bramble & Pasciak).
- `mixed_formulation`: Nearly incompressible bricks: multigrid of an ordinary body, and pressures
  beside it.
"""
