"""The solver on a device: texels, operators, smoothing, the V-cycle.

In the order in which data passes:

- `arena`: Device memory of one solve: everything allocated through an arena is freed together.
- `node_texels`: Nodal vectors as texels: (x, y, z, 0) per node, each load case followed by one
  texel of zeros.
- `row_slices`: Rows of blocks side by side: threads that work together read one stretch of
  memory.
- `block_texels`: Distinct block rows as texels, for kernels that take one node per thread.
- `stiffness`: The stiffness operator y = K u: NumPy twin and kernel driver of
  ``shaders/fem/device/stiffness.wgsl``.
- `block_product`: Any matrix of 3x3 blocks times a vector on the device, in float64.
- `tet_elements`: Quadratic tetrahedra by their geometry alone: what products need that never form
  K.
- `tet_texels`: Quadratic tetrahedra as texels, for kernels that take one element per thread.
- `tet_forces`: K u of quadratic tetrahedra, no K formed: twin and driver of
  ``shaders/fem/device/tet_forces.wgsl``.
- `tet_forces_single`: The same in float32, for smoothing: twin and driver of
  ``shaders/fem/device/tet_forces_single.wgsl``.
- `operator_form`: The form in which a stiffness goes to a device: by its elements, or as rows of
  blocks.
- `linear_combination`: Sums of vectors on the device: twin and driver of
  ``shaders/fem/device/linear_combination.wgsl``.
- `relaxation`: Smoothing on the device in float32: twin and driver of
  ``shaders/fem/device/relaxation.wgsl``.
- `interpolation`: Nodal interpolation between levels on the device: driver of
  ``shaders/fem/device/interpolation.wgsl``.
- `v_cycle`: The V-cycle on the device.
"""
