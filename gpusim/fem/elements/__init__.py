"""Elements: formulations and their rules (shapes are in `gpusim.mesh`), stiffness, strain;
large motion and finite strain.

In the order in which data passes:

- `element`: Solid elements and their faces as pure data: which rule a formulation integrates with,
  and the shape functions of `gpusim.mesh.shape_functions` at its points.
- `isoparametric_map`: Geometry of many cells at quadrature points, written out by components.
- `element_matrix`: Element stiffness matrices in float64, many elements at a time.
- `straight_tetrahedra`: Stiffness of straight-sided quadratic tetrahedra in closed form.
- `strain`: Strain and stress of many cells at the quadrature points of their formulation, and back.
- `finite_strain`: Finite strain at points of elements, written out by components.
- `element_response`: How elements answer to a motion: internal forces, tangents, and what they
  remember of it.
- `polar_rotation`: The rotation of many deformation gradients.
- `corotational`: The linear element turned with its cell.
- `heated_material`: Heat at finite strain: the law of a body that has expanded.
- `total_lagrangian`: Elements at finite strain, in the reference configuration.
- `enhanced_modes`: The incompatible hexahedron at finite strain.
- `mean_dilatation`: Mean dilatation at finite strain, from an energy.
"""
