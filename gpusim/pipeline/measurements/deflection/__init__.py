"""The kind "deflection": displacements in the image of one camera.

In the order in which data passes:

- `projection_error`: What one scale for the whole image does to displacements that are measured
  with it.
- `result`: A deflection line and its truth, over frames: its table, its warnings, what the report
  says.
- `measuring`: A deflection line measured in the images of one camera, with its truth.
"""

from gpusim.pipeline.measurements.deflection.measuring import measure_deflection
from gpusim.pipeline.measurements.deflection.result import DeflectionResult

__all__ = ["DeflectionResult", "measure_deflection"]
