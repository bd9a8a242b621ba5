"""Measurements in a run's images, with the truth beside them.

In the order in which data passes:

- `board_corners`: Corners of the calibration board, kept beside the image that they were found
  in.
- `marker_detection`: Markers found in a picture near where they are expected, and the fit of
  their crosses.
- `marker_tracking`: Markers found in a first image of a camera and followed into a last one.
- `marker_cache`: Markers followed in a camera's pictures, kept beside the results they are for.
- `projection_error`: What one scale for the whole image does to displacements that are measured
  with it.
- `deflection`: A measured deflection line with its truth, as it is kept in the output folder.
- `deflection_stage`: The measurements that a scene asks for, from its images, and the truth
  beside them.
- `damage`: Deflection lines of several states compared: difference curves, and where their slope
  changes.
- `stereo`: Markers in space: a rig calibrated from the run's own chessboard images, then
  triangulation.
- `stereo_result`: Measured points in space with their truth, as they are kept in the output
  folder.
- `stereo_report`: What a stereo measurement says in the report: numbers, figures, tracked
  markers.
- `measurements`: Every kind of measurement that a scene can ask for, behind one pair of
  functions.
"""
