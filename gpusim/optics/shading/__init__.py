"""Shading: the light of pixels that lie inside one triangle.

In the order in which data passes:

- `lighting`: The light of a view: emitters, surroundings and shadows, as the shaders read them
  and in NumPy.
- `setup`: A view set up for shading: per-triangle coefficients, pattern tables and lamps, in
  float64.
- `looks`: What small triangles on plain paint and on chessboards look like, found on the device.
- `scene_buffers`: What shaders read of a setup: its triangles, paints, lights and shadows, on the
  device.
- `tile_light`: Light on large flat matte faces, evaluated at the corners of tiles and
  interpolated between.
- `glance_kind`: Triangles of one program whose light is looked for as a function of the pixel.
- `glance`: Light on small matte triangles: a function of the pixel each, of first or of second
  degree.
- `speckled`: Small matte triangles with speckle: what pixels read of theirs is as little as can
  be.
- `layer_bands`: Bands of a view that is one layer: triangles write into them what pixels see,
  band by band.
- `layer_pass`: The pixels of a view that is one layer: its triangles write them as soon as they
  are lit.
- `deferred_pass`: Shading pixel by pixel: first which triangle each one sees, then its light.
- `forward_pass`: Shading: the mean radiance over each pixel that lies inside one smooth, evenly
  painted patch.
- `relighting`: Pixels that don't see all of every lamp, lit again by what `gpusim.optics.shadow`
  finds.
"""
