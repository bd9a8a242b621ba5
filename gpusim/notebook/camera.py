"""A camera: its numbers, a sketch of its image, and where it stands."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.notebook.axes import flat_axes
from gpusim.notebook.page import Picture, page, quantity
from gpusim.optics.camera.pinhole import Camera
from gpusim.report.style import MEASURED, named
from gpusim.validation import require

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PLANES = {"xy": [0, 1], "xz": [0, 2], "yz": [1, 2]}
"""What is drawn to the right and up: from above, from the front, from the right."""
_SKETCH = 300  # px
_LINES = 9


def html(camera: Camera) -> str:
    """Resolution, focal length, field of view, pose, distortion; a sketch."""
    K = camera.K
    forward, point = _forward(camera), ", ".join(quantity(v, digits=6) for v in K[:2, 2])
    wide, tall = (
        2.0 * np.rad2deg(np.arctan(0.5 * side / focal))
        for side, focal in ((camera.width, K[0, 0]), (camera.height, K[1, 1]))
    )
    rows = [
        ("resolution", f"{camera.width} x {camera.height} px"),
        ("focal length fx, fy", f"{quantity(K[0, 0], digits=6)}, {quantity(K[1, 1], 'px', 6)}"),
        ("principal point cx, cy", f"{point} px"),
        ("field of view", f"{wide:.2f}° x {tall:.2f}°"),
        ("position", ", ".join(quantity(v + 0.0) for v in camera.eye)),
        ("looks along", ", ".join(quantity(v + 0.0, digits=3) for v in forward)),
        ("one pixel", f"{quantity(1.0 / K[0, 0], digits=3)} of the distance"),
    ]
    if camera.distortion is None or not np.any(camera.distortion):
        rows.append(("distortion", "none"))
    else:
        shown = np.trim_zeros(np.asarray(camera.distortion, np.float64), "b")
        rows.append(("distortion", ", ".join(quantity(v) for v in shown)))
        moved = np.linalg.norm(_grid(camera) - _grid(camera.without_distortion()), axis=2)
        rows.append(("… moves by up to", quantity(np.nanmax(moved), "px")))
    sketch = partial(_sketch, camera)
    title = "Camera" if camera.name == "camera" else f"Camera {camera.name}"
    return page(title, rows, [sketch], ["Positions are in the world's unit."])


def plot(
    camera: Camera,
    ax: Axes | None,
    *,
    plane: str = "xy",
    reach: float | None = None,
    unit: str = "m",
    **style: Any,
) -> Axes:
    """Where it stands and what it sees up to ``reach``, from above or from a side."""
    ax = flat_axes(ax)
    if reach is None:
        reach = float(np.linalg.norm(camera.eye)) or 1.0
    require(0.0 < reach < np.inf, "Camera.plot: reach", reach, "a finite length above 0")
    draw_camera(ax, camera, plane, reach, 1.0, **style)
    across, up = plane_axes(plane)
    ax.set(xlabel=f"{'xyz'[across]} ({unit})", ylabel=f"{'xyz'[up]} ({unit})", aspect="equal")
    ax.set_title(f"{named(camera.name)}, up to {quantity(reach, unit, 3)} away")
    return ax


def plane_axes(plane: str) -> list[int]:
    """The axes that are drawn to the right and up. Raises InputError for a plane that is none."""
    require(plane in _PLANES, "plot: plane", repr(plane), f"one of {list(_PLANES)}")
    return _PLANES[plane]


def draw_camera(
    ax: Axes, camera: Camera, plane: str, reach: float, scale: float, **style: Any
) -> None:
    """Draw the camera's eye, the outline of its view up to ``reach``, and its axis; lengths times
    ``scale``."""
    axes = plane_axes(plane)
    colour = style.pop("color", MEASURED)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * [camera.width, camera.height] - 0.5
    rays = np.column_stack([corners, np.ones(4)]) @ camera.ray_matrix().T
    eye, turn = camera.eye, camera.camera_from_world[:3, :3]
    far = (eye + reach * rays @ turn)[:, axes] * scale
    at, axis = eye[axes] * scale, reach * _forward(camera)[axes] * scale
    ax.fill(*_hull(np.vstack([at, far])).T, color=colour, alpha=0.12, linewidth=0)
    for end in far:
        ax.plot(*np.stack([at, end]).T, color=colour, linewidth=0.7, alpha=0.8)
    ax.plot(*np.stack([at, at + axis]).T, color=colour, linewidth=1.0, linestyle="-.")
    ax.plot(*at, "s", color=colour, **{"markersize": 6, "label": named(camera.name), **style})
    place = at[0], at[1]
    ax.annotate(named(camera.name), place, xytext=(6, 6), textcoords="offset points", color=colour)


def _forward(camera: Camera) -> Float:
    forward: Float = camera.camera_from_world[2, :3]
    return forward


def _hull(points: Float) -> Float:
    """The corners (n, 2) of the convex hull."""
    import cv2

    hull = cv2.convexHull(points.astype(np.float32))
    return np.asarray(hull, np.float64).reshape(-1, 2)


def _grid(camera: Camera) -> Float:
    """(lines, lines, 2): where the lens puts a regular grid over the image, px."""
    ideal = np.stack(
        np.meshgrid(
            np.linspace(-0.5, camera.width - 0.5, _LINES),
            np.linspace(-0.5, camera.height - 0.5, _LINES),
        ),
        axis=2,
    )
    return camera.distort(ideal)


def _sketch(camera: Camera) -> Picture:
    """The image's border, a grid as the lens shows it, and the principal point."""
    scale = _SKETCH / max(camera.width, camera.height)
    width, height = camera.width * scale, camera.height * scale
    grid = (_grid(camera) + 0.5) * scale
    lines = []
    for row in (*grid, *grid.transpose(1, 0, 2)):
        known = row[np.isfinite(row).all(axis=1)]
        lines.append(" ".join(f"{x:.1f},{y:.1f}" for x, y in known))
    drawn = "".join(f'<polyline points="{line}" stroke-opacity="0.4"/>' for line in lines)
    x, y = (camera.K[:2, 2] + 0.5) * scale
    svg = (
        f'<svg width="{width + 16:.0f}" height="{height + 16:.0f}" '
        f'viewBox="-8 -8 {width + 16:.1f} {height + 16:.1f}" fill="none" stroke="currentColor">'
        f'{drawn}<rect width="{width:.1f}" height="{height:.1f}" stroke-width="1.6"/>'
        f'<path d="M{x - 6:.1f} {y:.1f}h12M{x:.1f} {y - 6:.1f}v12" stroke="{MEASURED}" '
        'stroke-width="2"/></svg>'
    )
    caption = "Its image: a regular grid as the lens shows it, and the principal point."
    return Picture("a sketch of the image", caption=caption, svg=svg)
