"""Rendering: one frame, from view to radiance.

In the order in which data passes:

- `local_origin`: The origin that a picture is made from, near what it shows.
- `frame_plan`: What one frame is made by: every choice, made once before any work, with its
  reason.
- `renderer`: Rendering one frame: view, visibility, interior shading, edge pixels.
"""
