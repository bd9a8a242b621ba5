"""Calibration of cameras and rigs.

In the order in which data passes:

- `view_scatter`: How much more the views of a calibration differ than by independent errors of
  their points.
- `bundle_adjustment`: Bundle adjustment of a rig: cameras, their places in the rig, and where the
  target stood.
- `board_orientation`: Boards that look the same when they are turned: which way round each camera
  of a rig saw them.
- `calibration`: Camera calibration from images of a target: one camera, a stereo pair or a larger
  rig.
"""
