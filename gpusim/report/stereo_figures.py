"""Figures of a stereo measurement: the rig, points in space with two projections, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.files.atomic_files import PathLike
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, MUTED, TRUTH, Margins, axis_title, draw_png, named

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["RigCamera", "draw_calibration", "draw_reconstruction", "draw_rig"]

Floats = npt.NDArray[np.float64]
_LABELS = ("x (mm)", "y (mm)", "z (mm)")
_MOST_CORNERS = 4000  # drawn


@dataclass(frozen=True)
class RigCamera:
    """A camera of the rig: where it is and looks (3,), and its calibration corners (N, 2) px with
    their reprojection errors; ``resolution`` (width, height) px."""

    name: str
    eye: Floats
    axis: Floats
    corners: Floats
    errors: Floats
    resolution: tuple[int, int]


def draw_reconstruction(
    rest: Floats, measured: Floats, true: Floats, factor: float, path: PathLike
) -> Figure:
    """Points (M, 3) unloaded, and displaced as measured and as true, ``factor`` times: in space
    and in two projections."""
    there, real = rest + factor * measured, rest + factor * true

    def draw(canvas: Canvas) -> None:
        grid = canvas.add_gridspec(2, 2)
        space: Any = canvas.add_subplot(grid[0, :], projection="3d")
        space.plot(*rest.T, ".", color=MUTED, markersize=5, label="unloaded, triangulated")
        space.plot(*real.T, "-", color=TRUTH, linewidth=1.4, label="loaded, finite elements")
        space.plot(
            *there.T, "o", color=MEASURED, markersize=4, mfc="none", label="loaded, measured"
        )
        space.set(xlabel=_LABELS[0], ylabel=_LABELS[1], zlabel=_LABELS[2])
        space.legend(loc="upper left", fontsize=8.5)
        space.set_aspect("equal", adjustable="datalim")
        for k, (a, b) in enumerate(((0, 2), (0, 1))):
            plot = canvas.add_subplot(grid[1, k])
            plot.plot(rest[:, a], rest[:, b], ".", color=MUTED, markersize=5)
            plot.plot(real[:, a], real[:, b], "-", color=TRUTH, linewidth=1.4)
            plot.plot(there[:, a], there[:, b], "o", color=MEASURED, markersize=4, mfc="none")
            plot.set(xlabel=_LABELS[a], ylabel=_LABELS[b])
            plot.set_aspect("equal", adjustable="datalim")
            axis_title(plot, ("From the front", "From above")[k])

    draw_png(path, (7.2, 8.0), draw, Margins(left=0.8, top=0.1))
    size = f" drawn {factor:g} times their length" if factor != 1 else ""
    return Figure(
        Path(path),
        "Reconstruction in space",
        f"Markers triangulated from both cameras, unloaded and loaded, displacements{size}; "
        "below, two projections.",
    )


def draw_rig(
    cameras: Sequence[RigCamera], points: Floats, boards: Floats, path: PathLike
) -> Figure:
    """Where the cameras stand, the markers (M, 3), and every calibration board (V, 4, 3)."""

    def draw(canvas: Canvas) -> None:
        space: Any = canvas.add_subplot(1, 1, 1, projection="3d")
        for board in boards:
            if np.isfinite(board).all():
                space.plot(*board[[0, 1, 2, 3, 0]].T, color=MUTED, linewidth=0.7)
        space.plot(*points.T, ".", color=TRUTH, markersize=5, label="markers")
        reach = 0.25 * float(np.linalg.norm(cameras[0].eye - np.nanmean(points, axis=0)))
        for camera in cameras:
            end = camera.eye + reach * camera.axis
            space.plot(*np.stack([camera.eye, end]).T, color=MEASURED, linewidth=1.6)
            space.plot(*camera.eye[:, None], "s", color=MEASURED, markersize=6)
            space.text(*camera.eye, f"  {named(camera.name)}")
        space.set(xlabel=_LABELS[0], ylabel=_LABELS[1], zlabel=_LABELS[2])
        space.set_aspect("equal", adjustable="datalim")
        space.legend(loc="upper left")

    draw_png(path, (7.2, 5.6), draw, Margins(0.1, 0.1, 0.1, 0.1))
    caption = f"Cameras with their axes, markers, and the {len(boards)} boards of the calibration."
    return Figure(Path(path), "The rig", caption)


def draw_calibration(cameras: Sequence[RigCamera], view_rms: Floats, path: PathLike) -> Figure:
    """Where corners were seen with their errors as arrows, and each view's RMS (C, V)."""
    lengths = np.concatenate([np.linalg.norm(c.errors, axis=1) for c in cameras])
    typical = float(np.sqrt(np.mean(lengths**2))) if lengths.size else 0.0

    def draw(canvas: Canvas) -> None:
        count = len(cameras)
        # one grid for all: plots of two grids are laid out without regard for one another
        grid = canvas.add_gridspec(2, count)
        for k, camera in enumerate(cameras):
            plot = canvas.add_subplot(grid[0, k])
            step = max(1, len(camera.corners) // _MOST_CORNERS)
            at, error = camera.corners[::step], camera.errors[::step]
            plot.quiver(*at.T, *error.T, angles="xy", scale_units="width",
                        scale=max(25.0 * typical, 1e-12), width=0.002, color=MEASURED)  # fmt: skip
            plot.plot(*at.T, ".", color=TRUTH, markersize=1.2)
            plot.set_xlim(0, camera.resolution[0])
            plot.set_ylim(camera.resolution[1], 0)
            plot.set_aspect("equal")
            axis_title(plot, named(camera.name))
        bars = canvas.add_subplot(grid[1, :])
        for k, (camera, rms) in enumerate(zip(cameras, view_rms, strict=True)):
            place = np.arange(len(rms)) + 0.8 * (k / count) - 0.4
            bars.bar(place, rms, width=0.8 / count, align="edge", label=named(camera.name))
        bars.set_xlabel("Image of the target")
        bars.set_ylabel("RMS (px)")
        bars.legend(loc="best")
        axis_title(bars, "Reprojection error")

    draw_png(path, (7.2, 5.8), draw)
    caption = (
        f"Above: corners with their reprojection errors (RMS {typical:.4f} px), magnified; below: "
        "error of each image."
    )
    return Figure(Path(path), "Calibration", caption)
