"""Nearly incompressible bodies: displacements and pressures.

In the order in which data passes:

- `volume_split`: K = A + B^T C^-1 B: nearly incompressible mean-dilatation bricks with a pressure
  per cell.
- `pressure_preconditioners`: Preconditioners for the pressures of trilinear bricks, on lattices and
  on any mesh.
- `mixed_formulation`: Conjugate gradients on displacements and pressures together (Bramble &
  Pasciak).
"""
