"""What was measured at points of a camera's first picture, from OUT/measure, and where these points
are on the bodies."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Float, Long
from gpusim.errors import InputError
from gpusim.export.field_catalogue import Fields, point_fields
from gpusim.files.input_file import read_input
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.frame import Frame
from gpusim.optics.rendering.local_origin import local_view
from gpusim.surface.surface import Surface
from gpusim.view.content.picking import MaterialPoints, material_points

PLACE = ("x_px", "y_px")
"""Columns of points in the first picture."""
CORNERS = np.array([(0, 0), (-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
"""Of a point's square, after its middle, in distances between points."""


class Squares(NamedTuple):
    """Of the points (n,) numbered ``point`` the middle and the corners of a square on the surfaces,
    as wide as points are apart: ``places`` (n, 5)."""

    point: Long
    places: MaterialPoints


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """Fields that were measured at P points in F frames: ``columns`` (F, P) by name."""

    name: str
    camera: str
    frames: tuple[int, ...]
    columns: Mapping[str, npt.NDArray[Any]]

    @cached_property
    def fields(self) -> Fields:
        """By the names of their columns."""
        return point_fields(
            name for name, one in self.columns.items()
            if one.dtype.kind == "f" and name not in PLACE
        )  # fmt: skip

    def values(self, name: str, frame: int) -> Float:
        """(P,) in a frame, in the field's unit; NaN where nothing was measured."""
        every = self.fields[name].values(self.columns)
        here = frame in self.frames
        return np.asarray(
            every[self.frames.index(frame)] if here else np.full_like(every[0], np.nan)
        )

    def squares(self, surfaces: Sequence[Surface], camera: Camera, device: Device) -> Squares:
        """Where the points are on ``surfaces`` as the ``camera`` saw them in the first frame."""
        at = np.stack([self.columns[name][0] for name in PLACE], axis=1)
        apart = np.asarray(scipy.spatial.cKDTree(at).query(at, 2)[0])
        view = local_view(surfaces, camera, lit=False)
        column, row = np.rint(at).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < camera.width) & (row < camera.height)
        point = np.flatnonzero(inside)
        triangle = Frame(view, device).ids()[row[point], column[point]].astype(np.int64) - 1
        point, triangle = point[triangle >= 0], triangle[triangle >= 0]
        pixels = at[point, None] + float(np.median(apart[:, 1])) * CORNERS
        return Squares(point, material_points(view, surfaces, triangle, pixels))


def measured_points(path: Path) -> MeasuredPoints | None:
    """Those of a file of a measurement; None for one that isn't of points in a picture.

    Raises
    ------
    InputError
        The file is damaged.
    """
    try:
        with np.load(read_input(path).stream(), allow_pickle=False) as stored:
            (_, frames, points, names), rest = json.loads(str(stored["rest"]))
            if not {*PLACE} <= {*names} or not rest.get("cameras") or len(points) < 2:
                return None
            columns = {name: stored[name] for name in names}
        if any(one.shape != (len(frames), len(points)) for one in columns.values()):
            raise ValueError("columns of another length")
    except (
        OSError,
        EOFError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
        BadZipFile,
    ) as error:
        expected = "what a run of this scene has written"
        raise InputError(f"{path}: damaged; got {error}; expected {expected}") from None
    return MeasuredPoints(path.stem, rest["cameras"][0], tuple(frames), columns)
