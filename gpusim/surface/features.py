"""What the renderer needs of a paint: a ground albedo, the shapes on it, and its fine relief.

Relief is orange peel of paint, grain of concrete, scratches of brushed steel. A stationary Gaussian
relief is a sum of plane waves through the material (Longuet-Higgins, "The statistical analysis of a
random, moving surface", 1957), of which the mean slope over a pixel has a closed form: there is
nothing to alias. The waves go through the body, not along its faces, so that nothing smears on
curved faces or is cut at edges, and they move with the material.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, Protocol

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Float, Int
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.surface.color import Color, Colored, grey
from gpusim.validation import Rule, Share, checked, positive, require

PATCH, DISC, SECTOR = range(3)  # kinds of features
WAVES = 32
PERIOD = 1024.0
"""Correlation lengths after which the relief repeats, so that float32 holds every phase."""

STEEPEST = 0.35
_START = np.array([0.975, 0.701, 0.337, 0.5])


@dataclass(frozen=True)
class Features:
    """The shapes of a pattern, as arrays over F features, in paint coordinates.

    ``kind`` 0 is a checker patch with its first corner at ``position`` (F, 2), turned by ``angle``
    (rad), ``squares`` (F, 2) columns x rows of ``size`` (F, 2); even squares have ``albedo[:, 0]``.
    ``kind`` 1 is a disc centred at ``position`` with radius ``size[:, 0]`` and ``albedo[:, 0]``.
    ``kind`` 2 is the sector of such a disc from ``angle`` on, ``squares[:, 0]`` (rad, at most pi)
    wide.

    Features keep apart, or have a ``layer`` (F,): those of layer 0 keep apart, others lie within
    them. One that lies on another adds to it: its albedo is that of the ground plus the change that
    it makes (see `Stack`). ``covers`` (F,), by default 1 on layer 0 and 0 above, is what a feature
    adds to the share of the ground that prints hide; a glossy ground shines through the rest.

    Examples
    --------
    >>> dots = gs.paint.Dots(diameter=0.004, pitch=0.01, columns=3, rows=2)
    >>> features = dots.features(np.array([0.0, 0.0]), np.array([0.03, 0.02]))
    >>> features.kind, features.position.shape
    (array([1, 1, 1, 1, 1, 1], dtype=int32), (6, 2))
    """

    kind: Int
    position: Float
    angle: Float
    size: Float
    squares: Float
    albedo: Float
    layer: Int | None = None
    covers: Float | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        if self.covers is None:
            lowest = np.zeros(len(self.kind)) if self.layer is None else self.layer
            object.__setattr__(self, "covers", (lowest == 0).astype(np.float64))

    @staticmethod
    def alike(
        kind: int,
        position: Float,
        size: npt.ArrayLike,
        albedo: npt.ArrayLike,
        *,
        angle: float = 0.0,
        squares: npt.ArrayLike = 1.0,
    ) -> Features:
        """Features of one ``kind`` at ``position`` (n, 2), all else equal or one for each."""
        angles = np.full(len(position), angle)
        pairs = [
            np.array(np.broadcast_to(v, position.shape), float) for v in (size, squares, albedo)
        ]
        return Features(np.full(len(position), kind, np.int32), position, angles, *pairs)

    def __len__(self) -> int:
        return len(self.kind)

    def bounds(self) -> tuple[Float, Float]:
        """Lower and upper corners (F, 2) of the axis-parallel boxes around the features."""
        extent = self.size * self.squares
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        corners = []
        for i, j in ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)):
            x, y = i * extent[:, 0], j * extent[:, 1]
            corners.append(np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1))
        box = np.stack(corners)
        low = np.where(self.kind[:, None] == 0, box.min(axis=0), -self.size)
        high = np.where(self.kind[:, None] == 0, box.max(axis=0), self.size)
        return self.position + low, self.position + high

    @property
    def extent(self) -> Float:
        """Sides (F, 2) of patches, radii of round features."""
        return np.where(self.kind[:, None] == 0, self.size * self.squares, self.size)


class Stack:
    """Collects features that lie on one another, each with what it covers."""

    def __init__(self, ground: Color) -> None:
        self.ground = grey(ground)
        self._rows: list[Float] = []

    def add(
        self,
        kind: int,
        position: Float,
        size: npt.ArrayLike,
        albedo: Color,
        under: Color,
        layer: int,
        *,
        angle: npt.ArrayLike = 0.0,
        width: npt.ArrayLike = 1.0,
        covers: float | None = None,
    ) -> None:
        """Patches with first corners, or discs or sectors with centres, ``position`` (n, 2).

        ``size``: sides ((2,), (n, 2)) or radius; ``angle``: by which patches are turned, or from
        which sectors of ``width`` (rad) go on; ``covers``: where it isn't 1 on layer 0 and 0 above.
        """
        row = np.zeros((len(position), 10))
        row[:, 0], row[:, 1:3], row[:, 3] = kind, position, angle
        row[:, 4:6], row[:, 6], row[:, 8] = size, width, layer
        row[:, 7] = self.ground + grey(albedo) - grey(under)
        row[:, 9] = float(layer == 0) if covers is None else covers
        self._rows.append(row)

    def features(self) -> Features:
        """All of them."""
        rows = np.concatenate([np.zeros((0, 10)), *self._rows])
        squares = np.ones((len(rows), 2))
        squares[:, 0] = rows[:, 6]
        return Features(
            rows[:, 0].astype(np.int32), rows[:, 1:3], rows[:, 3], rows[:, 4:6], squares,
            np.repeat(rows[:, 7:8], 2, axis=1), rows[:, 8].astype(np.int32), rows[:, 9],
        )  # fmt: skip


class Paint(Protocol):
    """What the renderer needs of a paint.

    One with colours says so by a property ``colored`` that is True, and has a method ``in_band(k)``
    that gives the grey paint of red, green or blue (0, 1, 2), the same object at each call; it is
    that one's features which are asked for. A paint without these is grey.

    Examples
    --------
    >>> def bare(paint: gs.paint.Paint) -> float:
    ...     return paint.ground
    >>> bare(gs.paint.Plain(0.5))
    0.5
    >>> red_wall = gs.paint.Plain([0.6, 0.2, 0.1])
    >>> red_wall.colored, bare(red_wall.in_band(0))
    (True, 0.6)
    """

    @property
    def ground(self) -> Color:
        """Albedo where no feature lies."""
        ...

    def features(self, low: Float, high: Float) -> Features | None:
        """The features for a region with paint coordinates from ``low`` to ``high`` (2,)."""
        ...


Length = Annotated[float, positive("a length above 0")]
Angle = Annotated[float, Rule("a finite angle in rad", np.isfinite)]
Place = Annotated[
    tuple[float, float], Rule("two finite numbers", lambda place: bool(np.isfinite(place).all()))
]
"""(s, t)."""


def set_centres(paint: Any) -> None:
    """Make the ``centres`` of a paint an array (M, 2). Raises InputError for another shape."""
    places = np.asarray(paint.centres, np.float64)
    fits = places.ndim == 2 and places.shape[1] == 2 and np.isfinite(places).all()
    require(fits, f"{type(paint).__name__} centres", f"shape {places.shape}", "finite (M, 2)")
    object.__setattr__(paint, "centres", places)


@checked
@dataclass(frozen=True)
class Bump:
    """A relief of ``height`` (RMS) whose correlation falls to 1/e over ``length``.

    Both in the unit of the surface's points. ``along`` (x, y, z), in the undeformed frame: the
    direction in which it is ``stretch`` times longer, as where steel was brushed. Reliefs with
    different ``seed`` have nothing to do with each other. What a pixel doesn't resolve makes gloss
    rougher. The relief turns normals only: outlines, depth and shadows are those of the smooth
    surface.

    Raises
    ------
    InputError
        Lengths that aren't positive, a direction without length, or slopes beyond 0.35 RMS, where
        parts of a relief would hide and light each other.

    Examples
    --------
    >>> print(f"{gs.paint.Bump(height=2e-6, length=5e-4).slope:.5f}")
    0.00566
    """

    height: Length
    length: Length
    along: tuple[float, float, float] | None = None
    stretch: Annotated[float, Rule("1 to 1e4", lambda value: 1.0 <= value <= 1e4)] = 1.0
    seed: Annotated[int, Rule("a whole number from 0 on", lambda value: value >= 0)] = 0

    def __post_init__(self) -> None:
        if self.along is not None:
            size = np.linalg.norm(np.asarray(self.along, np.float64))
            fits = np.shape(self.along) == (3,) and 0.0 < size < np.inf
            require(fits, "Bump along", self.along, "a direction (x, y, z)")
        elif self.stretch != 1.0:
            raise InputError(f"Bump stretch; got {self.stretch} without along; expected both")
        got = f"{self.height:g} over a length of {self.length:g}, RMS slope {self.slope:.3g}"
        expected = f"slopes up to {STEEPEST}: a fine relief"
        require(self.slope <= STEEPEST, "Bump height", got, expected)

    @property
    def slope(self) -> float:
        """RMS slope in any one direction on the surface, across ``along``."""
        return float(np.sqrt(2.0) * self.height / self.length)

    def unit(self) -> Float:
        """(3, 3): from undeformed coordinates to those in which the relief is isotropic and
        correlated over 1."""
        result = np.eye(3) / self.length
        if self.along is not None:
            axis = np.asarray(self.along, np.float64)
            axis /= np.linalg.norm(axis)
            result -= (1.0 - 1.0 / self.stretch) / self.length * np.outer(axis, axis)
        return result

    def shift(self) -> Float:
        """(3,) in the unit coordinates: where in the one relief of all seeds this one lies."""
        place = np.random.Generator(np.random.Philox(self.seed)).uniform(0.0, PERIOD, 3)
        return np.asarray(place, np.float64)

    def heights(self, points: npt.ArrayLike) -> Float:
        """Height of the relief (n,) at undeformed points (n, 3)."""
        at = np.asarray(points, np.float64) @ self.unit().T + self.shift()
        waves = bump_waves()
        total = np.cos(at @ waves[:, :3].T + waves[:, 3]).sum(axis=1)
        return np.asarray(self.height * np.sqrt(2.0 / WAVES) * total)


@dataclass(frozen=True, eq=False, kw_only=True)
class Pattern(Colored):
    """Base of paints that are features on a ground, whose ``roughness``, ``metallic`` and ``bump``
    are said by name and mean what they do for `gpusim.surface.paint.Plain`."""

    roughness: Share = 1.0
    metallic: Share = 0.0
    bump: Bump | None = None
    __repr__ = field_summary


@cache
def bump_waves() -> Float:
    """(`WAVES`, 4): wave vectors and phases of the relief of unit correlation length.

    Gaussian wave vectors of variance 2 along each axis, as the correlation exp(-r^2) has them,
    spread evenly, and rounded to whole periods over `PERIOD`.
    """
    # Roberts' R4 sequence, by the root of x^5 = x + 1, from where it has the correlation best
    root = float(np.real(np.roots([1.0, 0.0, 0.0, 0.0, -1.0, -1.0])[np.newaxis]).max())
    spread = (_START + np.outer(np.arange(1, WAVES + 1), root ** -np.arange(1.0, 5.0))) % 1.0
    normal = scipy.special.ndtri(spread[:, :3])
    # a wave and its negative are the same
    moment = normal.T @ normal / WAVES
    whitened = normal @ np.linalg.inv(np.linalg.cholesky(moment)).T
    step = 2.0 * np.pi / PERIOD
    vectors = np.rint(np.sqrt(2.0) * whitened / step) * step
    result = np.concatenate([vectors, 2.0 * np.pi * spread[:, 3:]], axis=1)
    result.setflags(write=False)
    return result
