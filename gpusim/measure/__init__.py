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

from gpusim.measure.advice.image_noise import ImageNoise as ImageNoise
from gpusim.measure.advice.settings_advice import Advice as Advice
from gpusim.measure.advice.settings_advice import advise as advise
from gpusim.measure.calibration.calibration import CalibratedCamera as CalibratedCamera
from gpusim.measure.calibration.calibration import Calibration as Calibration
from gpusim.measure.calibration.calibration import calibrate as calibrate
from gpusim.measure.calibration.calibration import rig_camera as rig_camera
from gpusim.measure.correlation.dic import dic as dic
from gpusim.measure.correlation.dic import grid_points as grid_points
from gpusim.measure.correlation.gauge_filter import gauge_filter as gauge_filter
from gpusim.measure.correlation.matching import DicResult as DicResult
from gpusim.measure.correlation.matching import Status as Status
from gpusim.measure.correlation.sequence import dic_sequence as dic_sequence
from gpusim.measure.correlation.strain import StrainResult as StrainResult
from gpusim.measure.correlation.strain import StrainStatus as StrainStatus
from gpusim.measure.correlation.strain import strain as strain
from gpusim.measure.correlation.strain import surface_strain as surface_strain
from gpusim.measure.correlation.virtual_gauges import extensometer as extensometer
from gpusim.measure.correlation.virtual_gauges import gauge as gauge
from gpusim.measure.images import SplineImage as SplineImage
from gpusim.measure.stereo.epipolar_matching import Matches as Matches
from gpusim.measure.stereo.epipolar_matching import epipolar_distance as epipolar_distance
from gpusim.measure.stereo.epipolar_matching import match_epipolar as match_epipolar
from gpusim.measure.stereo.plane_mapping import MappedResult as MappedResult
from gpusim.measure.stereo.plane_mapping import lens_mapping as lens_mapping
from gpusim.measure.stereo.plane_mapping import mapped as mapped
from gpusim.measure.stereo.plane_mapping import plane_mapping as plane_mapping
from gpusim.measure.stereo.stereo_correlation import StereoResult as StereoResult
from gpusim.measure.stereo.stereo_correlation import stereo_dic as stereo_dic
from gpusim.measure.stereo.stereo_correlation import stereo_shape as stereo_shape
from gpusim.measure.stereo.triangulation import Alignment as Alignment
from gpusim.measure.stereo.triangulation import Displacement3D as Displacement3D
from gpusim.measure.stereo.triangulation import Triangulated as Triangulated
from gpusim.measure.stereo.triangulation import align as align
from gpusim.measure.stereo.triangulation import displacement_3d as displacement_3d
from gpusim.measure.stereo.triangulation import triangulate as triangulate
from gpusim.measure.structures.damage import SlopeChanges as SlopeChanges
from gpusim.measure.structures.damage import difference_curve as difference_curve
from gpusim.measure.structures.damage import slope_changes as slope_changes
from gpusim.measure.structures.deflection import DeflectionLine as DeflectionLine
from gpusim.measure.structures.deflection import RigidMotion as RigidMotion
from gpusim.measure.structures.deflection import Scale as Scale
from gpusim.measure.structures.deflection import deflection_line as deflection_line
from gpusim.measure.structures.deflection import rigid_motion as rigid_motion
from gpusim.measure.structures.deflection import scale_coefficient as scale_coefficient
from gpusim.measure.structures.dot_centres import Dots as Dots
from gpusim.measure.structures.dot_centres import circle_centres as circle_centres
from gpusim.measure.structures.dot_centres import find_dots as find_dots
from gpusim.measure.structures.marker_tracking import TrackResult as TrackResult
from gpusim.measure.structures.marker_tracking import track as track
from gpusim.measure.targets.board_detection import find_charuco as find_charuco
from gpusim.measure.targets.board_detection import find_chessboard as find_chessboard
from gpusim.measure.targets.boards import CharucoBoard as CharucoBoard
from gpusim.measure.targets.boards import Chessboard as Chessboard
from gpusim.measure.targets.boards import Sighting as Sighting
from gpusim.measure.targets.boards import TargetStatistics as TargetStatistics
from gpusim.measure.targets.boards import target_statistics as target_statistics
from gpusim.measure.targets.checker_markers import Markers as Markers
from gpusim.measure.targets.checker_markers import MarkerStatus as MarkerStatus
from gpusim.measure.targets.checker_markers import find_markers as find_markers
from gpusim.measure.targets.checker_markers import locate_markers as locate_markers
from gpusim.measure.targets.coded_markers import Codes as Codes
from gpusim.measure.targets.coded_markers import find_aruco as find_aruco
from gpusim.measure.targets.crossings import Crossings as Crossings
from gpusim.measure.targets.crossings import fit_crossings as fit_crossings
from gpusim.measure.vibration.identification import identify_modes as identify_modes
from gpusim.measure.vibration.magnification import magnify as magnify
from gpusim.measure.vibration.operational_modes import OperationalModes as OperationalModes
from gpusim.measure.vibration.operational_modes import mac as mac
from gpusim.measure.vibration.point_series import PointSeries as PointSeries
from gpusim.measure.vibration.point_series import point_series as point_series
from gpusim.public_names import public_names as _public_names

__all__, __getattr__, __dir__ = _public_names(__name__)
