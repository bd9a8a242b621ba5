"""Rendering: one frame, from view to radiance.

In the order in which data passes:

- `local_origin`: The origin that a picture is made from, near what it shows.
- `frame_plan`: What one frame is made by: every choice, made once before any work, with its
  reason.
- `frame_programs`: The programs of a frame that come after the first ones: compiled while those
  work.
- `renderer`: Rendering one frame: view, visibility, interior shading, edge pixels.
"""
