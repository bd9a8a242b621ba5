"""The solver on a device: texels, operators, smoothing, the V-cycle.

It knows no elements but the quadratic tetrahedron: all others come as rows of a matrix.

In the order in which data passes:

- `node_texels`: Device memory of one solve, and nodal vectors in it as texels.
- `block_texels`: Distinct block rows as texels, for kernels that take one node per thread.
- `stiffness`: The stiffness operator y = K u: kernel driver of
  ``shaders/fem/device/stiffness.wgsl``.
- `tet_elements`: Quadratic tetrahedra by their geometry alone, for products that never form K, and
  as texels.
- `tet_forces`: K u of quadratic tetrahedra, no K formed: twin and driver of
  ``shaders/fem/device/tet_forces.wgsl``; and the choice between them and rows of blocks.
- `tet_forces_single`: The same in float32, for smoothing: twin and driver of
  ``shaders/fem/device/tet_forces_single.wgsl``.
- `linear_combination`: Sums of vectors on the device: twin and driver of
  ``shaders/fem/device/linear_combination.wgsl``.
- `relaxation`: Smoothing on the device in float32: twin and driver of
  ``shaders/fem/device/relaxation.wgsl``.
- `interpolation`: Nodal interpolation between levels on the device: driver of
  ``shaders/fem/device/interpolation.wgsl``.
- `v_cycle`: The V-cycle on the device.
"""
