"""Targets: markers and boards, found in images.

In the order in which data passes:

- `boards`: What a calibration looks at: flat boards with points of known places, found in images.
- `cross_fit`: Fit the crosses of square 2x2 checker markers: the junction of their borders, and
  its ends.
- `checker_markers`: Find the centres of 2x2 checker markers: Harris response, symmetry check,
  exact edge fit.
- `coded_markers`: Coded markers (ArUco, AprilTag): OpenCV reads their numbers, our own fit places
  their corners.
- `crossings`: Chessboard corners to a thousandth of a pixel: all crossings of an image fitted at
  once.
- `chessboard`: Find a chessboard in an image: OpenCV's sector detector, then our own fit of every
  corner.
- `charuco`: Find a ChArUco board: OpenCV tells the corners by their markers, our own fit places
  them.
"""
