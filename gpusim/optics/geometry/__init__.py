"""Geometry: surfaces as one camera sees them.

In the order in which data passes:

- `triangle_corners`: Arrays over the corners of triangles, a few thousand at a time or a column
  after another.
- `polygon_clipping`: Convex polygons inside a pixel: half planes, clipping, moments (float64,
  vectorised).
- `face_winding`: Closed bodies whose faces are wound the wrong way: seen from outside they show
  their inside.
- `feature_edges`: Edges of a triangle mesh that show in an image: silhouettes, borders, creases,
  region borders.
- `surface_normals`: Normals of a surface's triangles and vertices: of the surface, whatever looks
  at it.
- `vertex_attributes`: What a surface's vertices carry: places, normals, paint coordinates.
- `culling`: Which triangles of a surface a camera may see, and where they look, a few thousand at
  a time.
- `index_buffer`: Triangles as a camera sees them, by the vertices that they share.
- `split_criterion`: Triangles that `gpusim.optics.geometry.clipping.split` would leave as they
  are: they keep their vertices.
- `clipping`: Triangles cut to what a camera sees and to what float32 and a bent lens allow.
- `pattern_seams`: Edges of triangles across which the speckle on them jumps or bends.
- `interpenetration`: Where surfaces cut through each other: lines in the image that no edge of a
  mesh runs along.
- `anisotropic_footprint`: Speckle seen at a grazing angle: what a region's tables are made for,
  and what goes without.
- `pixel_footprint`: How large pixels are on painted regions.
- `view`: Surfaces as one camera sees them: triangles in float64, clipped, culled, and set up for
  shading.
"""
