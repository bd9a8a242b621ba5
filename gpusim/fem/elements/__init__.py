"""Elements: formulations and their rules (shapes are in `gpusim.mesh`), stiffness, strain.

In the order in which data passes:

- `element`: Solid elements and their faces as pure data: which rule a formulation integrates with,
  and the shape functions of `gpusim.mesh.shape_functions` at its points.
- `isoparametric_map`: Geometry of many cells at quadrature points, written out by components.
- `element_matrix`: Element stiffness matrices in float64, many elements at a time.
- `straight_tetrahedra`: Stiffness of straight-sided quadratic tetrahedra in closed form.
- `strain`: Strain and stress of many cells at the quadrature points of their formulation, and back.
"""
