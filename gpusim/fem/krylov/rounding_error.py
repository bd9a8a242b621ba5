"""What the rounding of the stiffness leaves open in displacements: the part of an error estimate
that no residual shows (see `gpusim.fem.assembly.stiffness_rounding`)."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.system import System

__all__ = ["VISIBLE", "RoundingError", "extent", "rounded"]

Float = npt.NDArray[np.float64]

# share of the tolerance beyond which forces by deformation are worth their time
VISIBLE = 0.1
# root mean square of displacements in bending, of the greatest one (a cantilever: 0.29)
_UNEVEN = 0.2
# share of the tolerance below which a bound of it isn't looked at any closer
_NEGLIGIBLE = 0.02


class Inverse(Protocol):
    """Nearly K'^-1, with the least eigenvalue of K'."""

    @property
    def lowest(self) -> float: ...

    def apply(self, r: Float) -> Float: ...


class RoundingError:
    """By a preconditioner in place of the inverse; it is within a factor of two for the soft
    motions that matter here."""

    def __init__(self, inverse: Inverse, tolerance: float) -> None:
        self._inverse, self._negligible = inverse, _NEGLIGIBLE * tolerance

    def __call__(self, system: System, u: Float) -> float:
        """Relative error (2-norm, the greatest over load cases) of the scaled, complete
        displacements ``u`` (L,N,3)."""
        # |K| u is at most twice the greatest sum of a row: far too much for a body of good
        # proportions
        if np.finfo(np.float64).eps * system.row_sum / self._inverse.lowest <= self._negligible:
            return 0.0
        forces = np.where(system.free, system.rounding(u), 0.0)
        error = self._inverse.apply(forces.reshape(len(u), -1))
        size = extent(u, even=bool(system.prescribed.any()))
        relative = np.sqrt(np.einsum("ln,ln->l", error, error)) / np.where(size > 0.0, size, 1e-300)
        return float(relative.max())


def extent(u: Float, even: bool) -> Float:
    """(L,) 2-norms of displacements (L,N,3), which errors are relative to.

    ``even``: supports may have moved all of the body alike. Errors are uneven, as bending is, and
    beside such a motion their 2-norm makes less of them than the greatest displacement does: the
    size is no more then than that of bending with the same greatest displacement.
    """
    size = np.sqrt(np.einsum("lni,lni->l", u, u))
    if even:
        size = np.minimum(size, _UNEVEN * np.sqrt(u[0].size) * np.abs(u).max(axis=(1, 2)))
    return np.asarray(size)


def rounded(error: float) -> str:
    """What to say where it is too much."""
    left = f"an estimated relative error of {error:.2g}"
    return f"the rounding of the stiffness in float64 leaves {left}"
