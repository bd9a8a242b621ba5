"""Measurements in a run's images, with the truth beside them.

In the order in which data passes:

- `marker_detection`: Markers of a scene, found in a picture near where they are expected, and
  fits of their crosses.
- `marker_tracking`: Markers found in a first image of a camera and followed into a last one.
- `sources`: What measurements are given: pictures, the board's corners found in them, markers
  tracked.
- `result_files`: Results of measurements as they are kept in the output folder: JSON with
  everything, and tables.
- `projection_error`: What one scale for the whole image does to displacements that are measured
  with it.
- `deflection`: A deflection line measured from the first and the last image of one camera, with
  its truth.
- `stereo`: Markers in space: a rig calibrated from the run's own chessboard images, then
  triangulation.
- `damage`: Deflection lines of several states compared: difference curves, and where their slope
  changes.
- `measurements`: Every kind of measurement that a scene can ask for: done, read again, and told
  in the report.
"""
