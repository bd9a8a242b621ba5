"""Calibration of cameras and rigs.

In the order in which data passes:

- `bundle_adjustment`: Bundle adjustment of a rig: cameras, their places in the rig, and where the
  target stood.
- `first_estimate`: First estimates of a rig: each camera by itself, and how they stand to each
  other.
- `calibration`: Camera calibration from images of a target: one camera, a stereo pair or a larger
  rig.
"""
