"""A lamp's light space, the frame in which what hides it is looked for.

p = x / w and q = y / w lie across the lamp's axis and s = 1 / w along it. The lamp's plane lies at
infinity: a ray from a receiver X to the point l of the lamp runs along p = p_X + l (s - s_X). That
of a far lamp has x and y themselves and s the distance towards it. A lamp that shines all round has
one space, or two where it is inside the scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Real
from gpusim.optics.light.quadrature import Lamp
from gpusim.optics.shadow.sample_mask import lamp_masks

TOLERANCE = 2e-6
"""A face begins no shadow nearer to its plane than this times the distance from the eye."""

ROUNDING = 2.0**-21
"""Of the largest coordinate, by which float32 moves a length: some units in the last place."""

BEGIN = 1e-5
"""Of the largest coordinate, from the lamp's plane: nearer to it p and q are without limit."""

AROUND = 0.05
"""Cosine between directions to vertices and the middle of all, above which one space has all."""

SAMPLE = 1000
"""Vertices, about, that tell how a space is turned."""

UNLIMITED, ANGLE = 1e18, 1e-6
"""As in ``shaders/optics/shadow/light_space.wgsl``."""


@dataclass(frozen=True, eq=False)
class LightSpace:
    """One half space before a lamp.

    ``lamp``: its centre is relative to the eye. ``across``, ``along`` and ``axis``: unit vectors;
    ``half``: half the lamp's size along the first two. ``scale``: the largest coordinate of the
    scene or the lamp, relative to the eye. ``number`` of the lamp. ``terminator``: sine by which
    receivers' normals may turn away from the lamp without being dark, as normals for shading do.
    ``sheets``: bits of open surfaces whose border winds once at most round any ray to the lamp.
    """

    lamp: Lamp
    number: int
    across: Float
    along: Float
    axis: Float
    half: tuple[float, float]
    scale: float
    terminator: float = 0.0
    sheets: int = 0

    @property
    def centre(self) -> Float:
        """(3,), zero of a far lamp."""
        return np.zeros(3) if self.lamp.far else self.lamp.centre

    @property
    def rounding(self) -> float:
        """Length by which float32 moves places."""
        return ROUNDING * self.scale

    @property
    def on_face(self) -> float:
        """Distance below a face within which a near lamp lies on it, and isn't hidden by it."""
        return 4.0 * self.rounding

    @property
    def begin(self) -> float:
        """Distance before the lamp's plane at which the space begins."""
        return BEGIN * self.scale

    def ahead(self, x: Float) -> Float:
        """(n,): distance of points (n, 3) along the axis."""
        return np.asarray((x - self.centre) @ self.axis)

    def place(self, x: Float) -> Float:
        """(n, 3): p, q and s of points (n, 3)."""
        y = x - self.centre
        beside = np.stack([y @ self.across, y @ self.along], axis=1)
        w = y @ self.axis
        if self.lamp.far:
            return np.column_stack([beside, -w])
        s = 1.0 / np.maximum(w, 1e-3 * self.begin)
        return np.column_stack([beside * s[:, None], s])

    def rounding_at(self, place: Float) -> Float:
        """(n, 3): how far rounding moves places (n, 3) of the space."""
        if self.lamp.far:
            return np.full(place.shape, self.rounding)
        result = np.ones_like(place)
        result[:, :2] += np.abs(place[:, :2])
        result[:, 2] = place[:, 2]
        return self.rounding * place[:, 2:] * result

    def planes(self, planes: Float) -> Float:
        """(n, 4): planes (n, 4), unit normal and offset, as functions of p, q, s and 1. The third
        is how high the lamp's middle is over each."""
        u, v, a = (planes[:, :3] @ way for way in (self.across, self.along, self.axis))
        if self.lamp.far:
            return np.stack([u, v, -a, -planes[:, 3]], axis=1)
        return np.stack([u, v, planes[:, :3] @ self.centre - planes[:, 3], a], axis=1)

    def extent(self, planes: Float) -> Float:
        """(n,): how much the height of the lamp's points over `planes` (n, 4) differs from that of
        its middle at most."""
        u, v = np.abs(planes[:, :2]).T
        return np.asarray(self.half[0] * u + self.half[1] * v)

    def asks(self, x: Float, normal: Float) -> Bool:
        """(n,): which receivers at (n, 3) are before the lamp and turned to it."""
        planes = self.planes(np.column_stack([normal, np.sum(normal * x, axis=1)]))
        height = planes[:, 2] + self.extent(planes)
        if self.lamp.far:
            return np.asarray(height > -self.terminator)
        away = np.linalg.norm(x - self.centre, axis=1)
        # what lies between a lamp's two spaces is before both
        return np.asarray((self.ahead(x) >= 0.0) & (height > -self.terminator * away))

    def uniform(self) -> dict[str, object]:
        """As ``LightSpace`` of the shaders."""
        return {
            "centre": np.array([*self.centre, 0.0 if self.lamp.far else 1.0]),
            "across": np.array([*self.across, self.half[0]]),
            "along": np.array([*self.along, self.half[1]]),
            "axis": np.array([*self.axis, self.begin]),
            "rounding": self.rounding,
            "tolerance": TOLERANCE,
            "terminator": self.terminator,
            "number": self.number,
            "sheets": self.sheets,
        }

    def face(self) -> dict[str, object]:
        """As ``LampFace`` of the shaders."""
        lamp, masks = self.lamp, lamp_masks(self.lamp)
        across = lamp.u if lamp.extended else self.across
        return {
            "centre": np.array([*lamp.centre, 0.0 if lamp.far else 1.0]),
            "u": np.array([*across, float(lamp.extended)]),
            "v": np.array([*lamp.v, 0.0]),
            "mask": masks.reshape(4, 4),
        }


def lamp_numbers(spaces: Sequence[LightSpace]) -> list[int]:
    """The lamps that ``spaces`` are of, ascending."""
    return sorted({space.number for space in spaces})


def light_spaces(lamps: Sequence[Lamp], points: Real, eye: Float) -> list[LightSpace]:
    """The spaces of all ``lamps`` that cast shadows; ``points`` (V, 3 or more): vertices, relative
    to the ``eye``; see `LightSpace`."""
    result = []
    places = points[:, :3]
    box = _box(places) if len(places) else np.zeros((2, 3))
    size = float(np.abs(box).max())
    for number, lamp in enumerate(lamps):
        if not lamp.light.shadows:
            continue
        lamp = lamp.relative_to(eye)
        scale = max(size, float(np.abs(lamp.centre).max()) if not lamp.far else 0.0, 1e-30)
        if lamp.extended:
            half = float(np.linalg.norm(lamp.u)), float(np.linalg.norm(lamp.v))
            frame = lamp.u / half[0], lamp.v / half[1], lamp.axis
            result.append(LightSpace(lamp, number, *frame, half, scale))
            continue
        for axis in _axes(lamp, places, box):
            across, along = _beside(lamp, axis, places)
            frame = across, along, axis
            result.append(LightSpace(lamp, number, *frame, (0.0, 0.0), scale))
    return result


def _box(points: Real) -> Float:
    """(2, 3): ends of the box round ``points`` (V, 3), one at least."""
    # in long rows: NumPy takes twenty times as long for those of three
    even = len(points) // 64 * 64
    wide, rest = points[:even].reshape(-1, 192), points[even:]
    low = np.append(wide.min(axis=0, initial=np.inf), rest).reshape(-1, 3).min(axis=0)
    high = np.append(wide.max(axis=0, initial=-np.inf), rest).reshape(-1, 3).max(axis=0)
    return np.array([low, high], np.float64)


def _axes(lamp: Lamp, points: Real, box: Float) -> list[Float]:
    """The ways that a lamp without size looks: one or, from inside the scene, two; ``box`` as
    `_box` finds it."""

    def ahead(way: Real) -> bool:
        along = way @ axis.astype(way.dtype)
        return bool((along > AROUND * np.sqrt(np.einsum("va,va->v", way, way))).all())

    if np.any(lamp.axis):
        return [lamp.axis]
    some = points[:: max(len(points) // SAMPLE, 1)].astype(np.float64) - lamp.centre
    length = np.linalg.norm(some, axis=1)
    mean = (some / np.where(length > 0.0, length, 1.0)[:, None]).mean(axis=0)
    size = float(np.linalg.norm(mean))
    axis = mean / size if size > AROUND else np.array([0.0, 0.0, 1.0])
    # what is ahead is convex
    corners = np.array(list(product(*box.T))) - lamp.centre
    if ahead(some) and (ahead(corners) or ahead(points - lamp.centre.astype(points.dtype))):
        return [axis]
    return [axis, -axis]


def _beside(lamp: Lamp, axis: Float, points: Real) -> tuple[Float, Float]:
    """Unit vectors across an ``axis`` and each other: the first is that along which the scene is
    longest, so that boxes around what is built in lines are small."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    across = np.cross(axis, helper)
    across /= np.linalg.norm(across)
    along = np.cross(axis, across)
    some = points[:: max(len(points) // SAMPLE, 1)].astype(np.float64)
    if not lamp.far:
        some = some - lamp.centre
        ahead = some @ axis
        near = ahead > AROUND * np.linalg.norm(some, axis=1)
        some = some[near] / ahead[near, None]
    if len(some) > 1:
        places = np.stack([some @ across, some @ along])
        x, y = np.linalg.eigh(np.cov(places))[1][:, -1]
        across = x * across + y * along
    return across, np.cross(axis, across)
