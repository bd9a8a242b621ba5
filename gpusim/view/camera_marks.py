"""What is drawn while one looks through a camera of the scene: its frame, its middle, its lens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.view import View
from gpusim.optics.lens.thin_lens import Lens
from gpusim.view.overlay import Overlay, Shade, display_color
from gpusim.view.placement import Placement

__all__ = [
    "DepthOfField", "depth_of_field", "draw_distortion", "draw_image_frame", "draw_principal_point"
]  # fmt: skip

Array = npt.NDArray[np.float64]

NEARER, FARTHER = "#ff8c1a", "#3d7dff"
"""What is too near to be sharp, and too far."""
TINTS = 512
"""Colours from one to the other: they are none within the depth of field."""
LINES = 12
"""Of the distortion grid across the longer side."""


@dataclass(frozen=True)
class DepthOfField:
    """Depths between which a point is blurred to a disc of at most ``blur`` px, m; ``far`` may be
    infinite. ``focus``: the depth that is sharp."""

    near: float
    far: float
    focus: float
    blur: float

    def blur_at(self, depth: float) -> float:
        """Diameter of the disc that a point at a depth is blurred to, px."""
        return (
            self.blur * abs(1.0 / depth - 1.0 / self.focus) / (1.0 / self.near - 1.0 / self.focus)
        )

    def tint(self, view: View) -> tuple[Array, tuple[float, float], Array]:
        """Depths (T, 3), limits and colours for `gpusim.view.field_colors.FieldColors.draw`: what
        is nearer than ``near`` and what is beyond ``far`` in a colour each."""
        depth = view.vertices[view.corner, 2].astype(np.float64)
        far = min(self.far, max(float(depth.max(initial=0.0)), 2.0 * self.near))
        edge = (far - self.near) / (TINTS - 3)
        colors = np.array([display_color(NEARER), display_color(FARTHER)]).repeat(TINTS // 2, 0)
        colors[1 : -1 if far == self.far else TINTS, 3] = 0.0
        return depth, (self.near - edge, far + edge), colors

    def describe(self) -> str:
        """For people.

        Examples
        --------
        >>> from gpusim.view.camera_marks import DepthOfField
        >>> DepthOfField(0.95, 1.06, 1.0, 1.0).describe()
        'sharp within 1 px from 950 to 1060 mm, focus at 1000 mm'
        """
        far = "infinity" if np.isinf(self.far) else f"{1e3 * self.far:.4g}"
        return (
            f"sharp within {self.blur:g} px from {1e3 * self.near:.4g} to {far} mm, focus at "
            f"{1e3 * self.focus:.4g} mm"
        ).replace("infinity mm", "infinity")


def depth_of_field(camera: Camera, lens: Lens | None, blur: float = 1.0) -> DepthOfField | None:
    """The depth of field of a camera for discs of ``blur`` px; None for a pinhole.

    The disc of a point at depth d has f A |1/d - 1/s| px, with the aperture A, the focus s and the
    focal length f in px (`gpusim.optics.lens.thin_lens`).

    Examples
    --------
    >>> from gpusim.view.camera_marks import depth_of_field
    >>> camera = gs.Camera.from_lens((36, 24), 50, (3600, 2400), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> lens = gs.Lens(f_number=8.0, focal_length=0.05, focus_distance=2.0)
    >>> found = depth_of_field(camera, lens)
    >>> round(found.near, 4), round(found.far, 4)
    (1.8797, 2.1368)
    """
    if lens is None or not lens.aperture or lens.focus_distance is None:
        return None
    step = blur / (max(camera.K[0, 0], camera.K[1, 1]) * lens.aperture)
    inverse = 1.0 / lens.focus_distance
    far = 1.0 / (inverse - step) if inverse > step else float("inf")
    return DepthOfField(1.0 / (inverse + step), far, lens.focus_distance, blur)


def draw_image_frame(
    overlay: Overlay, camera: Camera, place: Placement, width: float, height: float,
    outside: Shade = "#20262ec0", border: Shade = "#ffffff",
) -> None:  # fmt: skip
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
            overlay.rectangle(x, y, wide, tall, outside)
    for x, y, wide, tall in (
        (left - 1, top - 1, right - left + 2, 1),
        (left - 1, down, right - left + 2, 1),
        (left - 1, top, 1, down - top),
        (right, top, 1, down - top),
    ):
        overlay.rectangle(x, y, wide, tall, border)


def draw_principal_point(
    overlay: Overlay, camera: Camera, place: Placement, color: Shade = "#ffb000"
) -> None:
    """A cross where the optical axis meets the image, with a gap in its middle."""
    x, y = np.floor(place.window(camera.distort(camera.K[:2, 2]))) + 0.5
    for step_x, step_y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        step = np.array([step_x, step_y])
        for shade, width in (("#00000080", 3.0), (color, 1.0)):
            overlay.line([(x, y) + 4 * step, (x, y) + 14 * step], shade, width)


def draw_distortion(
    overlay: Overlay, camera: Camera, place: Placement, color: Shade = "#40c4ffc0"
) -> float:
    """A grid of straight lines as the lens bends it; returns the largest displacement, px of the
    image, 0 for a lens that doesn't distort (nothing is drawn)."""
    if camera.lens is None:
        return 0.0
    step = max(camera.width, camera.height) / LINES
    size = np.array([camera.width, camera.height])
    middle = camera.K[:2, 2]
    first, last = -np.ceil((middle + 0.5) / step), np.ceil((size - middle) / step)
    most = 0.0
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
            overlay.line(place.window(bent), color, 1.0)
            moved = np.hypot(*(bent - ideal)[inside].T)
            most = max(most, float(moved.max(initial=0.0)))
    return most
