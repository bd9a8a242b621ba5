"""Which triangles of a surface a camera may see, and where they look, a few thousand at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.geometry.clipping import ImagePlane, wound
from gpusim.optics.geometry.triangle_corners import CHUNK, products
from gpusim.surface.surface import Surface


@dataclass(frozen=True, eq=False)
class Culled:
    """``front`` (T,): which look at the camera; ``keep`` (T,): which may be seen; ``extent``: px,
    the longest side of a box round any of those, as far as none has a corner behind the camera."""

    front: Bool
    keep: Bool
    extent: float


def cull(
    points: Float,
    area: Callable[[], Float],
    triangles: Long,
    ideal: Float,
    ahead: Bool,
    closed: bool,
    screen: ImagePlane,
) -> Culled:
    """Of triangles (T, 3) with normals ``area()`` (3, T) and vertices at ``points`` (P, 3) in the
    world, seen at ``ideal`` (P, 2) px where they are ``ahead`` (P,).

    What is wholly behind the camera, beside the image or seen edge-on is left out, and what looks
    away if the surface is ``closed``.
    """
    count = len(triangles)
    front, keep = np.empty(count, bool), np.empty(count, bool)
    most = 0.0
    places = [np.ascontiguousarray(ideal[:, k]) for k in range(2)]
    whole = bool(ahead.all())
    if not whole:
        sides = _sides(ideal, ahead, screen)
        away = [np.ascontiguousarray(points[:, k]) - eye for k, eye in enumerate(screen.camera.eye)]
    for first in range(0, count, CHUNK):
        part = slice(first, first + CHUNK)
        corner = [triangles[part, k] for k in range(3)]
        if whole:
            at = [[np.take(place, own, mode="clip") for own in corner] for place in places]
            # the image shows which way they are wound; `split` would find lines later, with more
            # to carry
            front[part], seen = wound(*at)
            np.logical_not(seen, out=seen)
            sizes = []
            for (a, b, c), least, greatest in zip(at, screen.low, screen.high, strict=True):
                low, high = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
                if not (high.min() > least and low.max() < greatest):
                    seen &= (high > least) & (low < greatest)
                sizes.append(np.subtract(high, low, out=high))
        else:
            from_eye = [np.take(column, corner[0], mode="clip") for column in away]
            front[part] = products(area()[:, part], from_eye) < 0.0
            seen = (sides[corner[0]] & sides[corner[1]] & sides[corner[2]]) == 0
            seen &= ahead[corner[0]] | ahead[corner[1]] | ahead[corner[2]]
            sizes = []
        if closed:
            seen &= front[part]
        every = bool(seen.all())
        for size in sizes:
            most = max(most, float((size if every else size * seen).max()))
        keep[part] = seen
    return Culled(front, keep, most)


def _sides(ideal: Float, ahead: Bool, screen: ImagePlane) -> npt.NDArray[np.uint8]:
    """(P,): a bit for every side of the image that a vertex is beside; one behind the camera is on
    no side."""
    sides = np.zeros(len(ideal), np.uint8)
    for axis in range(2):
        value = ideal[:, axis]
        sides |= (value <= screen.low[axis]).view(np.uint8) << np.uint8(2 * axis)
        sides |= (value >= screen.high[axis]).view(np.uint8) << np.uint8(2 * axis + 1)
    sides *= ahead.view(np.uint8)
    return sides


def wound_inwards(surfaces: Sequence[Surface], camera: Camera) -> tuple[str, ...]:
    """A warning for each closed surface that is wound inwards around no camera.

    A room that holds the camera is wound inwards rightly: its walls face it.
    """
    result = []
    for surface in surfaces:
        if not surface.inside_out:
            continue
        low, high = surface.points.min(axis=0), surface.points.max(axis=0)
        if not ((low <= camera.eye) & (camera.eye <= high)).all():
            result.append(
                f"surface {surface.name!r} is closed and its faces are wound inwards: the camera "
                "outside sees the far walls' inside, unlit; expected vertices counter-clockwise "
                "seen from outside: turn the faces round (faces[:, ::-1] for triangles)"
            )
    return tuple(dict.fromkeys(result))
