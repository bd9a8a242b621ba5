"""Targets for measuring positions and resolution: concentric circles, grids of lines, stars."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.surface.bump import Bump
from gpusim.surface.features import (
    Features,
    Stack,
    check_albedo,
    check_finish,
    check_grid,
    check_length,
    check_places,
)
from gpusim.validation import checked

__all__ = ["Circles", "Lines", "Star"]

Array = npt.NDArray[np.float64]
MOST_LINES = 1 << 20


@checked
@dataclass(frozen=True, eq=False)
class Circles:
    """Concentric circles around every centre (M, 2): the largest is ``dark``, then they alternate.

    ``diameters`` fall; (30, 20, 10) is a dark ring of width 5 around a dark disc of diameter 10.

    Examples
    --------
    >>> gs.paint.Circles(np.zeros((1, 2)), diameters=(0.03, 0.02, 0.01)).dark
    0.05
    """

    centres: Array
    diameters: tuple[float, ...]
    dark: float = 0.05
    light: float = 0.9
    ground: float = 0.9
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        check_finish("Circles", self.roughness, self.metallic)
        object.__setattr__(self, "centres", check_places("Circles", self.centres))
        sizes = np.asarray(self.diameters, np.float64)
        good = sizes.ndim == 1 and len(sizes) > 0 and np.isfinite(sizes).all()
        if not good or not (sizes > 0.0).all() or not (np.diff(sizes) < 0.0).all():
            raise InputError(
                f"Circles diameters; got {self.diameters}; expected lengths above 0 that fall"
            )
        check_albedo("Circles", dark=self.dark, light=self.light, ground=self.ground)

    def features(self, low: Array, high: Array) -> Features | None:
        """Discs upon discs."""
        stack, under = Stack(self.ground), self.ground
        for layer, diameter in enumerate(self.diameters):
            albedo = self.light if layer % 2 else self.dark
            stack.discs(self.centres, 0.5 * diameter, albedo, under, layer)
            under = albedo
        return stack.features()


@checked
@dataclass(frozen=True)
class Lines:
    """Lines of ``width`` at a ``pitch``: along s, along t, or both, a grid.

    ``origin`` is the middle of a line (of a crossing). ``columns`` and ``rows`` count pitches;
    without them the lines cover the region.

    Examples
    --------
    >>> gs.paint.Lines(pitch=0.01, width=0.001, along="both").albedo
    0.05
    """

    pitch: float
    width: float
    along: str = "both"
    columns: int | None = None
    rows: int | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    albedo: float = 0.05
    ground: float = 0.9
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None

    def __post_init__(self) -> None:
        check_finish("Lines", self.roughness, self.metallic)
        check_length("Lines", pitch=self.pitch, width=self.width)
        check_albedo("Lines", albedo=self.albedo, ground=self.ground)
        check_grid("Lines", self.origin, self.columns, self.rows)
        if not self.width < self.pitch:
            raise InputError(f"Lines width; got {self.width}; expected less than the pitch")
        if self.along not in ("s", "t", "both"):
            raise InputError(f"Lines along; got {self.along!r}; expected 's', 't' or 'both'")

    def features(self, low: Array, high: Array) -> Features | None:
        """Strips along s; along t too, less the crossings."""
        origin = np.array(self.origin)
        given = [self.columns, self.rows]
        first = np.where([n is None for n in given], np.floor((low - origin) / self.pitch) - 1, 0)
        last = np.where(
            [n is None for n in given],
            np.ceil((high - origin) / self.pitch) + 1,
            [n or 0 for n in given],
        )
        if not np.prod(last - first + 1.0) <= MOST_LINES:
            raise InputError(
                f"Lines pitch; got {self.pitch}, which makes {np.prod(last - first + 1):.3g} "
                f"crossings; expected at most {MOST_LINES} in a region"
            )
        stack = Stack(self.ground)
        places = [origin[k] + np.arange(first[k], last[k] + 1) * self.pitch for k in (0, 1)]
        length = (last - first) * self.pitch + self.width
        for k, name in enumerate("st"):
            if self.along not in (name, "both"):
                continue
            corner = np.empty((len(places[1 - k]), 2))
            corner[:, k], corner[:, 1 - k] = places[k][0], places[1 - k]
            size = np.full(2, self.width)
            size[k] = length[k]
            stack.patches(corner - 0.5 * self.width, size, self.albedo, self.ground, k, covers=1.0)
        if self.along == "both":
            # both lines darken a crossing: that is one too many
            s, t = np.meshgrid(*places)
            corner = np.stack([s.ravel(), t.ravel()], axis=1) - 0.5 * self.width
            stack.patches(corner, self.width, self.ground, self.albedo, 2, covers=-1.0)
        return stack.features()


@checked
@dataclass(frozen=True, eq=False)
class Star:
    """Siemens stars: ``spokes`` dark sectors around every centre (M, 2), as wide as the gaps.

    The first spoke begins at ``angle`` (rad) from the s axis. At the distance r from a centre the
    period is 2 pi r / spokes.

    Examples
    --------
    >>> gs.paint.Star(np.zeros((1, 2)), diameter=0.1, spokes=36).light
    0.9
    """

    centres: Array
    diameter: float
    spokes: int = 36
    angle: float = 0.0
    dark: float = 0.05
    light: float = 0.9
    ground: float = 0.9
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        check_finish("Star", self.roughness, self.metallic)
        object.__setattr__(self, "centres", check_places("Star", self.centres))
        check_length("Star", diameter=self.diameter)
        check_albedo("Star", dark=self.dark, light=self.light, ground=self.ground)
        if not (2 <= self.spokes <= 1000 and self.spokes == int(self.spokes)):
            raise InputError(f"Star spokes; got {self.spokes}; expected a whole number, 2 to 1000")
        if not np.isfinite(self.angle):
            raise InputError(f"Star angle; got {self.angle}; expected a finite angle in rad")

    def features(self, low: Array, high: Array) -> Features | None:
        """Light discs and the spokes on them."""
        stack = Stack(self.ground)
        stack.discs(self.centres, 0.5 * self.diameter, self.light, self.ground, 0)
        start = self.angle + np.arange(self.spokes) * (2.0 * np.pi / self.spokes)
        stack.sectors(
            np.repeat(self.centres, self.spokes, axis=0), 0.5 * self.diameter,
            np.tile(start, len(self.centres)),
            np.pi / self.spokes, self.dark, self.light, 1,
        )  # fmt: skip
        return stack.features()
