"""What is drawn while one looks through a camera of the scene: its frame, its middle, its lens."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View
from gpusim.view.content.depth_of_field import DepthOfField
from gpusim.visualization.overlay import Overlay, display_color
from gpusim.visualization.placement import Placement

NEARER, FARTHER = "#ff8c1a", "#3d7dff"
"""What is too near to be sharp, and too far."""
OUTSIDE, MIDDLE, GRID = "#20262ec0", "#ffb000", "#40c4ffc0"
"""Beside the image, of the principal point, of the distortion grid."""
TINTS = 512
"""Colours from one to the other: they are none within the depth of field."""
LINES = 12
"""Of the distortion grid across the longer side."""


def defocus_tint(sharp: DepthOfField, view: View) -> tuple[Float, tuple[float, float], Float]:
    """Depths (T, 3), limits and colours for
    `gpusim.visualization.field_colors.draw_field_colors`: what is nearer than a depth of field and
    what is beyond it in a colour each."""
    depth = view.vertices[view.corner, 2].astype(np.float64)
    far = min(sharp.far, max(float(depth.max(initial=0.0)), 2.0 * sharp.near))
    edge = (far - sharp.near) / (TINTS - 3)
    colors = np.array([display_color(NEARER), display_color(FARTHER)]).repeat(TINTS // 2, 0)
    colors[1 : -1 if far == sharp.far else TINTS, 3] = 0.0
    return depth, (sharp.near - edge, far + edge), colors


def draw_image_frame(
    overlay: Overlay, camera: Camera, place: Placement, width: float, height: float
) -> None:
    """Darken a window of ``width`` x ``height`` px round a camera's image, and draw its border."""
    left, top = round(place.x), round(place.y)
    right = round(place.x + place.scale * camera.width)
    down = round(place.y + place.scale * camera.height)
    for x, y, wide, tall in (
        (0, 0, width, top),
        (0, down, width, height - down),
        (0, top, left, down - top),
        (right, top, width - right, down - top),
    ):
        if wide > 0 and tall > 0:
            overlay.rectangle(x, y, wide, tall, OUTSIDE)
    for x, y, wide, tall in (
        (left - 1, top - 1, right - left + 2, 1),
        (left - 1, down, right - left + 2, 1),
        (left - 1, top, 1, down - top),
        (right, top, 1, down - top),
    ):
        overlay.rectangle(x, y, wide, tall, "white")


def draw_principal_point(overlay: Overlay, camera: Camera, place: Placement) -> None:
    """A cross where the optical axis meets the image, with a gap in its middle."""
    x, y = np.floor(place.window(camera.distort(camera.K[:2, 2]))) + 0.5
    for step_x, step_y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        step = np.array([step_x, step_y])
        for shade, width in (("#00000080", 3.0), (MIDDLE, 1.0)):
            overlay.line([(x, y) + 4 * step, (x, y) + 14 * step], shade, width)


def draw_distortion(overlay: Overlay, camera: Camera, place: Placement) -> None:
    """A grid of straight lines as the lens bends it; nothing for one that doesn't distort."""
    if camera.lens is None:
        return
    step = max(camera.width, camera.height) / LINES
    size = np.array([camera.width, camera.height])
    middle = camera.K[:2, 2]
    first, last = -np.ceil((middle + 0.5) / step), np.ceil((size - middle) / step)
    fine = 24
    for axis in (0, 1):
        along = np.arange(fine * first[axis], fine * last[axis] + 1) * step / fine + middle[axis]
        for number in np.arange(first[1 - axis], last[1 - axis] + 1):
            ideal = np.empty((len(along), 2))
            ideal[:, axis], ideal[:, 1 - axis] = along, number * step + middle[1 - axis]
            bent = camera.distort(ideal)
            with np.errstate(invalid="ignore"):
                inside = ((bent >= -0.5) & (bent <= size - 0.5)).all(axis=1)
            bent[~inside] = np.nan
            overlay.line(place.window(bent), GRID, 1.0)
