"""Targets: markers and boards, found in images, and the fits of their borders.

In the order in which data passes:

- `levenberg_marquardt`: Many small least-squares problems at once (Levenberg-Marquardt, damped by
  the diagonal).
- `noise`: How noisy a picture is, and how uncertain fits are where noise of neighbours is alike.
- `border_junction`: Straight black-white borders and where two of them cross: what markers and
  chessboards show.
- `plumb_lines`: How a lens bends straight lines, from the lines of a flat grid in one picture
  (plumb lines).
- `crossings`: Chessboard corners to a thousandth of a pixel: all crossings of an image fitted at
  once.
- `cross_fit`: Fit the crosses of square 2x2 checker markers: the junction of their borders, and
  its ends.
- `checker_markers`: Find the centres of 2x2 checker markers: Harris response, symmetry check,
  exact edge fit.
- `boards`: What a calibration looks at: flat boards with points of known places, found in images.
- `coded_markers`: Coded markers (ArUco, AprilTag): OpenCV reads their numbers, our own fit places
  their corners.
- `board_detection`: Find boards in an image: OpenCV tells their corners, our own fit places every
  one of them.
"""
