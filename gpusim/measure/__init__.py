"""Measuring images: markers, targets, subset matching, tracking, deflection, calibration and
points in space. Sees pictures only.

In the order in which data passes:

- `images`: What every measurement accepts as an image, and how it reads it between the pixels.
- `targets`: Markers and boards, found in images, and the fits of their borders.
- `calibration`: Calibration of cameras and rigs.
- `correlation`: Digital image correlation.
- `advice`: Advice on the settings of a correlation, from the picture that is to be correlated.
- `stereo`: Points, shapes and strains in space, from calibrated cameras.
- `structures`: Markers tracked, deflection lines, damage.
- `vibration`: Motions of points over time, modes from them, motions made visible.
"""

from gpusim.measure.advice.image_noise import ImageNoise
from gpusim.measure.advice.settings_advice import Advice, advise
from gpusim.measure.calibration.calibration import (
    CalibratedCamera,
    Calibration,
    calibrate,
    rig_camera,
)
from gpusim.measure.correlation.dic import dic, grid_points
from gpusim.measure.correlation.gauge_filter import gauge_filter
from gpusim.measure.correlation.matching import DicResult, Status
from gpusim.measure.correlation.sequence import dic_sequence
from gpusim.measure.correlation.strain import StrainResult, StrainStatus, strain, surface_strain
from gpusim.measure.correlation.virtual_gauges import extensometer, gauge
from gpusim.measure.images import SplineImage
from gpusim.measure.stereo.epipolar_matching import Matches, epipolar_distance, match_epipolar
from gpusim.measure.stereo.plane_mapping import MappedResult, lens_mapping, mapped, plane_mapping
from gpusim.measure.stereo.stereo_correlation import StereoResult, stereo_dic, stereo_shape
from gpusim.measure.stereo.triangulation import (
    Alignment,
    Displacement3D,
    Triangulated,
    align,
    displacement_3d,
    triangulate,
)
from gpusim.measure.structures.damage import SlopeChanges, difference_curve, slope_changes
from gpusim.measure.structures.deflection import (
    DeflectionLine,
    RigidMotion,
    Scale,
    deflection_line,
    rigid_motion,
    scale_coefficient,
)
from gpusim.measure.structures.dot_centres import Dots, circle_centres, find_dots
from gpusim.measure.structures.marker_tracking import TrackResult, track
from gpusim.measure.targets.board_detection import find_charuco, find_chessboard
from gpusim.measure.targets.boards import (
    CharucoBoard,
    Chessboard,
    Sighting,
    TargetStatistics,
    target_statistics,
)
from gpusim.measure.targets.checker_markers import (
    Markers,
    MarkerStatus,
    find_markers,
    locate_markers,
)
from gpusim.measure.targets.coded_markers import Codes, find_aruco
from gpusim.measure.targets.crossings import Crossings, fit_crossings
from gpusim.measure.vibration.identification import identify_modes
from gpusim.measure.vibration.magnification import magnify
from gpusim.measure.vibration.operational_modes import OperationalModes, mac
from gpusim.measure.vibration.point_series import PointSeries, point_series

__all__ = [
    "Advice",
    "Alignment",
    "CalibratedCamera",
    "Calibration",
    "CharucoBoard",
    "Chessboard",
    "Codes",
    "Crossings",
    "DeflectionLine",
    "DicResult",
    "Displacement3D",
    "Dots",
    "ImageNoise",
    "MappedResult",
    "MarkerStatus",
    "Markers",
    "Matches",
    "OperationalModes",
    "PointSeries",
    "RigidMotion",
    "Scale",
    "Sighting",
    "SlopeChanges",
    "SplineImage",
    "Status",
    "StereoResult",
    "StrainResult",
    "StrainStatus",
    "TargetStatistics",
    "TrackResult",
    "Triangulated",
    "advise",
    "align",
    "calibrate",
    "circle_centres",
    "deflection_line",
    "dic",
    "dic_sequence",
    "difference_curve",
    "displacement_3d",
    "epipolar_distance",
    "extensometer",
    "find_aruco",
    "find_charuco",
    "find_chessboard",
    "find_dots",
    "find_markers",
    "fit_crossings",
    "gauge",
    "gauge_filter",
    "grid_points",
    "identify_modes",
    "lens_mapping",
    "locate_markers",
    "mac",
    "magnify",
    "mapped",
    "match_epipolar",
    "plane_mapping",
    "point_series",
    "rig_camera",
    "rigid_motion",
    "scale_coefficient",
    "slope_changes",
    "stereo_dic",
    "stereo_shape",
    "strain",
    "surface_strain",
    "target_statistics",
    "track",
    "triangulate",
]


def __dir__() -> list[str]:
    return sorted(__all__)
