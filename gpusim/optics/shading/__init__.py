"""Shading: the light of pixels that lie inside one triangle.

In the order in which data passes:

- `lighting`: The light of a view: emitters, surroundings and shadows, as the shaders read them
  and in NumPy.
- `coefficients`: What the pixels of a triangle share: affine functions of the offset from its
  anchor pixel.
- `spectrum`: Bands of the spectrum: what each of them has of its own, and how the device is told
  of three.
- `triangle_traits`: What the triangles of a view are like: plain or near a feature, matte or
  glossy, in relief.
- `specialisation`: What of the shaders' code a view needs: names of programs, and their override
  constants.
- `setup`: A view set up for shading: per-triangle coefficients, pattern tables and lamps, in
  float64.
- `triangle_records`: Triangles as the shader reads them: the coefficients and traits of each in
  float32.
- `radiance`: Radiance of pixels whose albedo is known, in NumPy.
- `scene_buffers`: What shaders read of a setup: its triangles, paints, lights and shadows, on the
  device.
- `tile_light`: Light on large flat matte faces, evaluated at the corners of tiles and
  interpolated between.
- `shading_pass`: Shading: the mean radiance over each pixel that lies inside one smooth, evenly
  painted patch.
- `relighting`: Pixels that don't see all of every lamp, lit again by what `gpusim.optics.shadow`
  finds.
"""
