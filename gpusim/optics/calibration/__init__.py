"""Calibration files of other programs.

In the order in which data passes:

- `document`: The trees of keys, lists and numbers that calibration files are: YAML, JSON and
  OpenCV's XML.
- `opencv`: OpenCV's FileStorage: single cameras, stereo pairs as its samples write them, and
  whole rigs.
- `rig_formats`: Files of whole rigs: Kalibr's camchain, MatchID's .caldat, VIC-3D's and DICe's
  XML.
- `formats`: Cameras from and to the calibration files of other programs.
- `lens_fit`: A camera as near as a calibration format comes to it, and how far off that is.
- `calibration_files`: The calibration files of a rig, as each program wants to have them.
"""
