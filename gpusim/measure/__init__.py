"""Measuring images: markers, targets, subset matching, tracking, deflection, calibration and
points in space. Sees pictures only."""

from gpusim.measure.calibration import CalibratedCamera, Calibration, calibrate
from gpusim.measure.charuco import CharucoBoard, find_charuco
from gpusim.measure.chessboard import find_chessboard
from gpusim.measure.codes import Codes, find_aruco
from gpusim.measure.corners import Markers, MarkerStatus, find_markers, locate_markers
from gpusim.measure.crossings import Crossings, fit_crossings
from gpusim.measure.damage import SlopeChanges, difference_curve, slope_changes
from gpusim.measure.deflection import (
    DeflectionLine,
    RigidMotion,
    Scale,
    deflection_line,
    rigid_motion,
    scale_coefficient,
)
from gpusim.measure.dic import dic, grid_points
from gpusim.measure.dots import Dots, circle_centres, find_dots
from gpusim.measure.epipolar import Matches, epipolar_distance, match_epipolar
from gpusim.measure.interpolation import SplineImage
from gpusim.measure.mapped import MappedResult, lens_mapping, mapped, plane_mapping
from gpusim.measure.matching import Status
from gpusim.measure.sequence import dic_sequence
from gpusim.measure.stereo import StereoResult, stereo_dic, stereo_shape
from gpusim.measure.strain import StrainResult, StrainStatus, strain
from gpusim.measure.subsets import DicResult
from gpusim.measure.surface_strain import surface_strain
from gpusim.measure.targets import Chessboard, Sighting, TargetStatistics, target_statistics
from gpusim.measure.tracking import TrackResult, track
from gpusim.measure.triangulation import (
    Alignment,
    Displacement3D,
    Triangulated,
    align,
    displacement_3d,
    triangulate,
)
from gpusim.measure.views import rig_camera

__all__ = [
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
    "MappedResult",
    "MarkerStatus",
    "Markers",
    "Matches",
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
    "align",
    "calibrate",
    "circle_centres",
    "deflection_line",
    "dic",
    "dic_sequence",
    "difference_curve",
    "displacement_3d",
    "epipolar_distance",
    "find_aruco",
    "find_charuco",
    "find_chessboard",
    "find_dots",
    "find_markers",
    "fit_crossings",
    "grid_points",
    "lens_mapping",
    "locate_markers",
    "mapped",
    "match_epipolar",
    "plane_mapping",
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
