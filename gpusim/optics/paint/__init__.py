"""Paint: means of patterns over what a pixel sees of them.

In the order in which data passes:

- `disc_grid`: Speckle as lists of discs per cell, for the host and the device.
- `disc_coverage`: The share of a pixel that speckle covers.
- `feature_overlap`: Whether features of a pattern keep apart, as their sum takes for granted.
- `feature_grid`: Paint patterns as tables that a pixel can look up;
  `gpusim.optics.paint.footprint_mean` evaluates them.
- `bitmap`: The mean of a bitmap's spline surface over what a pixel sees of it.
- `footprint_mean`: The exact mean albedo of a pattern over what a pixel sees of it.
- `checker_lines`: The lines of large chessboards, drawn by themselves: only their pixels need the
  closed form.
- `relief_normals`: Fine relief on the triangles of a view: how it turns the normal over a pixel.
"""
