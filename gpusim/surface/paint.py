"""Paint: what a region of a surface looks like, fixed to its material points.

A pattern is laid out in the region's paint coordinates (s, t): lengths on the undeformed surface,
in the unit of its points (see `gpusim.surface.surface.PaintFrame`). Albedo is the share of light
reflected, 0 to 1. Patterns are exact shapes, which the renderer integrates over each pixel in
closed form; `Image` is a bitmap, integrated as a smooth surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.surface.bitmap import Image
from gpusim.surface.bump import Bump
from gpusim.surface.features import (
    Features,
    Paint,
    check_albedo,
    check_finish,
    check_grid,
    check_length,
    check_places,
)
from gpusim.surface.fiducials import Aruco, Charuco, RingCodes
from gpusim.surface.speckle import Speckle
from gpusim.surface.targets import Circles, Lines, Star
from gpusim.validation import checked

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


@checked
@dataclass(frozen=True)
class Plain:
    """One albedo everywhere.

    ``roughness`` below 1 makes it glossy (the lobe of GGX with alpha = roughness^2), as a coat of
    lacquer over a diffuse base; ``metallic`` 1 makes it bare metal, which has no base and mirrors
    with its albedo. At roughness 1 and metallic 0 it is matte (Lambert). ``bump`` is a fine relief.
    The same holds for the ground of a pattern; squares, dots and markers are matte prints on it.

    Examples
    --------
    >>> gs.paint.Plain(albedo=0.4, roughness=0.3)
    Plain(albedo=0.4, roughness=0.3, metallic=0.0, bump=None)
    """

    albedo: float = 0.5
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None

    def __post_init__(self) -> None:
        check_finish("Plain", self.roughness, self.metallic)
        check_albedo("Plain", albedo=self.albedo)

    @property
    def ground(self) -> float:
        """The albedo."""
        return self.albedo

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """No features."""
        return None


@checked
@dataclass(frozen=True)
class Checker:
    """A chessboard of squares of side ``size``; the square at ``origin`` (s, t) is ``dark``.

    With ``columns`` and ``rows`` it ends there and ``ground`` surrounds it; without, it covers the
    whole region.

    Examples
    --------
    >>> gs.paint.Checker(size=0.01, columns=9, rows=8).light
    0.9
    """

    size: float
    columns: int | None = None
    rows: int | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    dark: float = 0.05
    light: float = 0.9
    ground: float = 0.9
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None

    def __post_init__(self) -> None:
        check_finish("Checker", self.roughness, self.metallic)
        check_length("Checker", size=self.size)
        check_albedo("Checker", dark=self.dark, light=self.light, ground=self.ground)
        check_grid("Checker", self.origin, self.columns, self.rows)

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """One patch; an unlimited one is cut to the region, on a whole number of square pairs."""
        origin = np.array(self.origin)
        first = 2.0 * np.floor((low - origin) / (2.0 * self.size)) - 2.0
        count = np.ceil((high - origin) / self.size) + 2.0 - first
        columns, rows = self.columns, self.rows
        start = np.where([columns is None, rows is None], first, 0.0)
        squares = np.array([columns or count[0], rows or count[1]], np.float64)
        return Features(
            np.zeros(1, np.int32),
            (origin + start * self.size)[None],
            np.zeros(1),
            np.full((1, 2), self.size),
            squares[None],
            np.array([[self.dark, self.light]]),
        )


@checked
@dataclass(frozen=True)
class Dots:
    """Discs of ``diameter`` on a grid of ``pitch``; the first centre is at ``origin``.

    Examples
    --------
    >>> gs.paint.Dots(diameter=0.004, pitch=0.01, columns=3, rows=2).ground
    0.9
    """

    diameter: float
    pitch: float
    columns: int | None = None
    rows: int | None = None
    origin: tuple[float, float] = (0.0, 0.0)
    albedo: float = 0.05
    ground: float = 0.9
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None

    def __post_init__(self) -> None:
        check_finish("Dots", self.roughness, self.metallic)
        check_length("Dots", diameter=self.diameter, pitch=self.pitch)
        check_albedo("Dots", albedo=self.albedo, ground=self.ground)
        check_grid("Dots", self.origin, self.columns, self.rows)
        if not self.diameter <= self.pitch:
            raise InputError(f"Dots diameter; got {self.diameter}; expected at most the pitch")

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """One disc per grid point; an unlimited grid covers the region."""
        origin = np.array(self.origin)
        first = np.floor((low - origin) / self.pitch)
        last = np.ceil((high - origin) / self.pitch)
        across = last[0] + 1 - first[0] if self.columns is None else self.columns
        along = last[1] + 1 - first[1] if self.rows is None else self.rows
        if across * along > MOST_DOTS:
            raise InputError(
                f"Dots pitch; got {self.pitch}, which makes {across:.0f} x {along:.0f} dots; "
                f"expected at most {MOST_DOTS} in a region"
            )
        i = np.arange(first[0], last[0] + 1) if self.columns is None else np.arange(self.columns)
        j = np.arange(first[1], last[1] + 1) if self.rows is None else np.arange(self.rows)
        grid = np.stack(np.meshgrid(i, j, indexing="xy"), axis=-1).reshape(-1, 2)
        count = len(grid)
        return Features(
            np.ones(count, np.int32),
            origin + grid * self.pitch,
            np.zeros(count),
            np.full((count, 2), 0.5 * self.diameter),
            np.ones((count, 2)),
            np.full((count, 2), self.albedo),
        )


@checked
@dataclass(frozen=True, eq=False)
class Markers:
    """Square targets of side ``size`` made of 2 x 2 black and white squares, at given centres.

    ``centres`` is (M, 2) in paint coordinates; ``angle`` (rad) turns every marker. The squares at
    the lower left and upper right are ``dark``.

    Examples
    --------
    >>> gs.paint.Markers(np.array([[0.0, 0.0], [0.05, 0.0]]), size=0.01).angle
    0.0
    """

    centres: npt.NDArray[np.float64]
    size: float
    dark: float = 0.04
    light: float = 0.9
    ground: float = 0.5
    angle: float = 0.0
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        check_finish("Markers", self.roughness, self.metallic)
        centres = check_places("Markers", self.centres)
        check_length("Markers", size=self.size)
        check_albedo("Markers", dark=self.dark, light=self.light, ground=self.ground)
        if not np.isfinite(self.angle):
            raise InputError(f"Markers angle; got {self.angle}; expected a finite angle in rad")
        object.__setattr__(self, "centres", centres)

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """One 2 x 2 patch per centre."""
        count = len(self.centres)
        half = 0.5 * self.size
        cos, sin = np.cos(self.angle), np.sin(self.angle)
        corner = np.array([-cos * half + sin * half, -sin * half - cos * half])
        return Features(
            np.zeros(count, np.int32),
            self.centres + corner,
            np.full(count, self.angle),
            np.full((count, 2), half),
            np.full((count, 2), 2.0),
            np.tile([self.dark, self.light], (count, 1)),
        )


def __dir__() -> list[str]:
    return sorted(__all__)
