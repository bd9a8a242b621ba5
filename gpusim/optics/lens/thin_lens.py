"""The lens: thin-lens depth of field by lens positions, point spread, vignetting.

A thin lens of aperture A (focal length / f-number) that is focused at s images a point at depth d
into a disc of diameter fx A |1/d - 1/s| px. With fx times the pixel's pitch the image distance
f s / (s - f), that is f^2 |d - s| / (N d (s - f)) on the sensor. The image is the mean over
pinhole cameras at points of the aperture, each with the principal point moved so that the plane at
s stays where it is; every one of them is integrated exactly over its pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.lens.psf import Psf, edge_profile
from gpusim.validation import Portion, Positive, Rule, checked, require, within


@checked
@dataclass(frozen=True, eq=False)
class Vignetting:
    """The product of what is given.

    Parameters
    ----------
    cos4 : the natural law, cos^4 of the angle between a pixel's ray in image space and the axis.
    polynomial : (a1, a2, …) of 1 + a1 r^2 + a2 r^4 + …, r = 1 at half the image's diagonal from
        the principal point.
    map : (rows, columns) measured gains, corners on the corner pixels' centres, linear between.

    Examples
    --------
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> gains = gs.Vignetting(cos4=True).gains(camera, row0=0, rows=4)
    >>> gains.shape, bool(gains[0, 0] < gains[2, 3])
    ((4, 6), True)
    """

    cos4: bool = True
    polynomial: tuple[float, ...] = ()
    map: Float | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        finite = np.isfinite(np.asarray(self.polynomial, np.float64)).all()
        require(finite, "Vignetting polynomial", self.polynomial, "numbers")
        if self.map is not None:
            gains = np.asarray(self.map, np.float64)
            fits = gains.ndim == 2 and min(gains.shape) >= 2 and (gains >= 0.0).all()
            got = f"shape {gains.shape}"
            require(fits, "Vignetting map", got, "at least 2 x 2 gains from 0")
            object.__setattr__(self, "map", gains)

    def gains(self, camera: Camera, row0: int, rows: int) -> Float:
        """(rows, width) factors of rows ``row0`` … of an image."""
        x = np.arange(camera.width, dtype=np.float64)
        y = np.arange(row0, row0 + rows, dtype=np.float64)[:, None]
        result = np.ones((rows, camera.width))
        K = camera.K
        if self.cos4:
            v = (y - K[1, 2]) / K[1, 1]
            u = (x - K[0, 2] - K[0, 1] * v) / K[0, 0]
            result /= (1.0 + u * u + v * v) ** 2
        if self.polynomial:
            half = 0.25 * (camera.width**2 + camera.height**2)
            square = ((x - K[0, 2]) ** 2 + (y - K[1, 2]) ** 2) / half
            result *= np.polynomial.polynomial.polyval(square, [1.0, *self.polynomial])
        if self.map is not None:
            down = (self.map.shape[0] - 1) / max(camera.height - 1, 1)
            across = (self.map.shape[1] - 1) / max(camera.width - 1, 1)
            at = np.broadcast_arrays(y * down, x * across)
            result *= scipy.ndimage.map_coordinates(self.map, at, order=1, mode="nearest")
        if not result.min() >= 0.0:
            raise InputError("Vignetting: its gain falls below 0 inside the image")
        return result


SHARP = 0.05
"""px; a blur diameter below this is left out."""
ONE_DEPTH = 0.01
"""px; where blur diameters differ by no more, one disc serves for all."""
COUNTS = (8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
GOLDEN = np.pi * (3.0 - np.sqrt(5.0))


@checked
@dataclass(frozen=True)
class Lens:
    """What a lens does to the image of a pinhole camera; lengths in world units.

    Parameters
    ----------
    psf : `Gaussian`, `Airy`, `Disc`, `MeasuredPsf` or any `Psf`; None for a perfect lens.
    fill_factor : light-sensitive share of a pixel's area, a square in its middle.
    f_number, focal_length, focus_distance : depth of field; all three or none. The focus distance
        is along the optical axis from the centre of projection.
    blades : of the iris, 0 for a round one; ``blade_angle`` (rad) turns it.
    vignetting : fall-off towards the corners.
    positions : lens positions, unless the error asked for decides.
    samples_per_px : render cells along a pixel for the point spread, n, unless the error decides:
        the centroid of what is w px wide is then off by up to 1 / (8 w n^2) px.

    Examples
    --------
    >>> gs.Lens(f_number=8.0, focal_length=0.05, focus_distance=1.0).aperture
    0.00625
    """

    psf: Psf | None = None
    fill_factor: Portion = 1.0
    f_number: Positive | None = None
    focal_length: Positive | None = None
    focus_distance: Positive | None = None
    blades: Annotated[
        int, Rule("0 (round) or 3 to 24", lambda count: count == 0 or 3 <= count <= 24)
    ] = 0
    blade_angle: float = 0.0
    vignetting: Vignetting | None = None
    positions: Annotated[int, within(1, 4096)] | None = None
    samples_per_px: int | None = None

    def __post_init__(self) -> None:
        require(isinstance(self.psf, Psf | None), "Lens psf", repr(self.psf), "a Psf")
        given = {key: getattr(self, key) for key in ("f_number", "focal_length", "focus_distance")}
        missing = [key for key, value in given.items() if value is None]
        if missing and len(missing) < 3:
            raise InputError(f"Lens; got no {missing}; expected all of {list(given)}, or none")
        if not missing and not given["focus_distance"] > given["focal_length"]:
            raise InputError(
                f"Lens focus_distance; got {self.focus_distance}; expected more than the focal "
                f"length {self.focal_length}"
            )

    @property
    def aperture(self) -> float:
        """Diameter of the aperture, 0 for a pinhole."""
        if self.focal_length is None or self.f_number is None:
            return 0.0
        return self.focal_length / self.f_number

    @property
    def spread(self) -> bool:
        """Whether pixels differ from plain squares behind a perfect lens."""
        return self.psf is not None or self.fill_factor != 1.0


@dataclass(frozen=True, eq=False)
class Focus:
    """How depth of field is rendered.

    ``points`` (L, 2): lens positions in world units, camera axes; one at the centre if all is
    sharp or one disc serves. ``disc`` px: radius of that disc, or 0. ``largest`` px: the largest
    blur diameter in view. ``edge_error``: RMS of a full-contrast edge at that diameter.
    """

    points: Float
    disc: float
    largest: float
    edge_error: float


def aperture_points(count: int, blades: int = 0, angle: float = 0.0) -> Float:
    """``count`` points (about as many for an iris with blades) spread evenly over the unit disc.

    A sunflower (Vogel 1979), moved and stretched so that its mean is the centre and its second
    moments are those of the aperture: the image isn't shifted, and its blur is as wide as it
    should be, at any count. An iris is the polygon whose corners lie on the circle.
    """
    if count == 1:
        return np.zeros((1, 2))
    if not blades:
        points = _sunflower(count)
        moment = np.eye(2) / 4.0
    else:
        share = 0.5 * blades * np.sin(2.0 * np.pi / blades) / np.pi
        points = _sunflower(round(count / share))
        points = points[_in_polygon(points, blades, angle)]
        dense = _sunflower(20_000)
        moment = np.cov(dense[_in_polygon(dense, blades, angle)].T, bias=True)
    points = points - points.mean(axis=0)
    own = np.linalg.cholesky(np.cov(points.T, bias=True))
    result: Float = points @ np.linalg.inv(own).T @ np.linalg.cholesky(moment).T
    return result


def _sunflower(count: int) -> Float:
    k = np.arange(count)
    r, phi = np.sqrt((k + 0.5) / count), k * GOLDEN
    return np.stack([r * np.cos(phi), r * np.sin(phi)], axis=1)


def _in_polygon(points: Float, blades: int, angle: float) -> Bool:
    sector = 2.0 * np.pi / blades
    phi = (np.arctan2(points[:, 1], points[:, 0]) - angle) % sector - 0.5 * sector
    inside = np.hypot(points[:, 0], points[:, 1]) * np.cos(phi) <= np.cos(0.5 * sector)
    return np.asarray(inside)


def edge_error(points: Float, diameter: float, psf: Psf | None = None, side: float = 1.0) -> float:
    """RMS error of a full-contrast edge blurred by ``points`` x diameter / 2, at its worst angle.

    Against an even disc of that diameter, over the blur and a pixel on either side; the pixel's
    own square of ``side`` and the point spread are part of both.
    """
    radius = 0.5 * diameter
    x = np.linspace(-radius - 1.0, radius + 1.0, 201)
    reach = 2.0 * radius + 1.0
    grid = np.linspace(-reach, reach, 801)
    profile = edge_profile(psf, side, grid)
    u = np.linspace(-radius, radius, 1001)
    density = np.sqrt(np.maximum(radius**2 - u**2, 0.0))
    density /= density.sum()
    worst = 0.0
    want = np.interp(x[:, None] - u[None, :], grid, profile) @ density
    for angle in np.pi * np.arange(6) / 12.0:
        at = radius * (points @ [np.cos(angle), np.sin(angle)])
        got = np.interp(x[:, None] - at[None, :], grid, profile).mean(axis=1)
        worst = max(worst, float(np.sqrt(np.mean((got - want) ** 2))))
    return worst


def focus_of(lens: Lens, camera: Camera, depths: Float, tolerance: float) -> Focus:
    """Lens positions for what lies at ``depths`` (n,); points behind the camera don't count."""
    centre = np.zeros((1, 2))
    z = depths[depths > 0.0]
    if not lens.aperture or not len(z):
        return Focus(centre, 0.0, 0.0, 0.0)
    assert lens.focus_distance is not None
    per_px = max(camera.K[0, 0], camera.K[1, 1]) * lens.aperture
    signed = per_px * (1.0 / z - 1.0 / lens.focus_distance)
    low, high = float(signed.min()), float(signed.max())
    largest = max(abs(low), abs(high))
    if not largest > SHARP:
        return Focus(centre, 0.0, largest, 0.0)
    square = abs(camera.K[0, 0] / camera.K[1, 1] - 1.0) <= 1e-3 and camera.K[0, 1] == 0.0
    if high - low <= ONE_DEPTH and not lens.blades and square and lens.positions is None:
        return Focus(centre, 0.25 * abs(low + high), largest, 0.0)
    if lens.positions is not None:
        unit = aperture_points(lens.positions, lens.blades, lens.blade_angle)
        return Focus(0.5 * lens.aperture * unit, 0.0, largest, edge_error(unit, largest, lens.psf))
    error = np.inf
    side = float(np.sqrt(lens.fill_factor))
    for count in COUNTS:
        error = edge_error(aperture_points(count), largest, lens.psf, side)
        if error <= tolerance:
            break
    unit = aperture_points(count, lens.blades, lens.blade_angle)
    return Focus(0.5 * lens.aperture * unit, 0.0, largest, error)


def seen_through(camera: Camera, point: Float, focus_distance: float) -> Camera:
    """The camera at ``point`` (2,) of the lens, its image of the plane of focus unmoved.

    A ray is distorted by where it would meet the plane of focus, as if from the lens' centre: the
    distortion keeps its own principal point.
    """
    T = camera.camera_from_world.copy()
    T[:2, 3] -= point
    K = camera.K.copy()
    K[:2, 2] += K[:2, :2] @ point / focus_distance
    return replace(camera, K=K, camera_from_world=T, lens_K=camera.distorting_K)
