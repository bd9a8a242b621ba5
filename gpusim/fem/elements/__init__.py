"""Elements: shape functions at integration points, stiffness, strain.

In the order in which data passes:

- `element`: Solid elements and their faces as pure data: shape functions at the points of
  integration rules.
- `isoparametric_map`: Geometry of many cells at quadrature points, written out by components.
- `element_matrix`: Element stiffness matrices in float64, many elements at a time.
- `straight_tetrahedra`: Stiffness of straight-sided quadratic tetrahedra in closed form.
- `strain`: Strain and stress of many cells at the quadrature points of their formulation, and back.
"""
