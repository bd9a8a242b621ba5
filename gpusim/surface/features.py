"""What the renderer needs of a paint: a ground albedo and the shapes on it, with input checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError

__all__ = ["Features", "Paint", "check_albedo", "check_finish", "check_grid", "check_length"]


@dataclass(frozen=True)
class Features:
    """The shapes of a pattern, as arrays over F features, in paint coordinates.

    ``kind`` 0 is a checker patch with its first corner at ``position`` (F, 2), turned by ``angle``
    (rad), ``squares`` (F, 2) columns x rows of ``size`` (F, 2); even squares have ``albedo[:, 0]``.
    ``kind`` 1 is a disc centred at ``position`` with radius ``size[:, 0]`` and ``albedo[:, 0]``.
    """

    kind: npt.NDArray[np.int32]
    position: npt.NDArray[np.float64]
    angle: npt.NDArray[np.float64]
    size: npt.NDArray[np.float64]
    squares: npt.NDArray[np.float64]
    albedo: npt.NDArray[np.float64]

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


class Paint(Protocol):
    """What the renderer needs of a paint."""

    @property
    def ground(self) -> float:
        """Albedo where no feature lies."""
        ...

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """The features for a region with paint coordinates from ``low`` to ``high`` (2,)."""
        ...


def check_albedo(what: str, **values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and 0.0 <= value <= 1.0):
            raise InputError(f"{what} {name}; got {value}; expected an albedo from 0 to 1")


def check_finish(what: str, roughness: float, metallic: float) -> None:
    """Refuse a finish that isn't one: both are shares."""
    for name, value in (("roughness", roughness), ("metallic", metallic)):
        if not (np.isfinite(value) and 0.0 <= value <= 1.0):
            raise InputError(f"{what} {name}; got {value}; expected 0 to 1")


def check_length(what: str, **values: float) -> None:
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{what} {name}; got {value}; expected a length above 0")


def check_grid(
    what: str, origin: tuple[float, float], columns: int | None, rows: int | None
) -> None:
    if np.shape(origin) != (2,) or not np.isfinite(origin).all():
        raise InputError(f"{what} origin; got {origin}; expected two finite numbers")
    for name, count in (("columns", columns), ("rows", rows)):
        if count is not None and not (count >= 1 and count == int(count)):
            raise InputError(f"{what} {name}; got {count}; expected a whole number of at least 1")
