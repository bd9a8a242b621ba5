"""What was measured at points of a camera's first picture, from OUT/measure, and where these points
are on the bodies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from zipfile import BadZipFile

import numpy as np
import scipy

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.export.field_catalogue import Fields, point_fields
from gpusim.files.input_file import read_input
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.rendering.local_origin import local_view
from gpusim.pipeline.measurements.results import PointTable, stored_table
from gpusim.surface.surface import Surface
from gpusim.view.content.picking import MaterialPoints, material_points

PLACE = ("x_px", "y_px")
"""Columns of points in the first picture."""
WIDEST = 40.0
"""px of the picture that a point's square is wide, at most."""
CORNERS = np.array([(0, 0), (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
"""Of a point's square, after its middle, in distances between points."""


class Squares(NamedTuple):
    """Of the points (n,) numbered ``point`` the middle and the corners of a square on the surfaces,
    as wide as points are apart, `WIDEST` at most: ``places`` (n, 5)."""

    point: Long
    places: MaterialPoints


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """Fields that were measured at points of the first picture of a ``camera``."""

    name: str
    camera: str
    table: PointTable

    @cached_property
    def fields(self) -> Fields:
        """By the names of their columns."""
        return point_fields(
            name for name, one in self.table.columns.items()
            if one.dtype.kind == "f" and name not in PLACE
        )  # fmt: skip

    def values(self, name: str, frame: int) -> Float:
        """(P,) in a frame, in the field's unit; NaN where nothing was measured."""
        every: Float = self.fields[name].values(self.table.columns)
        frames = self.table.frames
        return every[frames.index(frame)] if frame in frames else np.full_like(every[0], np.nan)

    def squares(self, surfaces: Sequence[Surface], camera: Camera, device: Device) -> Squares:
        """Where the points are on ``surfaces`` as the ``camera`` saw them in the first frame."""
        at = np.stack([self.table[name][0] for name in PLACE], axis=1)
        pixel = np.rint(at)
        point = np.flatnonzero(((pixel >= 0) & (pixel < [camera.width, camera.height])).all(axis=1))
        column, row = pixel[point].astype(int).T
        view = local_view(surfaces, camera, lit=False)
        triangle = Frame(view, device).ids()[row, column].astype(np.int64) - 1
        point, triangle = point[triangle >= 0], triangle[triangle >= 0]
        step = WIDEST
        if len(point) > 1:
            apart = np.asarray(scipy.spatial.cKDTree(at[point]).query(at[point], 2)[0])
            step = min(float(np.median(apart[:, 1])), WIDEST)
        pixels = at[point, None] + step * CORNERS
        return Squares(point, material_points(view, surfaces, triangle, pixels))


def measured_points(path: Path) -> MeasuredPoints | None:
    """Those of a file of a measurement; None for one that isn't of points in a picture.

    Raises
    ------
    InputError
        The file is damaged.
    """
    try:
        table, rest = stored_table(read_input(path))
    except (OSError, EOFError, ValueError, KeyError, TypeError, BadZipFile) as error:
        expected = "what a run of this scene has written"
        raise InputError(f"{path}: damaged; got {error}; expected {expected}") from None
    if not {*PLACE} <= {*table.columns} or not rest.get("cameras"):
        return None
    return MeasuredPoints(path.stem, rest["cameras"][0], table)
