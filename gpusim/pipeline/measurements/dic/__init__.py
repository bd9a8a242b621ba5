"""The kind "dic": displacements and strains of surfaces by digital image correlation.

In the order in which data passes:

- `lone_points`: Points that few others are near: whether they were found where they really are.
- `correlating`: The pictures of a scene correlated: points, masks, and what was found at them.
- `true_field`: The true displacement of all that a region of interest sees, as subsets see it.
- `point_fields`: Fields at points over frames, measured and true, and how they were measured.
- `statistics`: What the differences between measured and true fields say, in numbers.
- `result`: Displacements and strains at points over frames, measured and true: tables, files, what
  the report says.
- `rig`: A pair of cameras as it was calibrated, by pictures or in a file, and as it really is.
- `geometric_error`: Errors that are known without any matching: of calibration, scale, lens, and
  motion out of the plane.
- `field_columns`: Columns of a field's table: places, displacements and strains, measured, true and
  levelled.
- `field_measurement`: What both ways of measuring a field share: from readings of frames to the
  result they end in.
- `one_camera`: A field measured by one camera, in px and in mm.
- `camera_pair`: A field measured by two calibrated cameras: shape and displacement in space, strain
  in the surface.
- `error_parts`: The error of a measured field in parts that add up, and what they say in words.
- `measuring`: Displacements and strains measured in pictures of one camera or of a pair, with their
  truth.
"""

from gpusim.pipeline.measurements.dic.measuring import measure_dic
from gpusim.pipeline.measurements.dic.result import FullFieldResult

__all__ = ["FullFieldResult", "measure_dic"]
