"""Stages of a run.

In the order in which data passes:

- `mechanics`: Bodies of a scene solved, and their stress by frame: recovered, kept in the output
  folder.
- `image_window`: The part of an image that anything is seen in: a small target needs no whole
  frame.
- `images`: Frames of a run: rendered, exposed and written, one camera and frame at a time.
- `exports`: Results for other programs: truth.h5 of what every pixel sees, meshes as VTU, PVD and
  STL.
"""
