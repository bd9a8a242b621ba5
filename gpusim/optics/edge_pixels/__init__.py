"""Edge pixels: exact areas of all triangles that touch them.

In the order in which data passes:

- `visible_polygons`: What is seen of triangles that others hide in part, as exact convex pieces
  (float64).
- `fragment_lists`: Edge pixels and the triangles that touch them, nearest first (float64,
  vectorised).
- `fragment_shading`: Pieces of edge pixels in NumPy: what shows of each triangle, its paint's
  mean, its light.
- `plate_border`: Edge pixels of one flat plate before the background, where it shows one albedo:
  shares of areas.
- `resolve`: Edge pixels: exact polygon areas of every triangle over the pixel, from front to
  back.
"""
