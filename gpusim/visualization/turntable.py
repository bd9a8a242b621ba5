"""A camera that goes round a pivot with z up, as the mouse moves it.

At azimuth 0 it looks along +y (the front), at 90 degrees along -x (from the right); at an elevation
of 90 degrees it looks down. Moves are exact: what lies under the cursor, as deep as the pivot,
stays under it when the view is panned or zoomed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera

SIDES = {"front": (0.0, 0.0), "right": (0.5 * np.pi, 0.0), "top": (0.0, 0.5 * np.pi)}
"""Azimuth and elevation (rad) of views along an axis."""

WHEEL = 1.1
"""Of the distance, for each step of the wheel."""

SENSOR_MM = 36.0
"""Width of the sensor of a camera that is written down."""

MARGIN = 0.06
"""Of half the image, free around what `Turntable.fit` frames."""


@dataclass(frozen=True)
class Turntable:
    """A camera at ``distance`` from a ``pivot`` (3,), in the scene's unit; angles in rad.

    ``field_of_view``: of the image's height. Moves return another one.

    Examples
    --------
    >>> from gpusim.visualization.turntable import Turntable
    >>> view = Turntable(pivot=(0.0, 0.0, 1.0), distance=5.0).side("right")
    >>> view.camera(640, 480).eye.round(6) + 0.0
    array([5., 0., 1.])
    """

    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    distance: float = 1.0
    azimuth: float = 0.5
    elevation: float = 0.35
    field_of_view: float = 0.5

    @property
    def axes(self) -> Float:
        """(3, 3): the image's right, down and forward in the world, one a row."""
        (sa, ca), (se, ce) = ((np.sin(a), np.cos(a)) for a in (self.azimuth, self.elevation))
        return np.array([[ca, sa, 0.0], [sa * se, -ca * se, -ce], [-sa * ce, ca * ce, -se]])

    @property
    def eye(self) -> Float:
        """World position of the projection centre, (3,)."""
        return np.asarray(self.pivot - self.distance * self.axes[2])

    def camera(self, width: int, height: int, name: str = "view") -> Camera:
        """The camera for an image of ``width`` x ``height`` px."""
        return _camera(self, width, height, name)

    # -- moves; sizes and places in px of an image ``height`` px high, y down -----------------

    def orbit(self, dx: float, dy: float, height: float) -> Turntable:
        """Drag what is seen by (dx, dy): half a turn for the image's height."""
        turn = np.pi / height
        up = float(np.clip(self.elevation + turn * dy, -0.5 * np.pi, 0.5 * np.pi))
        azimuth = (self.azimuth - turn * dx + np.pi) % (2.0 * np.pi) - np.pi
        return replace(self, azimuth=float(azimuth), elevation=up)

    def pan(self, dx: float, dy: float, height: float) -> Turntable:
        """Drag what is seen by (dx, dy); the pivot goes with the camera."""
        right, down, _ = self.axes
        return self._at(self.pivot - self._unit(height) * (dx * right + dy * down))

    def zoom(self, steps: float, x: float, y: float, width: float, height: float) -> Turntable:
        """Go ``steps`` of the wheel away (below 0: nearer); what is at (x, y) stays there."""
        factor = WHEEL**steps
        right, down, _ = self.axes
        unit = self._unit(height)
        under = self.pivot + unit * ((x - 0.5 * width) * right + (y - 0.5 * height) * down)
        moved = self._at(under + factor * (np.asarray(self.pivot) - under))
        return replace(moved, distance=factor * self.distance)

    def side(self, name: str) -> Turntable:
        """Look along an axis: one of `SIDES`."""
        azimuth, elevation = SIDES[name]
        return replace(self, azimuth=azimuth, elevation=elevation)

    def fit(
        self, points: npt.ArrayLike, width: float, height: float,
        taken: tuple[float, float] = (0.0, 0.0),
    ) -> Turntable:  # fmt: skip
        """As near as all ``points`` (n, 3) are in the image, in this direction, but for what is
        ``taken`` of it along its right and its lower side, px.

        In closed form: each side of what is free is a plane through the eye, and the eye lies where
        the outermost points touch them; the pivot comes to the middle of the points' depths.
        """
        right, down, forward = self.axes @ np.asarray(points, np.float64).reshape(-1, 3).T
        middle = 0.5 * (forward.min() + forward.max())
        size = float(np.ptp([right, down, forward], axis=1).max())
        back, sides = 0.5 * size, []
        for across, pixels, less in ((right, width, taken[0]), (down, height, taken[1])):
            half = (1.0 - MARGIN) * 0.5 * (pixels - less)
            slope, shift = self._unit(height) / self.distance * np.array([half, -0.5 * less])
            high = float((across - (shift + slope) * forward).max())
            low = float((across - (shift - slope) * forward).min())
            back = max(back, 0.5 * (high - low) / slope + middle)
            sides.append((0.5 * (high + low), shift))
        centre = [between + shift * (middle - back) for between, shift in sides]
        moved = self._at(np.array([*centre, middle]) @ self.axes)
        # a point alone is brought to the middle
        return replace(moved, distance=back) if size > 0.0 else moved

    def of_camera(self, camera: Camera, middle: npt.ArrayLike) -> Turntable:
        """What a camera sees, without its roll and its lens's distortion; the pivot is as deep as
        ``middle`` (3,)."""
        forward = camera.camera_from_world[2, :3]
        depth = max(float((np.asarray(middle) - camera.eye) @ forward), 1e-9)
        level = np.hypot(forward[0], forward[1])
        azimuth = np.arctan2(-forward[0], forward[1])
        if level <= 1e-9:  # straight down or up: the image's right tells
            azimuth = np.arctan2(camera.camera_from_world[0, 1], camera.camera_from_world[0, 0])
        moved = replace(
            self, distance=depth, azimuth=float(azimuth),
            elevation=float(np.arctan2(-forward[2], level)),
            field_of_view=float(2.0 * np.arctan(0.5 * camera.height / camera.K[1, 1])),
        )  # fmt: skip
        return moved._at(camera.eye + depth * moved.axes[2])

    def _at(self, pivot: Float) -> Turntable:
        x, y, z = (float(v) for v in pivot)
        return replace(self, pivot=(x, y, z))

    def _unit(self, height: float) -> float:
        """Length of a pixel as deep as the pivot."""
        return 2.0 * self.distance * float(np.tan(0.5 * self.field_of_view)) / height


ISOMETRIC = Turntable(azimuth=0.25 * np.pi, elevation=float(np.arctan(np.sqrt(0.5))))
"""Looks along (-1, 1, -1): x, y and z are seen equally long."""


def camera_lines(view: Turntable, width: int, height: int, name: str = "view") -> str:
    """The same camera as a table of a scene file, to be copied there.

    Examples
    --------
    >>> from gpusim.visualization.turntable import Turntable, camera_lines
    >>> print(camera_lines(Turntable(distance=0.8, azimuth=0.0, elevation=0.0), 1200, 800))
    [[camera]]
    name = "view"
    sensor_mm = [36.0, 24.0]
    resolution_px = [1200, 800]
    focal_mm = 46.995808
    position_mm = [0.0, -800.0, 0.0]
    target_mm = [0.0, 0.0, 0.0]
    up = [0.0, 0.0, 1.0]
    """
    pitch = SENSOR_MM / width
    focal = 0.5 * height / np.tan(0.5 * view.field_of_view) * pitch
    # near the poles z doesn't tell what is up in the image
    up = [0.0, 0.0, 1.0] if abs(view.elevation) < 1.5 else [-float(v) for v in view.axes[1]]

    def mm(values: npt.ArrayLike) -> list[float]:
        return [round(1e3 * float(v), 6) + 0.0 for v in np.asarray(values)]

    return "\n".join([
        "[[camera]]",
        f'name = "{name}"',
        f"sensor_mm = {[SENSOR_MM, round(height * pitch, 9)]}",
        f"resolution_px = {[width, height]}",
        f"focal_mm = {round(float(focal), 6)}",
        f"position_mm = {mm(view.eye)}",
        f"target_mm = {mm(view.pivot)}",
        f"up = {[round(v, 9) + 0.0 for v in up]}",
    ])  # fmt: skip


@lru_cache(maxsize=4)  # several parts of a picture ask for it
def _camera(view: Turntable, width: int, height: int, name: str) -> Camera:
    f = 0.5 * height / np.tan(0.5 * view.field_of_view)
    K = np.array([[f, 0, 0.5 * (width - 1)], [0, f, 0.5 * (height - 1)], [0, 0, 1.0]])
    pose = np.eye(4)
    pose[:3, :3] = view.axes
    pose[:3, 3] = -view.axes @ view.eye
    return Camera(width, height, K, camera_from_world=pose, name=name)
