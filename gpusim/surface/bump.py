"""Fine relief of a surface: orange peel of paint, grain of concrete, scratches of brushed steel.

A stationary Gaussian relief is a sum of plane waves through the material (Longuet-Higgins, "The
statistical analysis of a random, moving surface", 1957), of which the mean slope over a pixel has a
closed form: there is nothing to alias. The waves go through the body, not along its faces, so that
nothing smears on curved faces or is cut at edges, and they move with the material.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.errors import InputError
from gpusim.validation import checked

__all__ = ["PERIOD", "WAVES", "Bump", "bump_waves"]

Array = npt.NDArray[np.float64]
WAVES = 32
PERIOD = 1024.0
"""Correlation lengths after which the relief repeats, so that float32 holds every phase."""

STEEPEST = 0.35
_START = np.array([0.975, 0.701, 0.337, 0.5])


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

    height: float
    length: float
    along: tuple[float, float, float] | None = None
    stretch: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        for name, value in (("height", self.height), ("length", self.length)):
            if not 0.0 < value < np.inf:
                raise InputError(f"Bump {name}; got {value}; expected a length above 0")
        if not 1.0 <= self.stretch <= 1e4:
            raise InputError(f"Bump stretch; got {self.stretch}; expected 1 to 1e4")
        if self.along is not None:
            size = np.linalg.norm(np.asarray(self.along, np.float64))
            if np.shape(self.along) != (3,) or not 0.0 < size < np.inf:
                raise InputError(f"Bump along; got {self.along}; expected a direction (x, y, z)")
        elif self.stretch != 1.0:
            raise InputError(f"Bump stretch; got {self.stretch} without along; expected both")
        if not self.seed >= 0:
            raise InputError(f"Bump seed; got {self.seed}; expected a whole number from 0 on")
        if not self.slope <= STEEPEST:
            raise InputError(
                f"Bump height; got {self.height:g} over a length of {self.length:g}, RMS slope "
                f"{self.slope:.3g}; expected slopes up to {STEEPEST}: a fine relief"
            )

    @property
    def slope(self) -> float:
        """RMS slope in any one direction on the surface, across ``along``."""
        return float(np.sqrt(2.0) * self.height / self.length)

    def unit(self) -> Array:
        """(3, 3): from undeformed coordinates to those in which the relief is isotropic and
        correlated over 1."""
        result = np.eye(3) / self.length
        if self.along is not None:
            axis = np.asarray(self.along, np.float64)
            axis /= np.linalg.norm(axis)
            result -= (1.0 - 1.0 / self.stretch) / self.length * np.outer(axis, axis)
        return result

    def shift(self) -> Array:
        """(3,) in the unit coordinates: where in the one relief of all seeds this one lies."""
        place = np.random.Generator(np.random.Philox(self.seed)).uniform(0.0, PERIOD, 3)
        return np.asarray(place, np.float64)

    def heights(self, points: npt.ArrayLike) -> Array:
        """Height of the relief (n,) at undeformed points (n, 3)."""
        at = np.asarray(points, np.float64) @ self.unit().T + self.shift()
        waves = bump_waves()
        total = np.cos(at @ waves[:, :3].T + waves[:, 3]).sum(axis=1)
        return np.asarray(self.height * np.sqrt(2.0 / WAVES) * total)


@cache
def bump_waves() -> Array:
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
