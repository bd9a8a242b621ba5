"""Paint: what a region of a surface looks like, fixed to its material points.

A pattern is laid out in the region's paint coordinates (s, t): lengths on the undeformed surface,
in the unit of its points (see `gpusim.surface.surface.PaintFrame`). Albedo is the share of light
reflected, 0 to 1: a grey number, red, green and blue (linear), or "#rrggbb". Patterns are exact
shapes, which the renderer integrates over each pixel in closed form; `Image` is a bitmap,
integrated as a smooth surface.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.surface.bitmap import Image
from gpusim.surface.color import Albedo, Color, Colored, grey
from gpusim.surface.features import (
    DISC,
    PATCH,
    SECTOR,
    Angle,
    Bump,
    Features,
    Length,
    Paint,
    Pattern,
    Place,
    Stack,
    set_centres,
)
from gpusim.surface.fiducials import Aruco, Charuco, RingCodes
from gpusim.surface.speckle import Speckle
from gpusim.validation import Count, Share, checked, one_of, require, within

__all__ = [
    "Aruco",
    "Bump",
    "Charuco",
    "Checker",
    "Circles",
    "Dots",
    "Features",
    "Image",
    "Lines",
    "Markers",
    "Paint",
    "Plain",
    "RingCodes",
    "Speckle",
    "Star",
]


MOST_DOTS = 1 << 22
MOST_LINES = 1 << 20


@checked
@dataclass(frozen=True)
class Plain(Colored):
    """One albedo everywhere.

    ``roughness`` below 1 makes it glossy (the lobe of GGX with alpha = roughness^2), as a coat of
    lacquer over a diffuse base; ``metallic`` 1 makes it bare metal, which has no base and mirrors
    with its albedo. At roughness 1 and metallic 0 it is matte (Lambert). ``bump`` is a fine relief.
    The same holds for the ground of a pattern; squares, dots and markers are matte prints on it.

    Examples
    --------
    >>> gs.paint.Plain(albedo=0.4, roughness=0.3)
    Plain(albedo=0.4, roughness=0.3, metallic=0.0, bump=None)
    >>> brick = gs.paint.Plain([0.6, 0.2, 0.1])
    >>> [brick.in_band(band).albedo for band in range(3)]
    [0.6, 0.2, 0.1]
    """

    albedo: Albedo = Albedo(0.5)
    roughness: Share = 1.0
    metallic: Share = 0.0
    bump: Bump | None = None

    @property
    def ground(self) -> Color:
        """The albedo."""
        return self.albedo

    def features(self, low: Float, high: Float) -> Features | None:
        """No features."""
        return None


@checked
@dataclass(frozen=True, repr=False)
class Checker(Pattern):
    """A chessboard of squares of side ``size``; the square at ``origin`` (s, t) is ``dark``.

    With ``columns`` and ``rows`` it ends there and ``ground`` surrounds it; without, it covers the
    whole region.

    Examples
    --------
    >>> gs.paint.Checker(size=0.01, columns=9, rows=8).light
    0.9
    """

    size: Length
    columns: Count | None = None
    rows: Count | None = None
    origin: Place = (0.0, 0.0)
    dark: Albedo = Albedo(0.05)
    light: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.9)

    def features(self, low: Float, high: Float) -> Features | None:
        """One patch; an unlimited one is cut to the region, on a whole number of square pairs."""
        origin = np.array(self.origin)
        first = 2.0 * np.floor((low - origin) / (2.0 * self.size)) - 2.0
        count = np.ceil((high - origin) / self.size) + 2.0 - first
        columns, rows = self.columns, self.rows
        start = np.where([columns is None, rows is None], first, 0.0)
        squares = [columns or count[0], rows or count[1]]
        albedo, corner = [grey(self.dark), grey(self.light)], (origin + start * self.size)[None]
        return Features.alike(PATCH, corner, self.size, albedo, squares=squares)


def _numbers(grid: Dots | Lines, low: Float, high: Float, margin: float) -> tuple[Float, Float]:
    """First and last pitch (2,) of a grid: 0 and how many it has, or where it has covered a region
    from ``low`` to ``high`` and a ``margin`` of pitches."""
    begin, end = ((corner - np.array(grid.origin)) / grid.pitch for corner in (low, high))
    count = np.array([np.nan if n is None else n for n in (grid.columns, grid.rows)])
    unlimited = np.isnan(count)
    first = np.where(unlimited, np.floor(begin) - margin, 0.0)
    return first, np.where(unlimited, np.ceil(end) + margin, count)


@checked
@dataclass(frozen=True, repr=False)
class Dots(Pattern):
    """Discs of ``diameter`` on a grid of ``pitch``; the first centre is at ``origin``.

    Examples
    --------
    >>> gs.paint.Dots(diameter=0.004, pitch=0.01, columns=3, rows=2).ground
    0.9
    """

    diameter: Length
    pitch: Length
    columns: Count | None = None
    rows: Count | None = None
    origin: Place = (0.0, 0.0)
    albedo: Albedo = Albedo(0.05)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        fits = self.diameter <= self.pitch
        require(fits, "Dots diameter", self.diameter, "at most the pitch")

    def features(self, low: Float, high: Float) -> Features | None:
        """One disc per grid point; an unlimited grid covers the region."""
        first, last = _numbers(self, low, high, 0.0)
        last -= [self.columns is not None, self.rows is not None]
        across, along = last - first + 1.0
        got = f"{self.pitch}, which makes {across:.0f} x {along:.0f} dots"
        expected = f"at most {MOST_DOTS} in a region"
        require(across * along <= MOST_DOTS, "Dots pitch", got, expected)
        numbers = (np.arange(a, b + 1.0) for a, b in zip(first, last, strict=True))
        grid = np.stack(np.meshgrid(*numbers), axis=-1).reshape(-1, 2)
        places, radius = np.array(self.origin) + grid * self.pitch, 0.5 * self.diameter
        return Features.alike(DISC, places, radius, grey(self.albedo))


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Markers(Pattern):
    """Square targets of side ``size`` made of 2 x 2 black and white squares, at given centres.

    ``centres`` is (M, 2) in paint coordinates; ``angle`` (rad) turns every marker. The squares at
    the lower left and upper right are ``dark``.

    Examples
    --------
    >>> gs.paint.Markers(np.array([[0.0, 0.0], [0.05, 0.0]]), size=0.01).angle
    0.0
    """

    centres: Float
    size: Length
    dark: Albedo = Albedo(0.04)
    light: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.5)
    angle: Angle = 0.0

    def __post_init__(self) -> None:
        set_centres(self)

    def features(self, low: Float, high: Float) -> Features | None:
        """One 2 x 2 patch per centre."""
        half = 0.5 * self.size
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        corner = np.array([-cos * half + sin * half, -sin * half - cos * half])
        albedo, corners = [grey(self.dark), grey(self.light)], self.centres + corner
        return Features.alike(PATCH, corners, half, albedo, angle=self.angle, squares=2.0)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Circles(Pattern):
    """Concentric circles around every centre (M, 2): the largest is ``dark``, then they alternate.

    ``diameters`` fall; (30, 20, 10) is a dark ring of width 5 around a dark disc of diameter 10.

    Examples
    --------
    >>> gs.paint.Circles(np.zeros((1, 2)), diameters=(0.03, 0.02, 0.01)).dark
    0.05
    """

    centres: Float
    diameters: tuple[float, ...]
    dark: Albedo = Albedo(0.05)
    light: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        set_centres(self)
        sizes = np.asarray(self.diameters, np.float64)
        fits = sizes.ndim == 1 and len(sizes) > 0 and np.isfinite(sizes).all()
        fits = fits and (sizes > 0.0).all() and (np.diff(sizes) < 0.0).all()
        require(fits, "Circles diameters", self.diameters, "lengths above 0 that fall")

    def features(self, low: Float, high: Float) -> Features | None:
        """Discs upon discs."""
        stack, under = Stack(self.ground), self.ground
        for layer, diameter in enumerate(self.diameters):
            albedo = self.light if layer % 2 else self.dark
            stack.add(DISC, self.centres, 0.5 * diameter, albedo, under, layer)
            under = albedo
        return stack.features()


@checked
@dataclass(frozen=True, repr=False)
class Lines(Pattern):
    """Lines of ``width`` at a ``pitch``: along s, along t, or both, a grid.

    ``origin`` is the middle of a line (of a crossing). ``columns`` and ``rows`` count pitches;
    without them the lines cover the region.

    Examples
    --------
    >>> gs.paint.Lines(pitch=0.01, width=0.001, along="both").albedo
    0.05
    """

    pitch: Length
    width: Length
    along: Annotated[str, one_of("s", "t", "both")] = "both"
    columns: Count | None = None
    rows: Count | None = None
    origin: Place = (0.0, 0.0)
    albedo: Albedo = Albedo(0.05)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        require(self.width < self.pitch, "Lines width", self.width, "less than the pitch")

    def features(self, low: Float, high: Float) -> Features | None:
        """Strips along s; along t too, less the crossings."""
        origin = np.array(self.origin)
        first, last = _numbers(self, low, high, 1.0)
        crossings = np.prod(last - first + 1.0)
        got = f"{self.pitch}, which makes {crossings:.3g} crossings"
        expected = f"at most {MOST_LINES} in a region"
        require(crossings <= MOST_LINES, "Lines pitch", got, expected)
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
            stack.add(
                PATCH, corner - 0.5 * self.width, size, self.albedo, self.ground, k, covers=1.0
            )
        if self.along == "both":
            # both lines darken a crossing: that is one too many
            s, t = np.meshgrid(*places)
            corner = np.stack([s.ravel(), t.ravel()], axis=1) - 0.5 * self.width
            stack.add(PATCH, corner, self.width, self.ground, self.albedo, 2, covers=-1.0)
        return stack.features()


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Star(Pattern):
    """Siemens stars: ``spokes`` dark sectors around every centre (M, 2), as wide as the gaps.

    The first spoke begins at ``angle`` (rad) from the s axis. At the distance r from a centre the
    period is 2 pi r / spokes.

    Examples
    --------
    >>> gs.paint.Star(np.zeros((1, 2)), diameter=0.1, spokes=36).light
    0.9
    """

    centres: Float
    diameter: Length
    spokes: Annotated[int, within(2, 1000)] = 36
    angle: Angle = 0.0
    dark: Albedo = Albedo(0.05)
    light: Albedo = Albedo(0.9)
    ground: Albedo = Albedo(0.9)

    def __post_init__(self) -> None:
        set_centres(self)

    def features(self, low: Float, high: Float) -> Features | None:
        """Light discs and the spokes on them."""
        stack = Stack(self.ground)
        stack.add(DISC, self.centres, 0.5 * self.diameter, self.light, self.ground, 0)
        start = self.angle + np.arange(self.spokes) * (2.0 * np.pi / self.spokes)
        stack.add(
            SECTOR, np.repeat(self.centres, self.spokes, axis=0), 0.5 * self.diameter,
            self.dark, self.light, 1,
            angle=np.tile(start, len(self.centres)), width=np.pi / self.spokes,
        )  # fmt: skip
        return stack.features()


def __dir__() -> list[str]:
    return sorted(__all__)
