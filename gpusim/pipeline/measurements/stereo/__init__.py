"""The kind "stereo": points in space from several cameras.

In the order in which data passes:

- `result`: Markers in space over frames, and the calibration that they rest on: tables, figures,
  what the report says.
- `measuring`: Markers in space: a rig calibrated from the run's own chessboard images, then
  triangulation.
"""

from gpusim.pipeline.measurements.stereo.measuring import measure_stereo
from gpusim.pipeline.measurements.stereo.result import StereoResult

__all__ = ["StereoResult", "measure_stereo"]
