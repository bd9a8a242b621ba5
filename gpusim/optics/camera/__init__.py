"""Cameras: pinhole, lens distortion, and its inverse.

In the order in which data passes:

- `distortion`: Lens distortion in OpenCV's model, both ways, exact, with a checked domain.
- `pinhole`: Cameras in the OpenCV convention: integer pixel coordinates are pixel centres.
- `standpoint`: Where cameras stand that see a side of a body whole.
- `undistortion_table`: Undistortion of every pixel by a table of cubics, as good as exact and
  cheap to evaluate.
"""
