"""The model: material, supports, loads, and the solution.

In the order in which data passes:

- `material`: Materials: linear elasticity with thermal expansion.
- `constraints`: Linear equations between displacements, as objects of a model: ties, and any
  others.
- `model`: The model: mesh, materials, supports, nodal loads and formulations; its solution.
- `elimination`: Linear equations resolved: displacements given up and those they follow, u = T v +
  g.
- `supports`: Supports: planes of symmetry, and which rigid-body motions supports leave free.
- `loads`: Consistent nodal forces: each function returns (N,3) float64, to be added up freely.
- `thermal_loads`: Forces of a temperature change, from the stress that it causes in cells held
  still.
- `mass`: Mass matrices: consistent, and lumped on the diagonal.
"""
