"""What the renderer needs of a paint: a ground albedo and the shapes on it, with input checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary

__all__ = [
    "Features",
    "Paint",
    "Stack",
    "check_albedo",
    "check_finish",
    "check_grid",
    "check_length",
    "check_places",
]


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

    kind: npt.NDArray[np.int32]
    position: npt.NDArray[np.float64]
    angle: npt.NDArray[np.float64]
    size: npt.NDArray[np.float64]
    squares: npt.NDArray[np.float64]
    albedo: npt.NDArray[np.float64]
    layer: npt.NDArray[np.int32] | None = None
    covers: npt.NDArray[np.float64] | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        if self.covers is None:
            lowest = np.zeros(len(self.kind)) if self.layer is None else self.layer
            object.__setattr__(self, "covers", (lowest == 0).astype(np.float64))

    def __len__(self) -> int:
        return len(self.kind)

    def bounds(self) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
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
    def extent(self) -> npt.NDArray[np.float64]:
        """Sides (F, 2) of patches, radii of round features."""
        return np.where(self.kind[:, None] == 0, self.size * self.squares, self.size)


class Stack:
    """Collects features that lie on one another, each with what it covers."""

    def __init__(self, ground: float) -> None:
        self.ground = ground
        self._rows: list[npt.NDArray[np.float64]] = []

    def patches(
        self,
        corner: npt.NDArray[np.float64],
        size: npt.ArrayLike,
        albedo: float,
        under: float,
        layer: int,
        angle: float = 0.0,
        covers: float | None = None,
    ) -> None:
        """Rectangles of ``size`` ((2,), (n, 2)) with first corners (n, 2), turned by ``angle``.

        ``covers``: where it isn't 1 on layer 0 and 0 above it.
        """
        self._add(0, corner, angle, size, 1.0, albedo, under, layer, covers)

    def discs(
        self,
        centre: npt.NDArray[np.float64],
        radius: float,
        albedo: float,
        under: float,
        layer: int,
    ) -> None:
        """Discs with centres (n, 2)."""
        self._add(1, centre, 0.0, radius, 1.0, albedo, under, layer)

    def sectors(
        self,
        centre: npt.NDArray[np.float64],
        radius: float,
        start: npt.ArrayLike,
        width: npt.ArrayLike,
        albedo: float,
        under: float,
        layer: int,
    ) -> None:
        """Sectors of discs with centres (n, 2), from angles ``start`` on, ``width`` wide (rad)."""
        self._add(2, centre, start, radius, width, albedo, under, layer)

    def _add(
        self,
        kind: int,
        position: npt.NDArray[np.float64],
        angle: npt.ArrayLike,
        size: npt.ArrayLike,
        squares: npt.ArrayLike,
        albedo: float,
        under: float,
        layer: int,
        covers: float | None = None,
    ) -> None:
        row = np.zeros((len(position), 10))
        row[:, 0], row[:, 1:3], row[:, 3] = kind, position, angle
        row[:, 4:6], row[:, 6], row[:, 8] = size, squares, layer
        row[:, 7] = self.ground + albedo - under
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

    Examples
    --------
    >>> def half(paint: gs.paint.Paint) -> float:
    ...     return paint.ground / 2
    >>> half(gs.paint.Plain(0.5))
    0.25
    """

    @property
    def ground(self) -> float:
        """Albedo where no feature lies."""
        ...

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """The features for a region with paint coordinates from ``low`` to ``high`` (2,)."""
        ...


def _is_number(value: object) -> bool:
    """Whether it is one finite real number."""
    return isinstance(value, int | float | np.integer | np.floating) and bool(np.isfinite(value))


def check_albedo(what: str, **values: float) -> None:
    for name, value in values.items():
        if not (_is_number(value) and 0.0 <= value <= 1.0):
            raise InputError(f"{what} {name}; got {value}; expected an albedo from 0 to 1")


def check_finish(what: str, roughness: float, metallic: float) -> None:
    """Refuse a finish that isn't one: both are shares."""
    for name, value in (("roughness", roughness), ("metallic", metallic)):
        if not (_is_number(value) and 0.0 <= value <= 1.0):
            raise InputError(f"{what} {name}; got {value}; expected 0 to 1")


def check_length(what: str, **values: float) -> None:
    for name, value in values.items():
        if not (_is_number(value) and value > 0.0):
            raise InputError(f"{what} {name}; got {value}; expected a length above 0")


def check_grid(
    what: str, origin: tuple[float, float], columns: int | None, rows: int | None
) -> None:
    if np.shape(origin) != (2,) or not all(map(_is_number, origin)):
        raise InputError(f"{what} origin; got {origin}; expected two finite numbers")
    for name, count in (("columns", columns), ("rows", rows)):
        if count is not None and not (_is_number(count) and count >= 1 and count == int(count)):
            raise InputError(f"{what} {name}; got {count}; expected a whole number of at least 1")


def check_places(what: str, places: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Positions as a finite float64 (M, 2) array."""
    array = np.asarray(places, np.float64)
    if array.ndim != 2 or array.shape[1] != 2 or not np.isfinite(array).all():
        raise InputError(f"{what} centres; got shape {array.shape}; expected finite (M, 2)")
    return array
