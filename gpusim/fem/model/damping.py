"""Damping: of the Rayleigh kind, mode by mode, or in the material's structure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Protocol, runtime_checkable

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.validation import Rule, as_float64, checked, require

DAMPINGS = "Rayleigh, ModalDamping or StructuralDamping"
Amount = Annotated[float, Rule("a number >= 0", lambda value: 0.0 <= value < float("inf"))]


@runtime_checkable
class Damping(Protocol):
    """What all kinds can tell."""

    def ratios(self, angular: Float) -> Float:
        """(n,) share of critical damping of modes with ``angular`` (n,) frequencies > 0, rad/s."""

    def dissipation(self, angular: Float, modes: Float) -> Float:
        """(F,n) imaginary part of dynamic stiffness over modal mass, 1/s^2, of ``modes`` (n,) that
        vibrate at ``angular`` (F,); both rad/s, from 0 up."""


@checked
@dataclass(frozen=True)
class Rayleigh:
    """C = ``mass`` M + ``stiffness`` K; the shares in 1/s and s.

    Examples
    --------
    >>> gs.Rayleigh(mass=2.0, stiffness=1e-4).ratios(np.array([100.0])).round(6)
    array([0.015])
    """

    mass: Amount = 0.0
    stiffness: Amount = 0.0

    def ratios(self, angular: Float) -> Float:
        """(n,) of ``angular`` (n,) > 0, rad/s."""
        return 0.5 * (self.mass / angular + self.stiffness * angular)

    def dissipation(self, angular: Float, modes: Float) -> Float:
        """(F,n) of ``modes`` (n,) at ``angular`` (F,), rad/s."""
        return angular[:, None] * (self.mass + self.stiffness * modes**2)


@dataclass(frozen=True, eq=False)
class ModalDamping:
    """Share of critical damping, 0 to 1: one ``ratio`` for all modes, or a sequence, one a mode,
    whose last one holds for all further modes.

    Examples
    --------
    >>> gs.ModalDamping([0.02, 0.01]).ratios(np.array([10.0, 20.0, 30.0]))
    array([0.02, 0.01, 0.01])
    """

    ratio: float | Sequence[float]

    def __post_init__(self) -> None:
        expected = "numbers >= 0 and < 1, at least one"
        ratios = np.atleast_1d(as_float64(self.ratio, "ModalDamping.ratio", expected))
        good = (
            np.asarray(self.ratio).dtype.kind in "iuf"
            and ratios.ndim == 1
            and ratios.size
            and ((ratios >= 0.0) & (ratios < 1.0)).all()
        )
        require(bool(good), "ModalDamping.ratio", self.ratio, expected)

    def ratios(self, angular: Float) -> Float:
        """(n,) of ``angular`` (n,), rad/s."""
        every = np.atleast_1d(np.asarray(self.ratio, dtype=np.float64))
        return np.asarray(every[np.minimum(np.arange(len(angular)), len(every) - 1)])

    def dissipation(self, angular: Float, modes: Float) -> Float:
        """(F,n) of ``modes`` (n,) at ``angular`` (F,), rad/s."""
        return 2.0 * self.ratios(modes) * modes * angular[:, None]


@checked
@dataclass(frozen=True)
class StructuralDamping:
    """K (1 + i ``loss_factor``) in harmonic motion: the same energy lost in each cycle at any
    frequency. At resonance it acts as half of it does as a share of critical damping.

    Examples
    --------
    >>> gs.StructuralDamping(0.04).ratios(np.array([10.0]))
    array([0.02])
    """

    loss_factor: Amount

    def ratios(self, angular: Float) -> Float:
        """(n,) of ``angular`` (n,), rad/s."""
        return np.full(len(angular), 0.5 * self.loss_factor)

    def dissipation(self, angular: Float, modes: Float) -> Float:
        """(F,n) of ``modes`` (n,) at any ``angular`` (F,), rad/s."""
        return np.tile(self.loss_factor * modes**2, (len(angular), 1))
