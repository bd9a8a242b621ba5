"""Shading: the light of pixels that lie inside one triangle.

In the order in which data passes:

- `lighting`: The light of a view: emitters, surroundings and shadows, as the shaders read them
  and in NumPy.
- `setup`: A view set up for shading: per-triangle coefficients, pattern tables and lamps, in
  float64.
- `triangle_records`: The triangles' records, made on the device from the vertices that triangles
  share.
- `scene_buffers`: What shaders read of a setup: its triangles, paints, lights and shadows, on the
  device.
- `tile_light`: Light on large flat matte faces, evaluated at the corners of tiles and
  interpolated between.
- `programs`: The programs that shade a view: one for each kind of paint and light.
- `deferred_pass`: Shading pixel by pixel: first which triangle each one sees, then its light.
- `forward_pass`: Shading: the mean radiance over each pixel that lies inside one smooth, evenly
  painted patch.
- `receiver_planes`: Planes of the triangles of a view, from which their pixels ask for lamps.
- `relighting`: Pixels that don't see all of every lamp, lit again by what `gpusim.optics.shadow`
  finds.
"""
