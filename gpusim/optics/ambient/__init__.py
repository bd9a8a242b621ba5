"""Ambient light: which surroundings points of surfaces see.

In the order in which data passes:

- `sample_points`: Points that look at the hemisphere over them, and what counts as lying on a
  face there.
- `quad_strips`: Faces of a mesh in rows: each beside the next, across edges that are opposite in
  every face.
- `coplanar_merging`: Flat parts of a mesh as fewer, larger quadrilaterals.
- `sky_occluders`: The faces that may hide surroundings; flat parts are joined
  (`gpusim.optics.ambient.coplanar_merging`).
- `edge_adjacency`: Faces that hide what is behind them, edge by edge.
- `bounding_hierarchy`: Things in clusters of clusters, and which of them groups of points need to
  look at.
- `silhouette_bvh`: Edges and faces in clusters: which of them may be contours to a point, or lie
  on its way up.
- `silhouette_buffers`: The tables of `gpusim.optics.ambient.silhouette_bvh` on the device, and
  what points find in them (``shaders/optics/ambient/silhouette_search.wgsl``).
- `silhouette_search`: Which edges may be contours to points, and which faces they may lie on or
  have on their way up.
- `hemisphere_mask`: Which directions over a point the faces around it hide: bits along great
  circles.
- `discontinuities`: What lies behind an open sheet that cuts a surface: neither seen there nor
  lit alike.
- `sky_visibility`: How open surfaces lie to their surroundings: shares of light at nodes spread
  over a view.
- `sky_visibility_buffers`: The tables of `gpusim.optics.ambient.sky_visibility` as
  lib/light/sky_visibility.wgsl reads them.
- `sky_irradiance`: What reaches a point of surroundings that surfaces hide, as a share of what
  would without them.
"""
