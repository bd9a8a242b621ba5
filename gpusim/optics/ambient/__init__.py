"""Ambient light: which surroundings points of surfaces see.

In the order in which data passes:

- `coplanar_merging`: Flat parts of a mesh as fewer, larger quadrilaterals.
- `silhouette_bvh`: The silhouettes of meshes around a point: edges between faces, in clusters of
  clusters.
- `sky_occluders`: The faces that may hide surroundings; flat parts are joined
  (`gpusim.optics.ambient.coplanar_merging`).
- `silhouette_search`: Which edges may be contours to points, and which faces they may lie on or
  have on their way up.
- `hemisphere_mask`: Which directions over a point the faces around it hide: bits along great
  circles.
- `sky_visibility`: How open surfaces lie to their surroundings: shares of light at nodes spread
  over a view.
- `sky_irradiance`: What reaches a point of surroundings that surfaces hide, as a share of what
  would without them.
"""
