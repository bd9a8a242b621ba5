"""The model: material, supports, loads, and the solution.

In the order in which data passes:

- `material`: Materials: linear elasticity with thermal expansion.
- `model`: The model: mesh, materials, supports and nodal loads.
- `formulation`: Which formulation each cell type takes.
- `symmetry`: Symmetry supports: faces on a plane of symmetry don't move along their normal.
- `rigid_body_modes`: Which rigid-body motions do the supports leave free? Asked before anything
  is solved.
- `loads`: Consistent nodal forces: each function returns (N,3) float64, to be added up freely.
- `line_loads`: Forces along lines of cell edges.
- `thermal_loads`: Forces of a temperature change, from the stress that it causes in cells held
  still.
- `mass`: Mass matrices: consistent, and lumped on the diagonal.
- `solution`: What a static solve returns.
"""
