"""Edge pixels: exact areas of all triangles that touch them.

In the order in which data passes:

- `pixel_rank`: How many of an image's listed pixels come before others: a search without steps.
- `depth_order`: Which of two triangles is in front where things touch within a pixel (float64,
  vectorised).
- `fragment_lists`: Edge pixels and the triangles that touch them, nearest first (float64,
  vectorised).
- `visible_polygons`: What is seen of triangles that others hide in part, as exact convex pieces
  (float64).
- `background_moments`: What is seen of a plain triangle behind all others of a pixel: what these
  leave of the pixel.
- `fragment_shading`: Pieces of edge pixels in NumPy: what shows of each triangle, its paint's
  mean, its light.
- `plate_border`: Edge pixels of one flat plate before the background, where it shows one albedo:
  shares of areas.
- `loop_budget`: Loop turns that the shader of edge pixels may take, which the device limits
  without a word.
- `scatter`: Single values into an image on the device: one upload, however many there are.
- `resolve`: Edge pixels: exact polygon areas of every triangle over the pixel, from front to
  back.
"""
