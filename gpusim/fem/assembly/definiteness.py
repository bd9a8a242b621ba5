"""The errors for stiffnesses that float64 can't hold: indefinite ones, and numbers beyond it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import NotConverged

__all__ = ["check_finite", "indefinite"]


def check_finite(values: npt.NDArray[np.float64], what: str) -> None:
    """Raise NotConverged unless all ``values`` are finite."""
    if not np.isfinite(values).all():
        raise NotConverged(
            f"{what}: got values that aren't finite; expected finite numbers "
            "(is the stiffness of some material or the size of some element extreme?)"
        )


def indefinite(where: str, error: float | None = None) -> NotConverged:
    """What a Cholesky factorisation that broke down means to the user, or one that just didn't:
    ``error`` is what rounding alone may do to its solution, relative to that."""
    seen = "" if error is None else f" (its rounding alone may change the solution by {error:.0%})"
    return NotConverged(
        f"{where}: the stiffness isn't positive definite in float64{seen}; got a body whose "
        "softest motions vanish beside its stiffest (is it extremely slender, nearly free, of "
        "extremely unequal elements or materials, or under-integrated, as single rows of 'reduced' "
        "elements are?); expected better proportions, or full integration"
    )
