"""Rasterisation: which triangle each pixel sees.

In the order in which data passes:

- `coefficients`: What the pixels of a triangle share: affine functions of the offset from its
  anchor pixel.
- `vertex_buffers`: A view's triangles on the device, as rasterisers and the edge pass read them.
- `visibility_buffer`: The triangle that each pixel's centre sees, a band of rows at a time.
- `id_buffer`: Visibility: which triangle the centre of each pixel sees.
- `compute_raster`: The triangle that each pixel sees, where triangles are small.
"""
