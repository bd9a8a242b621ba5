"""Measuring images: markers, subset matching, tracking, deflection. Sees pictures only."""

from gpusim.measure.corners import Markers, MarkerStatus, find_markers, locate_markers
from gpusim.measure.deflection import (
    DeflectionLine,
    RigidMotion,
    Scale,
    deflection_line,
    rigid_motion,
    scale_coefficient,
)
from gpusim.measure.dic import dic, grid_points
from gpusim.measure.interpolation import SplineImage
from gpusim.measure.matching import Status
from gpusim.measure.strain import StrainResult, StrainStatus, strain
from gpusim.measure.subsets import DicResult
from gpusim.measure.tracking import TrackResult, track

__all__ = [
    "DeflectionLine",
    "DicResult",
    "MarkerStatus",
    "Markers",
    "RigidMotion",
    "Scale",
    "SplineImage",
    "Status",
    "StrainResult",
    "StrainStatus",
    "TrackResult",
    "deflection_line",
    "dic",
    "find_markers",
    "grid_points",
    "locate_markers",
    "rigid_motion",
    "scale_coefficient",
    "strain",
    "track",
]
