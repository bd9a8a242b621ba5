"""Calibration files of other programs.

In the order in which data passes:

- `document`: The trees of keys, lists and numbers that calibration files are: YAML, JSON and
  OpenCV's XML.
- `common`: What the readers and writers of calibration files share: numbers, rotations, missing
  sizes.
- `ros`: What ROS adds to a calibration: CameraInfo messages, and the part of the sensor that is
  read.
- `opencv`: OpenCV's FileStorage: single cameras, stereo pairs as its samples write them, and
  whole rigs.
- `kalibr_matchid`: Kalibr's camchain (YAML) and MatchID's .caldat (key;value).
- `vic_dice`: VIC-3D's <camera> elements and DICe's camera system file.
- `formats`: Cameras from and to the calibration files of other programs.
"""
