"""Figures of a stereo measurement: the rig, points in space with two projections, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpusim.export.files import PathLike
from gpusim.report.chart import draw_chart
from gpusim.report.model import Figure
from gpusim.report.panel import Floats, Panel
from gpusim.report.space import flat, space_panel
from gpusim.report.style import MEASURED, MUTED, TRUTH

__all__ = ["RigCamera", "draw_calibration", "draw_reconstruction", "draw_rig"]

_LABELS = ("x (mm)", "y (mm)", "z (mm)")
_MOST_CORNERS = 4000  # drawn
_COLOURS = (TRUTH, MEASURED, "#0b8f6a", "#b0569a")
_TYPICAL = 0.04  # of a picture's width: how long an error of the usual size is drawn


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
    space = space_panel(np.concatenate([rest, real, there]), "mm")
    panels = [space]
    for k, (a, b) in enumerate(((0, 2), (0, 1))):
        name = ("From the front", "From above")[k]
        panels.append(Panel(name, _LABELS[a], _LABELS[b], equal=True))
    places = (flat, *((lambda p, a=a, b=b: (p[:, a], p[:, b])) for a, b in ((0, 2), (0, 1))))
    for panel, place in zip(panels, places, strict=True):
        words = panel is space
        panel.line(*place(real), TRUTH, label="loaded, finite elements" if words else "")
        panel.marks(*place(rest), MUTED, ".", 2.5,
                    label="unloaded, triangulated" if words else "")  # fmt: skip
        panel.marks(*place(there), MEASURED, "o", 4.0, inside=None,
                    label="loaded, measured" if words else "")  # fmt: skip
    draw_chart(path, (7.2, 8.0), [[space], panels[1:]])
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
    reach = 0.25 * float(np.linalg.norm(cameras[0].eye - np.nanmean(points, axis=0)))
    eyes = np.stack([camera.eye for camera in cameras])
    seen = boards[np.isfinite(boards).all(axis=(1, 2))]
    space = space_panel(np.concatenate([points, eyes, seen.reshape(-1, 3)]), "mm")
    for board in seen:
        space.line(*flat(board[[0, 1, 2, 3, 0]]), MUTED, 0.7)
    space.marks(*flat(points), TRUTH, ".", 2.5, label="markers")
    for camera in cameras:
        space.line(*flat(np.stack([camera.eye, camera.eye + reach * camera.axis])), MEASURED, 1.6)
        space.marks(*flat(camera.eye[None]), MEASURED, "s", 6.0, inside=MEASURED)
        x, y = flat(camera.eye)
        space.note(float(x), float(y), camera.name, ahead=8.0)
    draw_chart(path, (7.2, 5.6), [[space]])
    caption = f"Cameras with their axes, markers, and the {len(boards)} boards of the calibration."
    return Figure(Path(path), "The rig", caption)


def draw_calibration(cameras: Sequence[RigCamera], view_rms: Floats, path: PathLike) -> Figure:
    """Where corners were seen with their errors as arrows, and each view's RMS (C, V)."""
    lengths = np.concatenate([np.linalg.norm(c.errors, axis=1) for c in cameras])
    typical = float(np.sqrt(np.mean(lengths**2))) if lengths.size else 0.0
    plots = []
    bars = Panel("Reprojection error", "Image of the target", "RMS (px)", whole=True)
    count = len(cameras)
    for k, (camera, rms) in enumerate(zip(cameras, view_rms, strict=True)):
        width, height = camera.resolution
        plot = Panel(camera.name, x_range=(0.0, width), y_range=(0.0, height), equal=True,
                     downwards=True, rows=5)  # fmt: skip
        step = max(1, len(camera.corners) // _MOST_CORNERS)
        at = camera.corners[::step]
        end = at + camera.errors[::step] * (_TYPICAL * width / max(typical, 1e-12))
        x, y = (np.stack([at[:, i], end[:, i]], axis=1) for i in range(2))
        plot.segments(x, y, MEASURED, 0.5)
        plot.marks(at[:, 0], at[:, 1], TRUTH, ".", 0.9)
        plots.append(plot)
        place = np.arange(len(rms)) + 0.8 * (k / count) - 0.4
        sides = np.stack([place, np.zeros(len(rms)), place + 0.8 / count, rms], axis=1)
        bars.bars(sides[np.isfinite(sides).all(axis=1)], _COLOURS[k % 4], camera.name)
    draw_chart(path, (7.2, 5.8), [plots, [bars]])
    caption = (
        f"Above: corners with their reprojection errors (RMS {typical:.4f} px), magnified; below: "
        "error of each image."
    )
    return Figure(Path(path), "Calibration", caption)
