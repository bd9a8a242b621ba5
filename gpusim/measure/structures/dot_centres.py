"""Round dots: their centres by grey-value moments, and what perspective does to them.

A pixel's grey value is the mean over its square, so the first moment of what a dot takes from its
surroundings is the dot's own, whatever the blur. Divided by the surroundings' brightness, a slope
of the light doesn't move it either.

The image of a circle is an ellipse (nearly, behind a lens with distortion), whose centre isn't the
image of the circle's centre: Heikkila, "Geometric camera calibration using circular control
points", IEEE Trans. PAMI 22 (2000). `circle_centres` takes that off where camera and plane are
known.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int
from gpusim.field_summary import field_summary
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.measure.images import check_image, check_points
from gpusim.measure.stereo.plane_mapping import plane_mapping
from gpusim.measure.stereo.triangulation import project
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

RIM = 3  # px around a dot that blur and pixels reach …
RING = 3  # … and of its surroundings beyond
MIN_CONTRAST = 0.08  # of the image's grey range
MIN_ROUNDNESS = (
    0.1  # of a dot stretched to a circle: its harmonics of order 3 and 4; 0.43 for a square
)
MIN_SHARE = 0.5  # of the ring that has to be free
MIN_CORE = 9  # px that tell a slope
RADII, TURNS = 8, 24  # samples over a disc
ROUNDS = 8


@dataclass(frozen=True)
class Dots:
    """M dots, row by row from the top left.

    Attributes
    ----------
    points : (M, 2) float64, centres of their images x, y, px.
    axes : (M, 2) float64, full widths of the ellipses, the longer one first, px.
    angle : (M,) float64, direction of the longer one, rad in [-pi/2, pi/2), from +x to +y (down).
    contrast : (M,) float64, grey levels from a dot to its surroundings, below 0 for bright dots.

    Examples
    --------
    >>> dots = gs.measure.find_dots(gs.export.read_image("dots.png"), size_px=(6, 20))
    >>> dots.points[0].round(1), dots.axes[0].round(1)
    (array([47.5, 43.5]), array([10., 10.]))
    """

    points: Float
    axes: Float
    angle: Float
    contrast: Float
    __repr__ = field_summary


@unmasked("image")
@one_blas_thread()
def find_dots(image: npt.NDArray[Any], size_px: tuple[float, float], *, dark: bool = True) -> Dots:
    """Find every dot whose widths lie in ``size_px`` = (lowest, highest), at least 5 px.

    Dots stand free, by 6 px or more; they are darker than what is around them, or, with ``dark``
    False, brighter. Centres are good to 0.003 px on 8-bit images under even light, to 0.01 px with
    noise of a grey level.

    Raises
    ------
    InputError
        Not a grey image, or wrong sizes.

    Examples
    --------
    >>> len(gs.measure.find_dots(gs.export.read_image("dots.png"), size_px=(6, 20)).points)
    6
    """
    array = check_image(image, "image")
    low, high = float(size_px[0]), float(size_px[1])
    require(5 <= low <= high < np.inf, "size_px", size_px, "(lowest, highest) width, at least 5 px")
    grey = array.astype(np.float64)
    span = float(np.ptp(grey))
    rows: list[tuple[float, ...]] = []
    if span > 0:
        labels, boxes = _components(grey if dark else -grey, high, span)
        for number, box in boxes:
            ellipse = _dot(grey, labels, number, box, low, high)
            if ellipse is not None and (ellipse[5] if dark else -ellipse[5]) >= MIN_CONTRAST * span:
                rows.append(ellipse)
    rows.sort(key=lambda dot: (round(dot[1] / high), dot[0]))
    table = np.array(rows, dtype=np.float64).reshape(-1, 6)
    return Dots(table[:, :2], table[:, 2:4], table[:, 4], table[:, 5])


@unmasked()
@one_blas_thread()
def circle_centres(
    points: npt.ArrayLike, camera: CalibratedCamera, camera_from_plane: npt.ArrayLike, radius: float
) -> Float:
    """Images of circles' centres (M, 2) px, from the centres ``points`` of the circles' images.

    The circles of ``radius`` lie in z = 0 of the frame that ``camera_from_plane`` (4, 4) places,
    in its unit. Perspective and the lens's distortion are taken into account. Raises InputError for
    wrong shapes, or a plane that the camera looks along.

    Examples
    --------
    >>> camera = gs.measure.rig_camera((160, 120), [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]])
    >>> plane = np.eye(4)
    >>> plane[2, 3] = 1.0
    >>> gs.measure.circle_centres([[80.0, 60.0]], camera, plane, radius=0.005).round(3)
    array([[80., 60.]])
    """
    seen = check_points(points, "points")
    require(0 < radius < np.inf, "radius", repr(radius), "a length above 0")
    on_plane = plane_mapping(camera, camera_from_plane)
    pose = np.asarray(camera_from_plane, dtype=np.float64)
    # nodes that integrate polynomials over a disc exactly: equal areas in the radius' square
    nodes, weights = np.polynomial.legendre.leggauss(RADII)
    turn = 2 * np.pi * np.arange(TURNS) / TURNS
    length = radius * np.sqrt(0.5 * (nodes + 1.0))
    disc = np.stack([np.outer(length, np.cos(turn)), np.outer(length, np.sin(turn))], axis=-1)
    share = np.repeat(weights, TURNS)
    centre = seen.copy()
    for _ in range(ROUNDS):
        place = on_plane(centre)
        around = place[:, None, :] + disc.reshape(-1, 2)
        image = _projected(camera, pose, around)
        # an image's area per area of the plane, by differences along both axes
        step = 1e-4 * radius
        by_x, by_y = (
            (_projected(camera, pose, around + d) - _projected(camera, pose, around - d))
            for d in (np.array([step, 0.0]), np.array([0.0, step]))
        )
        area = share * np.abs(by_x[..., 0] * by_y[..., 1] - by_x[..., 1] * by_y[..., 0])
        mean = (area[..., None] * image).sum(axis=1) / area.sum(axis=1)[:, None]
        off = _projected(camera, pose, place[:, None, :])[:, 0] - mean
        moved = seen + off - centre
        centre = seen + off
        if not np.abs(moved).max() > 1e-9:
            break
    return centre


def _projected(camera: CalibratedCamera, pose: Float, places: Float) -> Float:
    """Pixels (…, 2) of places (…, 2) on the plane."""
    flat = places.reshape(-1, 2)
    space = np.column_stack([flat, np.zeros(len(flat))])
    return project(replace(camera, camera_from_rig=pose), space)[0].reshape(places.shape)


def _components(
    grey: Float, high: float, span: float
) -> tuple[Int, list[tuple[int, tuple[int, int, int, int]]]]:
    """Connected parts darker than around them, as labels, and those of a likely size with boxes."""
    side = 2 * int(1.5 * high + RIM) + 1
    mean = cv2.blur(grey, (side, side), borderType=cv2.BORDER_REFLECT)
    below = (grey < mean - 0.5 * MIN_CONTRAST * span).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(below, connectivity=4)
    boxes = []
    for number in range(1, count):
        x, y, width, height = (int(v) for v in stats[number, :4])
        if max(width, height) <= high + 4 and min(width, height) >= 3:
            boxes.append((number, (x, y, width, height)))
    return np.asarray(labels, dtype=np.int32), boxes


def _dot(
    grey: Float,
    labels: Int,
    number: int,
    box: tuple[int, int, int, int],
    low: float,
    high: float,
) -> tuple[float, ...] | None:
    """Centre, axes, angle and contrast of a part; None if it isn't a free ellipse of that size."""
    x0, y0, width, height = box
    pad = RIM + RING
    x0, y0, x1, y1 = x0 - pad, y0 - pad, x0 + width + pad, y0 + height + pad
    if x0 < 0 or y0 < 0 or x1 > grey.shape[1] or y1 > grey.shape[0]:
        return None
    window, part = grey[y0:y1, x0:x1], labels[y0:y1, x0:x1]
    mine = (part == number).astype(np.uint8)
    others = ((part > 0) & (part != number)).astype(np.uint8)
    wide, wider = (cv2.dilate(mine, _disc(r)) > 0 for r in (RIM, pad))
    ring = wider & ~wide
    free = ring & ~(cv2.dilate(others, _disc(RIM)) > 0)
    if not np.count_nonzero(free) >= MIN_SHARE * np.count_nonzero(ring):
        return None
    places = np.indices(window.shape, dtype=np.float64)
    y, x = places[0], places[1]
    level = _brightness(window, x, y, free, cv2.erode(mine, _disc(2 * RIM)) > 0)
    if not (level[wide] > 0).all():
        return None
    taken = np.where(wide, 1.0 - window / level, 0.0)
    total = float(taken.sum())
    cx, cy = float((taken * x).sum() / total), float((taken * y).sum() / total)
    dx, dy = x - cx, y - cy
    second = [float((taken * a * b).sum() / total) for a, b in ((dx, dx), (dx, dy), (dy, dy))]
    values, vectors = np.linalg.eigh(np.array([second[:2], second[1:]]))
    # a pixel's own square adds 1/12 px^2
    axes = 4.0 * np.sqrt(np.maximum(values[::-1] - 1.0 / 12.0, 1e-12))
    if not (low <= axes[1] and axes[0] <= high):
        return None
    # as a circle, whatever the blur, a dot looks the same from all sides
    spread = np.sqrt(np.maximum(values, 1e-12))
    circle = [(vectors[0, k] * dx + vectors[1, k] * dy) / spread[k] for k in (0, 1)]
    z = circle[0] + 1j * circle[1]
    for order in (3, 4):
        around = np.abs((taken * z**order).sum()) / np.abs((taken * np.abs(z) ** order).sum())
        if not around <= MIN_ROUNDNESS:
            return None
    inside = (dx**2 + dy**2) <= (0.25 * axes[1]) ** 2
    depth = float(np.mean(taken[inside]))
    angle = float(np.arctan2(vectors[1, 1], vectors[0, 1]))
    angle -= np.pi * np.round(angle / np.pi)
    contrast = depth * float(np.mean(level[inside]))
    return cx + x0, cy + y0, float(axes[0]), float(axes[1]), angle, contrast


def _brightness(
    window: Float,
    x: Float,
    y: Float,
    free: Bool,
    core: Bool,
) -> Float:
    """Brightness of the surroundings, a plane through the pixels that are ``free``.

    Dark ones tell less of the light's slope than a bright dot's own ``core``, which then counts as
    far as it is the brighter one: noise is the same in both, and the slope goes by the brightness.
    """
    middle = float(x[free].mean()), float(y[free].mean())
    plane = np.stack([np.ones_like(x), x - middle[0], y - middle[1]], axis=-1)
    fitted = np.linalg.lstsq(plane[free], window[free], rcond=None)[0]
    if np.count_nonzero(core) >= MIN_CORE and window[core].mean() > window[free].mean() > 0:
        known, sums = np.zeros((2, 2)), np.zeros(2)
        for part in (free, core):
            terms = plane[part]
            mean, across = terms.mean(axis=0), float(window[part].mean())
            slopes = terms[:, 1:] - mean[1:]
            known += across**2 * slopes.T @ slopes
            sums += across * slopes.T @ window[part]
        slope = np.linalg.solve(known, sums)
        fitted = fitted[0] * np.array([1.0, *slope])
    return np.asarray(plane @ fitted)


def _disc(radius: int) -> npt.NDArray[np.uint8]:
    return np.asarray(
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)),
        dtype=np.uint8,
    )
