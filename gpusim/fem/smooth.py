"""Block-Jacobi and Chebyshev smoothing: twin and driver of ``shaders/fem/smooth.wgsl``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.arena import Allocator
from gpusim.gpu import Bindings, Device, Recording, compare, twin_check
from gpusim.gpu.buffer import RealBuffer

__all__ = ["DeviceSmoother", "Relaxation", "chebyshev", "relax"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Relaxation:
    """Factors of one step; rounded to float32, as the kernel takes them."""

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


def relax(
    inverse: Float, r_in: Float, t: Float | None, change: Float, guess: Float, step: Relaxation
) -> tuple[Float, Float, Float]:
    """r = r_in - t, d = keep d + gain D^-1 r, x = hold x + d; returns (r, d, x), all (L,n).

    ``inverse`` (n/s,s,s) holds the inverted diagonal blocks, zero on fixed unknowns.
    """
    r = r_in if t is None else r_in - t
    blocks = r.reshape(len(r), *inverse.shape[:2])
    z = np.matmul(inverse[None], blocks[..., None])[..., 0].reshape(r.shape)
    d = step.keep * change + step.gain * z
    return r, d, step.hold * guess + d


class DeviceSmoother:
    """The inverted diagonal blocks of one level on the device, and its dispatches."""

    def __init__(self, device: Allocator, inverse: Float, cases: int, label: str) -> None:
        self.device, self.cases = device, cases
        self.size = int(inverse.shape[1])
        self.unknowns = int(inverse.shape[0]) * self.size
        self.inverse = device.real_buffer(inverse, label=f"{label}.inverse")
        constants = {"size": float(self.size)}
        # threads per case: one per 3x3 block, else one per unknown
        small = self.size == 3
        self._threads = int(inverse.shape[0]) if small else self.unknowns
        entry = "relax3" if small else "relax"
        self._relax = device.kernel("fem/smooth", entry=entry, constants=constants)
        self._difference = device.kernel("fem/smooth", entry="difference", constants=constants)
        self._bound: dict[object, Bindings] = {}

    def record(
        self,
        recording: Recording,
        r_in: RealBuffer,
        t: RealBuffer | None,
        r_out: RealBuffer,
        change: RealBuffer,
        guess: RealBuffer,
        step: Relaxation,
    ) -> None:
        """Record one step; ``r_out`` must not be ``r_in``."""
        key = (id(r_in), id(t), id(r_out), id(change), id(guess), step)
        if key not in self._bound:
            self._bound[key] = self._relax.bind(
                r_in=r_in,
                product=r_in if t is None else t,
                inverse=self.inverse,
                r_out=r_out,
                change=change,
                guess=guess,
                params=self._params(t is not None, step),
            )
        recording.dispatch(self._relax, self._bound[key], threads=(self._threads * self.cases,))

    def record_difference(
        self, recording: Recording, r_in: RealBuffer, t: RealBuffer, r_out: RealBuffer
    ) -> None:
        """Record r_out = r_in - t."""
        key = (id(r_in), id(t), id(r_out))
        if key not in self._bound:
            self._bound[key] = self._difference.bind(
                r_in=r_in,
                product=t,
                r_out=r_out,
                params=self._params(True, Relaxation(0.0, 0.0, 0.0)),
            )
        recording.dispatch(
            self._difference, self._bound[key], threads=(self.unknowns * self.cases,)
        )

    def _params(self, subtract: bool, step: Relaxation) -> dict[str, float]:
        return {
            "unknowns": self.unknowns,
            "cases": self.cases,
            "subtract": int(subtract),
            "keep": step.keep,
            "gain": step.gain,
            "hold": step.hold,
        }


@twin_check("fem/smooth")
def _check(device: Device) -> None:
    rng = np.random.default_rng(7)
    for size in (3, 6):
        inverse = rng.normal(size=(11, size, size))
        r, t, d, x = rng.normal(size=(4, 2, 11 * size))
        r_in, t_in, r_out, change, guess = (
            device.real_buffer(v, label="fem.check.v") for v in (r, t, r * 0.0, d, x)
        )
        step = Relaxation(0.3, 0.7, 1.0)
        with device.recording("fem.check") as recording:
            smoother = DeviceSmoother(device, inverse, 2, "fem.check")
            smoother.record(recording, r_in, t_in, r_out, change, guess, step)
        wanted = relax(inverse, r, t, d, x, step)
        for buffer, value in zip((r_out, change, guess), wanted, strict=True):
            compare("fem/smooth.relax", buffer.read(), value, atol=1e-12, rtol=1e-12)
