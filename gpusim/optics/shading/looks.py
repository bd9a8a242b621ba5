"""What small triangles on plain paint and on chessboards look like, found on the device.

Which triangles a board's lines pass, and the albedo of all others, follows from their own vertices.
With hundreds of thousands of triangles finding it on the host takes as long as the device takes to
light them. What depends on the largest pixel of all (the cells in which patterns are filed) is made
for half as much again as the largest of some thousand triangles has; the device tells whether that
was too little, and the image is begun again where it was.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, compare
from gpusim.optics.camera.undistortion_table import distortion_map
from gpusim.optics.geometry.pixel_footprint import footprint_columns, footprint_sizes
from gpusim.optics.geometry.triangle_corners import ST
from gpusim.optics.geometry.view import View
from gpusim.optics.paint.checker_fields import MARGIN
from gpusim.optics.paint.checker_lines import LEAST
from gpusim.optics.raster.triangle_records import Records
from gpusim.optics.shading.setup import Setup
from gpusim.surface.paint import Checker

__all__ = ["Looks", "check_looks", "looks_twin", "sampled"]

Array = npt.NDArray[np.float64]

FEWEST = 2000
"""Triangles of a view from which on the device is asked."""

SAMPLED = 4096
"""Triangles of which the largest pixel is found beforehand."""

EVEN = 1.5
"""Largest pixel over that which `USUAL` of the triangles have at most, up to which others may be
guessed; and what all may have over the largest that was found. Where a surface turns away from the
camera largest pixels are far from all others."""

USUAL = 0.99

NONE = np.array([0, 1, 1, 0, 0, 0], np.uint32)
"""Of `Looks.groups` before any triangle was looked at."""

SURE = 0.98
"""Of the largest pixel there may be, what float32 takes for smaller."""

ENDLESS = 1e9
"""Fields either way of a board that has no end."""


def sampled(view: View) -> View | None:
    """A view in which the largest pixel on each board follows from some triangles.

    ``view`` has boards and plain paint only. None where triangles are few, or a few pixels on
    boards much larger than all others, or than boards are drawn with.
    """
    if view.count < FEWEST or view.found is not None:
        return None
    some = np.arange(0, view.count, max(view.count // SAMPLED, 1))
    sizes, paint_of = footprints(view, some), view.paint[some]
    paints = []
    for number, region in enumerate(view.regions):
        paint = region.paint
        if isinstance(paint, Checker) and float((region.high - region.low).max()) > 0.0:
            own = sizes[paint_of == number]
            if not len(own) or not float(own.max()) <= EVEN * float(np.quantile(own, USUAL)):
                return None
            region = replace(region, reach=EVEN * float(own.max()))
            if not paint.size > LEAST * region.reach:
                return None
        paints.append(region)
    return replace(view, found=(tuple(paints), np.zeros(view.count)), guessed=True)


def footprints(view: View, triangles: npt.NDArray[np.int64]) -> Array:
    """Half of the largest pixel (n,) on each of some triangles of a view, in paint coordinates, by
    what the lens stretches pixels at most."""
    bends = distortion_map(view.camera)
    own = view.some(triangles)
    columns = footprint_columns(own.table.shown, own.ideal_place)
    sizes = footprint_sizes(columns, own.corner)
    return sizes if bends is None else bends.stretch * sizes


class Looks:
    """Albedo and nearness to lines of a view's triangles, which the device writes into ``looks``.

    ``looks``: those of the records. ``lined``: numbers + 1 of the triangles near lines; ``groups``:
    how many groups of 64 they fill, 1, 1, how many they are, 1 if a pixel is larger than the
    view's paints say, and 1 if a triangle lies over others where none should. ``constants``: of a
    program for those; ``params``: uniforms of the shader that finds them.
    """

    def __init__(self, setup: Setup, records: Records, counts: Buffer | None = None) -> None:
        """``counts``: ``groups`` in which the device has begun to tell of the view."""
        view, device = setup.view, records.device
        boards = _boards(setup)
        self.looks = records.looks
        paint = view.paint.view(np.uint32)
        self._paint = device.buffer(paint if len(boards) > 1 else paint[:1], "looks.paint")
        self._boards = device.texels(3 * len(boards), "rgba32float", "looks.boards")
        self._boards.write(boards.astype(np.float32).reshape(-1, 4))
        self.lined = device.empty(4 * view.count, "looks.lined")
        self.groups = counts or device.buffer(NONE, "looks.groups")
        self.constants = {
            **setup.constants(setup.groups_present(), False, False), "light_tiled": 0.0,
            "board": float(boards[:, 0, 3].any()),
        }  # fmt: skip
        bends = distortion_map(view.camera)
        self.params = {
            "last": self._paint.nbytes // 4 - 1, "margin": MARGIN,
            "stretch": 1.0 if bends is None else bends.stretch,
        }  # fmt: skip

    def bindings(self) -> dict[str, Any]:
        """What the shader reads and writes besides the records' vertices and looks."""
        return {
            "order": self._paint, "boards": self._boards, "lined": self.lined,
            "counts": self.groups,
        }  # fmt: skip

    @property
    def surprised(self) -> bool:
        """Whether a pixel is larger than the view's paints say, or the view isn't the layer that it
        was taken for; waits for the device."""
        return bool(self.groups.read(np.uint32, (6,))[4:].any())


def _boards(setup: Setup) -> Array:
    """(paints, 3, 4): the paints as the shader reads them."""
    result = np.zeros((len(setup.view.paints), 3, 4))
    result[:, 0, 2] = setup.table.paints["ground"]
    for number, region in enumerate(setup.view.paints):
        paint = region.paint
        if isinstance(paint, Checker) and setup.table.paints["featured"][number] == 1:
            result[number, 0] = paint.size, SURE * region.reach, paint.ground, 1.0
            for axis, many in enumerate((paint.columns, paint.rows)):
                limits = (-ENDLESS, ENDLESS) if many is None else (0.0, many)
                result[number, 1, axis] = paint.origin[axis]
                result[number, 1, 2 + axis], result[number, 2, axis] = limits
            result[number, 2, 2:] = paint.dark, paint.light
    return result


def looks_twin(setup: Setup) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.float32], Array]:
    """Which triangles (T,) are near a line of their board, the albedo (T,) of all others, and how
    far (T,) they are from being told otherwise, in largest half pixels."""
    view = setup.view
    near, slack = np.zeros(view.count, bool), np.full(view.count, np.inf)
    albedo = setup.table.paints["ground"].astype(np.float32)[view.paint]
    sizes = footprints(view, np.arange(view.count))
    for number, region in enumerate(view.paints):
        paint = region.paint
        rows = np.flatnonzero(view.paint == number)
        if not isinstance(paint, Checker) or setup.table.paints["featured"][number] != 1:
            continue
        st = np.moveaxis(view.corners_of(rows)[:, :, ST], 2, 0)
        half = sizes[rows, None]
        fields, beside = [], np.zeros(st.shape[1:], int)
        close, away = np.zeros(st.shape[1:], bool), np.full(st.shape[1:], np.inf)
        for axis, many in enumerate((paint.columns, paint.rows)):
            turn = (st[axis] - paint.origin[axis]) / paint.size
            ends = (-np.inf, np.inf) if many is None else (0, many)
            line, before = np.clip(np.rint(turn), *ends), np.floor(turn)
            gap = np.abs(turn - line) * paint.size
            by = gap <= MARGIN * half
            for k, out in enumerate((before < ends[0], before >= ends[1])):
                beside[out & ~by] = 1 + 2 * axis + k
            close |= by
            away = np.minimum(away, np.abs(gap / half - MARGIN))
            fields.append(np.clip(before, ends[0] - 1, ends[1]))
        # there are no lines
        close &= beside == 0
        for field in fields:
            field[beside > 0] = np.inf
        same = [(v == v[:, :1]).all(axis=1) for v in (*fields, beside)]
        near[rows] = close.any(axis=1) | ~np.logical_and.reduce(same)
        slack[rows] = away.min(axis=1)
        with np.errstate(invalid="ignore"):
            odd = (fields[0] + fields[1])[:, 0] % 2.0 == 1.0
        plain = np.where(odd, paint.light, paint.dark)
        plain = np.where(beside[:, 0] > 0, paint.ground, plain)
        albedo[rows] = np.where(near[rows], albedo[rows], plain)
    return near, albedo, slack


def check_looks(setup: Setup, looks: Looks) -> None:
    """Compare what the device has found with the twin; part of the check of
    optics/shading/glance."""
    words = looks.looks.read(np.uint32, (setup.view.count, 2))
    near, albedo, slack = looks_twin(setup)
    # float32 may see those at the limit either way
    sure = slack > 1e-2
    found = words[:, 1] >> np.uint32(31)
    compare("optics/shading/glance, near", found[sure], near[sure].astype(np.uint32), "exact")
    plain = sure & ~near
    compare(
        "optics/shading/glance, albedo", words[plain, 0].view(np.float32), albedo[plain], "exact"
    )
    paint = setup.view.paint.astype(np.uint32)
    compare("optics/shading/glance, paint", words[:, 1] & np.uint32(0x7FFFFFFF), paint, "exact")
    listed = np.zeros(len(near), np.uint32)
    numbers = looks.lined.read(np.uint32)
    listed[numbers[numbers > 0] - 1] = 1
    compare("optics/shading/glance, listed", listed, found, "exact")
