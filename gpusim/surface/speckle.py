"""Speckle: random discs of paint, as they are sprayed or printed for image correlation.

Boolean model (Chiu, Stoyan, Kendall and Mecke, *Stochastic Geometry and its Applications*, 3rd ed.,
2013, ch. 3): disc centres are a Poisson process of intensity L, the pattern is the union of the
discs, and its area fraction is 1 - exp(-L E[area]). Discs are made germ cell by germ cell from a
counter-based generator (SplitMix64: Steele, Lea and Flood, "Fast splittable pseudorandom number
generators", OOPSLA 2014), so that the seed alone decides where each lies, whatever part of the
pattern is asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Annotated

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Float, Long
from gpusim.arrays.ragged import expand
from gpusim.arrays.unique import Hash, mix
from gpusim.errors import InputError
from gpusim.surface.color import Albedo, grey
from gpusim.surface.features import SECTOR, Features, Length, Pattern
from gpusim.validation import Rule, checked, one_of, require

EDGE = 3.0
"""Half width of a soft edge over its standard deviation: beyond it, opacity is exactly 0 or 1."""

LONGEST_TAIL = 3.0
"""Standard deviations of the logarithm at which lognormal diameters end."""

WIDEST_SPREAD = {"fixed": 0.0, "uniform": 0.5, "lognormal": 1.0}
"""Of each law of sizes."""

PER_CELL = 2.0
"""Mean number of discs in a germ cell."""

MOST_DISCS = 1 << 23
GOLDEN = np.uint64(0x9E3779B97F4A7C15)


@checked
@dataclass(frozen=True, repr=False)
class Speckle(Pattern):
    """Discs of albedo ``dot`` at random places on ``ground``.

    Parameters
    ----------
    diameter : mean diameter of the discs, in the unit of the surface's points.
    coverage : mean share of the area that is painted, 0 to 1 (exclusive).
    softness : standard deviation of a disc's edge profile, same unit (to first order in softness /
        radius); 0 is a hard edge. At distance x from its centre a disc of radius r covers
        S((r^2 - x^2) / (2 r)), where S climbs from 0 to 1 like the distribution function of a
        normal variable (that of Beta(4, 4), within +-3 ``softness``); the form keeps the disc's
        area. Where discs overlap, what they leave uncovered multiplies.
    spread : standard deviation of the diameters over their mean; 0: all are equal. That of the
        logarithm is sqrt(ln(1 + spread^2)).
    size_law : of the diameters: "lognormal", as drops of a spray have them (Babinsky and Sojka,
        "Modeling drop size distributions", Prog. Energy Combust. Sci. 28, 2002), "uniform", or
        "fixed" (no spread). Lognormal sizes end at 3 standard deviations of the logarithm on both
        sides, which takes 0.1 % off the mean diameter at a spread of 0.3, 0.3 % at 0.5, 1.2 % at
        1, and nothing off the coverage.
    arrangement : "random" is the Boolean model: discs overlap. "grid" is a hexagonal grid whose
        discs are each moved at random as far as none can touch another, like a printed pattern.
    seed : equal seeds give equal patterns.
    roughness, metallic : as of `gpusim.surface.paint.Plain`, of ground and discs alike, as under a
        coat of varnish.

    Raises
    ------
    InputError

    Examples
    --------
    >>> speckle = gs.paint.Speckle(diameter=0.006, coverage=0.5, softness=0.0012, seed=1)
    >>> speckle.largest
    0.003
    """

    diameter: Length
    coverage: Annotated[float, Rule("above 0, below 1", lambda value: 0.0 < value < 1.0)] = 0.5
    softness: float = 0.0
    size_law: Annotated[str, one_of(*WIDEST_SPREAD)] = "lognormal"
    spread: float = 0.0
    arrangement: Annotated[str, one_of("random", "grid")] = "random"
    seed: Annotated[int, Rule("a whole number from 0 up", lambda value: 0 <= value < 2**63)] = 0
    dot: Albedo = Albedo(0.05)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        half = 0.5 * self.diameter
        expected = f"0 to half the diameter ({half:g})"
        require(0.0 <= self.softness <= half, "Speckle softness", self.softness, expected)
        most = WIDEST_SPREAD[self.size_law]
        expected = f"0 to {most} with size_law {self.size_law!r}"
        require(0.0 <= self.spread <= most, "Speckle spread", self.spread, expected)
        if self.arrangement == "grid" and not self.largest <= 0.5 * self.pitch:
            highest = self.coverage * (0.5 * self.pitch / self.largest) ** 2
            raise InputError(
                f"Speckle coverage; got {self.coverage} on a grid; expected at most {highest:.3g}, "
                "where the largest discs would touch"
            )

    @cached_property
    def mean_area(self) -> float:
        """Mean painted area of one disc by itself."""
        node, weight = np.polynomial.legendre.leggauss(64)
        radius = self.radii(0.5 * (node + 1.0))
        return float(0.5 * weight @ opaque_area(radius, self.softness))

    @property
    def intensity(self) -> float:
        """Mean number of discs per unit of area."""
        if self.arrangement == "grid":
            return self.coverage / self.mean_area
        return float(-np.log1p(-self.coverage)) / self.mean_area

    @property
    def pitch(self) -> float:
        """Distance of neighbours on the hexagonal grid before they are moved."""
        return float(np.sqrt(2.0 / (np.sqrt(3.0) * self.intensity)))

    @property
    def largest(self) -> float:
        """The largest radius."""
        return float(self.radii(np.ones(1))[0])

    @property
    def smallest(self) -> float:
        """The smallest radius."""
        return float(self.radii(np.zeros(1))[0])

    def radii(self, quantile: Float) -> Float:
        """Radii at quantiles 0 … 1 of the size law."""
        if self.spread == 0.0:
            share = np.ones_like(quantile)
        elif self.size_law == "uniform":
            share = 1.0 + np.sqrt(3.0) * self.spread * (2.0 * quantile - 1.0)
        else:
            deviation = np.sqrt(np.log1p(self.spread**2))
            tail = 0.5 * (1.0 + math.erf(LONGEST_TAIL / math.sqrt(2.0)))
            z = scipy.special.ndtri(1.0 - tail + quantile * (2.0 * tail - 1.0))
            share = np.exp(deviation * z - 0.5 * deviation**2)
        result: Float = 0.5 * self.diameter * share
        return result

    def discs(self, low: npt.ArrayLike, high: npt.ArrayLike) -> tuple[Float, Float]:
        """Centres (M, 2) and radii (M,) of all discs that reach into the box ``low`` to ``high``.

        Some that only come near it are among them. A larger box has the same ones and more.

        Raises
        ------
        InputError
            More discs than memory should hold.
        """
        corners = np.array([low, high], np.float64)
        reach = outer_radius(self.largest, self.softness)
        return _discs(self, tuple(corners[0] - reach), tuple(corners[1] + reach))

    def features(self, low: Float, high: Float) -> Features:
        """The discs, as features of kind 2: they may overlap."""
        centres, radius = self.discs(low, high)
        return Features.alike(SECTOR, centres, radius[:, None], grey(self.dot))


def edge_opacity(u: Float) -> Float:
    """S: from 0 at u <= -1 to 1 at u >= 1, three times differentiable (Beta(4, 4)).

    Its derivative has a standard deviation of 1 / `EDGE`.
    """
    u = np.clip(u, -1.0, 1.0)
    v = u * u
    result: Float = 0.5 + u * (35.0 + v * (-35.0 + v * (21.0 - 5.0 * v))) / 32.0
    return result


def opaque_area(radius: Float, softness: float) -> Float:
    """Integral of one disc's opacity over the plane; pi r^2 unless r < 6 ``softness``."""
    if softness == 0.0:
        return np.pi * radius**2
    half = EDGE * softness
    end = 0.5 * radius / half  # the argument of S at the disc's centre
    u = np.minimum(end, 1.0)
    v = u * u
    climb = (35.0 + 128.0 * u + v * (140.0 + v * (-70.0 + v * (28.0 - 5.0 * v)))) / 256.0
    return 2.0 * np.pi * radius * half * (climb + np.maximum(end - 1.0, 0.0))


def outer_radius(radius: float, softness: float) -> float:
    """Where a soft disc ends."""
    return float(np.sqrt(radius * (radius + 2.0 * EDGE * softness)))


@lru_cache(maxsize=8)
def _discs(
    speckle: Speckle, low: tuple[float, float], high: tuple[float, float]
) -> tuple[Float, Float]:
    if speckle.arrangement == "grid":
        size = np.array([speckle.pitch, speckle.pitch * np.sqrt(0.75)])
        margin = 1.0
    else:
        size = np.full(2, np.sqrt(PER_CELL / speckle.intensity))
        margin = 0.0
    first = np.floor(np.array(low) / size - margin)
    last = np.floor(np.array(high) / size + margin)
    discs = np.prod(last + 1.0 - first) * np.prod(size) * speckle.intensity
    got = f"{speckle.diameter:g}, which makes {discs:.3g} discs in the visible region"
    require(discs <= MOST_DISCS, "Speckle diameter", got, f"at most {MOST_DISCS}")
    i = np.arange(first[0], last[0] + 1.0).astype(np.int64)
    j = np.arange(first[1], last[1] + 1.0).astype(np.int64)
    cells = np.stack(np.meshgrid(i, j, indexing="xy"), axis=-1).reshape(-1, 2)
    key = _key(speckle.seed, cells)
    if speckle.arrangement == "grid":
        radius = speckle.radii(_uniform(key, 1))
        room = np.maximum(0.5 * speckle.pitch - radius, 0.0)
        away = room * np.sqrt(_uniform(key, 2))
        turn = 2.0 * np.pi * _uniform(key, 3)
        place = cells * size
        place[:, 0] += 0.5 * size[0] * (cells[:, 1] % 2)
        return place + away[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1), radius
    counts = _poisson(_uniform(key, 0))
    owner, number = expand(counts)
    own = mix(key[owner] + GOLDEN * number.astype(np.uint64), 0)
    inside = np.stack([_uniform(own, 1), _uniform(own, 2)], axis=1)
    return (cells[owner] + inside) * size, speckle.radii(_uniform(own, 3))


def _poisson(uniform: Float) -> Long:
    """Poisson counts of mean `PER_CELL` by inversion."""
    k = np.arange(1, 40)
    terms = np.exp(-PER_CELL) * np.concatenate([[1.0], np.cumprod(PER_CELL / k)])
    return np.searchsorted(np.cumsum(terms), uniform, side="right").astype(np.int64)


def _key(seed: int, cells: Long) -> Hash:
    """One key per germ cell (n, 2)."""
    key = mix(np.full(len(cells), seed, np.uint64), 0)
    for axis in (0, 1):
        key = mix(key ^ cells[:, axis].astype(np.uint64), 0)
    return key


def _uniform(key: Hash, channel: int) -> Float:
    """Numbers in [0, 1) from keys."""
    result: Float = (mix(key, channel) >> np.uint64(11)).astype(np.float64) * 2.0**-53
    return result
