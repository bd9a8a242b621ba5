"""The error for a stiffness that isn't positive definite in float64."""

from __future__ import annotations

from gpusim.errors import NotConverged

__all__ = ["indefinite"]


def indefinite(where: str) -> NotConverged:
    """What a Cholesky factorisation that broke down means to the user."""
    return NotConverged(
        f"{where}: the stiffness isn't positive definite in float64; got a body whose softest "
        "motions vanish beside its stiffest (is it extremely slender, nearly free, of extremely "
        "unequal elements or materials, or under-integrated, as single rows of 'reduced' elements "
        "are?); expected better proportions, or full integration"
    )
