"""Block-Jacobi and Chebyshev smoothing, host side; ``relaxation`` has the device's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float


@dataclass(frozen=True)
class Relaxation:
    """Factors of one step; rounded to float32, as kernels take them."""

    keep: float
    gain: float
    hold: float

    def __post_init__(self) -> None:
        for name in ("keep", "gain", "hold"):
            object.__setattr__(self, name, float(np.float32(getattr(self, name))))


def chebyshev(low: float, high: float, degree: int) -> tuple[Relaxation, ...]:
    """Steps of the Chebyshev iteration for eigenvalues of D^-1 A in [low, high].

    Saad, Iterative Methods for Sparse Linear Systems (2003), algorithm 12.1. The first step's
    ``hold`` is 1; a cycle that starts from zero sets it to 0.
    """
    centre, half = 0.5 * (high + low), 0.5 * (high - low)
    ratio = centre / half
    rho = 1.0 / ratio
    steps = [Relaxation(0.0, 1.0 / centre, 1.0)]
    for _ in range(degree - 1):
        following = 1.0 / (2.0 * ratio - rho)
        steps.append(Relaxation(following * rho, 2.0 * following / half, 1.0))
        rho = following
    return tuple(steps)


def columns(inverse: Float) -> Float:
    """(s,n) columns of diagonal blocks (n/s,s,s), each as one vector; what ``relax`` takes.

    Many small products cost several times as much one by one as column by column.
    """
    return np.ascontiguousarray(inverse.transpose(2, 0, 1)).reshape(inverse.shape[1], -1)


def relax(
    inverse: Float, r_in: Float, t: Float | None, change: Float | None, guess: Float | None,
    step: Relaxation,
) -> tuple[Float, Float, Float]:  # fmt: skip
    """r = r_in - t, d = keep d + gain D^-1 r, x = hold x + d; returns (r, d, x), all (L,n).

    ``inverse`` (s,n) are the ``columns`` of the inverted diagonal blocks, zero on fixed unknowns.
    ``t``, ``change`` and ``guess`` are None where they are zero.
    """
    r = r_in if t is None else r_in - t
    size = len(inverse)
    d = np.empty_like(r)
    for one, into in zip(r, d, strict=True):
        np.multiply(inverse[0], np.repeat(one[::size], size), out=into)
        for k in range(1, size):
            into += inverse[k] * np.repeat(one[k::size], size)
    d *= step.gain
    if change is not None and step.keep:
        d += step.keep * change
    return r, d, d.copy() if guess is None or not step.hold else step.hold * guess + d
