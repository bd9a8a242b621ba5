"""Geometry: surfaces as one camera sees them.

In the order in which data passes:

- `triangle_corners`: Arrays over the corners of triangles, a few thousand at a time or a column
  after another.
- `polygon_clipping`: Convex polygons inside a pixel: half planes, clipping, moments (float64,
  vectorised).
- `feature_edges`: Edges of a triangle mesh that show in an image: silhouettes, borders, creases,
  region borders.
- `vertex_attributes`: What a surface's vertices carry: places, normals, paint coordinates.
- `culling`: Which triangles of a surface a camera may see, and where they look, a few thousand at
  a time.
- `index_buffer`: Triangles as a camera sees them, by the vertices that they share.
- `clipping`: Triangles cut to what a camera sees and to what float32 and a bent lens allow.
- `pattern_seams`: Edges of triangles across which the speckle on them jumps or bends.
- `interpenetration`: Where surfaces cut through each other: lines in the image that no edge of a
  mesh runs along.
- `pixel_footprint`: How large pixels are on painted regions.
- `view`: Surfaces as one camera sees them: triangles in float64, clipped, culled, and set up for
  shading.
- `point_location`: Which triangle a camera sees at any place of its image, between pixel centres
  too.
"""
