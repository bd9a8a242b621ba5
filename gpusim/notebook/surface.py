"""A painted surface: its regions and paints, and how it looks."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.notebook.axes import draw_faces, space_axes
from gpusim.notebook.mesh import box_rows
from gpusim.notebook.page import Picture, page
from gpusim.notebook.shading import DIRECTION, encoded, fitted_camera, painted, shaded
from gpusim.surface import Surface
from gpusim.surface.frames import face_normals

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_FACES = 300_000


def html(surface: Surface) -> str:
    """Counts, extent, paints; a picture."""
    count = np.bincount(surface.regions, minlength=len(surface.paints))
    rows = [
        ("points", f"{len(surface.points):,}"),
        ("faces", f"{len(surface.faces):,}"),
        *box_rows(np.stack([surface.points.min(axis=0), surface.points.max(axis=0)])),
    ]
    for (name, paint), faces in zip(surface.paints.items(), count, strict=True):
        plural = "" if faces == 1 else "s"
        rows.append((f"paint of {name}", f"{type(paint).__name__} ({faces:,} face{plural})"))
    small = len(surface.faces) <= _MOST_FACES
    return page(f"Surface {surface.name}", rows, [partial(_picture, surface)] if small else [])


def _picture(surface: Surface) -> Picture:
    camera = fitted_camera(surface.points, _facing(surface))
    pixels = shaded([surface], camera, painted([surface], camera))
    return Picture(f"the surface {surface.name}", pixels)


def _facing(surface: Surface) -> tuple[float, float, float]:
    """Where a camera looks to see most of a surface's front: an open one has a back."""
    normal = face_normals(surface.points, surface.faces).sum(axis=0)
    if np.linalg.norm(normal) < 1e-6 * np.ptp(surface.points, axis=0).max() ** 2:
        return DIRECTION
    front = -normal / np.linalg.norm(normal)
    x, y, z = front + 0.35 * np.asarray(DIRECTION)
    return float(x), float(y), float(z)


def plot(surface: Surface, ax: Axes | None, *, unit: str = "m", **style: Any) -> Any:
    """The faces, each region in the grey or colour of its ground, in axes of three dimensions."""
    space = space_axes(ax, unit)
    grounds = [np.broadcast_to(paint.ground, 3) for paint in surface.paints.values()]
    colours = encoded(np.array(grounds, np.float64))[surface.regions] / 255.0
    opaque = np.column_stack([colours, np.ones(len(colours))])
    draw_faces(space, surface.points, surface.faces, opaque, **style)
    return space
