"""Figures of measurements: a rig and its points in space, its calibration; states compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.files.atomic_files import PathLike
from gpusim.report.model import Figure
from gpusim.report.style import MEASURED, MUTED, PAGE, TRUTH, axis_title, draw_png, named

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

_LABELS = ("x (mm)", "y (mm)", "z (mm)")
_MOST_CORNERS = 4000  # drawn


@dataclass(frozen=True)
class RigCamera:
    """A camera of the rig: where it is and looks (3,), and its calibration corners (N, 2) px with
    their reprojection errors; ``resolution`` (width, height) px."""

    name: str
    eye: Float
    axis: Float
    corners: Float
    errors: Float
    resolution: tuple[int, int]


def draw_reconstruction(
    rest: Float, measured: Float, true: Float, factor: float, path: PathLike
) -> Figure:
    """Points (M, 3) unloaded, and displaced as measured and as true, ``factor`` times: in space
    and in two projections."""
    there, real = rest + factor * measured, rest + factor * true

    def points_in(plot: Any, axes: list[int]) -> None:
        before, now, found = (points[:, axes].T for points in (rest, real, there))
        plot.plot(*before, ".", color=MUTED, markersize=5, label="unloaded, triangulated")
        plot.plot(*now, "-", color=TRUTH, linewidth=1.4, label="loaded, finite elements")
        plot.plot(*found, "o", color=MEASURED, markersize=4, mfc="none", label="loaded, measured")
        _label_space(plot, axes)

    def draw(canvas: Canvas) -> None:
        grid = canvas.add_gridspec(2, 2)
        space: Any = canvas.add_subplot(grid[0, :], projection="3d")
        points_in(space, [0, 1, 2])
        space.legend(loc="upper left", fontsize=8.5)
        for k, across in enumerate(([0, 2], [0, 1])):
            plot = canvas.add_subplot(grid[1, k])
            points_in(plot, across)
            axis_title(plot, ("From the front", "From above")[k])

    draw_png(path, (7.2, 8.0), draw)
    size = f" drawn {factor:g} times their length" if factor != 1 else ""
    return Figure(
        Path(path),
        "Reconstruction in space",
        f"Markers triangulated from both cameras, unloaded and loaded, displacements{size}; "
        "below, two projections.",
    )


def _label_space(plot: Any, axes: Sequence[int]) -> None:
    """Name these axes of space, lengths alike along all."""
    plot.set(**{f"{'xyz'[k]}label": _LABELS[axis] for k, axis in enumerate(axes)})
    plot.set_aspect("equal", adjustable="datalim")


def draw_rig(cameras: Sequence[RigCamera], points: Float, boards: Float, path: PathLike) -> Figure:
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
        _label_space(space, [0, 1, 2])
        space.legend(loc="upper left")

    draw_png(path, (7.2, 5.6), draw)
    caption = f"Cameras with their axes, markers, and the {len(boards)} boards of the calibration."
    return Figure(Path(path), "The rig", caption)


def draw_calibration(cameras: Sequence[RigCamera], view_rms: Float, path: PathLike) -> Figure:
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
        bars.set(xlabel="Image of the target", ylabel="RMS (px)")
        bars.legend(loc="best")
        axis_title(bars, "Reprojection error")

    draw_png(path, (7.2, 5.8), draw)
    caption = (
        f"Above: corners with their reprojection errors (RMS {typical:.4f} px), magnified; below: "
        "error of each image."
    )
    return Figure(Path(path), "Calibration", caption)


_SIZE = (7.2, 4.2)  # inches
_COLOURS = ("#0072b2", "#d55e00", "#0b8f6a", "#b0569a", "#8a6d00", "#56707f")
_MARKS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True)
class StateCurve:
    """One state: positions x (M,), values measured and true (M,), and what was found in them.

    ``breaks`` and ``sigma`` (K,) are positions of slope changes, ``damage`` (D,) the true ones;
    ``fitted_x``, ``fitted_y`` a curve through the measured values, or empty.
    """

    name: str
    x: Float
    measured: Float
    true: Float
    breaks: Float
    sigma: Float
    damage: Float
    fitted_x: Float
    fitted_y: Float


def draw_deflections(curves: Sequence[StateCurve], axes: tuple[str, str], path: PathLike) -> Figure:
    """All states' deflection lines; ``axes`` are the labels of both axes."""

    def draw(canvas: Canvas) -> None:
        plot = canvas.subplots()
        for k, curve in enumerate(curves):
            _points(plot, k, curve)
        plot.set(xlabel=axes[0], ylabel=axes[1])
        plot.legend(loc="best")
        axis_title(plot, "Deflection lines (lines: finite elements)")

    draw_png(path, _SIZE, draw)
    return Figure(
        Path(path), "Deflection lines", "Measured points on the true line, for every state."
    )


def draw_differences(
    curves: Sequence[StateCurve], axes: tuple[str, str], mm_per_px: float, path: PathLike
) -> Figure:
    """Differences to the reference, their fits and breaks, and measured minus true in px."""

    def draw(canvas: Canvas) -> None:
        upper, lower = canvas.subplots(2, 1, sharex=True, height_ratios=[2.6, 1.0])
        for k, curve in enumerate(curves):
            _points(upper, k, curve, line=False)
            upper.plot(curve.fitted_x, curve.fitted_y, color=_COLOURS[k % 6], linewidth=1.6)
            at: Float = curve.breaks
            if len(at):
                at = np.interp(at, curve.fitted_x, curve.fitted_y)
            upper.plot(curve.breaks, at, "|", color=_COLOURS[k % 6], markersize=22, mew=1.6)
            error = (curve.measured - curve.true) / mm_per_px
            lower.plot(curve.x, error, _MARKS[k % 6] + "-", color=_COLOURS[k % 6], markersize=3,
                       linewidth=0.8)  # fmt: skip
        for place in sorted({float(p) for curve in curves for p in curve.damage}):
            for plot in (upper, lower):
                plot.axvline(place, color=MUTED, linestyle=":", linewidth=1.1)
        lower.axhline(0.0, color=MUTED, linewidth=0.8)
        upper.set_ylabel(axes[1])
        upper.legend(loc="best")
        lower.set(xlabel=axes[0], ylabel="Error (px)")
        axis_title(upper, "Difference to the reference (dotted: where the damage is)")
        axis_title(lower, "Measured minus true difference")

    draw_png(path, (_SIZE[0], 5.6), draw)
    places = [
        f"{curve.name} at "
        + ", ".join(f"{p:.2f} ± {s:.1g}" for p, s in zip(curve.breaks, curve.sigma, strict=True))
        for curve in curves
        if len(curve.breaks)
    ]
    found = "; ".join(places) if places else "none"
    caption = f"Broken lines fitted to the measured differences; slope changes (mm): {found}."
    return Figure(Path(path), "Differences of the deflection lines", caption)


def _points(plot: Axes, k: int, curve: StateCurve, line: bool = True) -> None:
    colour = _COLOURS[k % 6]
    if line:
        plot.plot(curve.x, curve.true, color=colour, linewidth=1.4)
    plot.plot(
        curve.x, curve.measured, _MARKS[k % 6], markersize=4.2, markerfacecolor=PAGE,
        markeredgecolor=colour, markeredgewidth=1.2, label=curve.name,
    )  # fmt: skip
