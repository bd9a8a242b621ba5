"""Comparing a kernel with its NumPy twin, and the registry that ``gpusim doctor`` runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from pkgutil import iter_modules
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError, TwinMismatch
from gpusim.gpu.device import Device
from gpusim.validation import require


@dataclass(frozen=True)
class Tolerance:
    """``|device - twin| <= atol + rtol * |twin|``, and why that is the right size."""

    atol: float
    rtol: float
    reason: str


TOLERANCES = {
    "exact": Tolerance(0.0, 0.0, "integers and copies"),
    "real": Tolerance(1e-13, 1e-11, "f64 or double-single sums in another order"),
    "single": Tolerance(1e-6, 1e-5, "one float32 evaluation of well-scaled values"),
    "pixel": Tolerance(2e-5, 2e-5, "radiance of a pixel in float32: coverage errors of 1e-5 px"),
}
"""The usual tolerances; a stage that needs another one passes its own and says why."""


def compare(
    what: str,
    device: npt.ArrayLike,
    twin: npt.ArrayLike,
    tolerance: str | Tolerance = "single",
    *,
    atol: float | None = None,
    rtol: float | None = None,
) -> float:
    """Raise unless both agree everywhere; return the largest difference.

    Raises
    ------
    TwinMismatch
        Shapes differ, a value is NaN or infinite on either side, or a difference exceeds
        ``atol + rtol * |twin|`` (from ``tolerance``, a name of `TOLERANCES` or one's own, unless
        given). Names the worst index, both values and how many are off.
    """
    known = not isinstance(tolerance, str) or tolerance in TOLERANCES
    require(known, "tolerance", repr(tolerance), f"one of {sorted(TOLERANCES)}")
    table = TOLERANCES[tolerance] if isinstance(tolerance, str) else tolerance
    got, want = np.asarray(device), np.asarray(twin)
    if got.shape != want.shape:
        raise TwinMismatch(f"{what}: shapes differ; device {got.shape}, twin {want.shape}")
    if got.size == 0:
        raise TwinMismatch(f"{what}: nothing to compare")
    got64, want64 = got.astype(np.float64), want.astype(np.float64)
    for name, values in (("device", got64), ("twin", want64)):
        bad = ~np.isfinite(values)
        if bad.any():
            index = tuple(int(i) for i in np.argwhere(bad)[0])
            raise TwinMismatch(f"{what}: {name} not finite at {index} ({int(bad.sum())} values)")
    allowed = (table.atol if atol is None else atol) + (
        table.rtol if rtol is None else rtol
    ) * np.abs(want64)
    if np.result_type(got, want).kind in "iu":  # above 2**53 float64 would round differences away
        whole = np.result_type(got, want, np.int32)
        difference = (np.maximum(got, want).astype(whole) - np.minimum(got, want)).astype(float)
    else:
        difference = np.abs(got64 - want64)
    fine = difference <= allowed
    if not fine.all():
        worst = np.unravel_index(int(np.argmax(difference - allowed)), difference.shape)
        index = tuple(int(i) for i in worst)
        raise TwinMismatch(
            f"{what}: {int((~fine).sum())} of {fine.size} values off; worst at {index}: "
            f"device {got64[worst]:.9g}, twin {want64[worst]:.9g}, "
            f"allowed {np.broadcast_to(allowed, fine.shape)[worst]:.3g}"
        )
    return float(difference.max())


class Pair(NamedTuple):
    """What the device and its twin made of the same input; ``tolerance`` if it isn't that of the
    check, ``part``: of the stage's results."""

    device: npt.ArrayLike
    twin: npt.ArrayLike
    tolerance: str | Tolerance | None = None
    part: str = ""


Pairs = Iterator[Pair]
"""What a check yields: all of them have to agree."""

_CHECKS: dict[str, Callable[[Device], None]] = {}


def twin_check(
    stage: str, tolerance: str | Tolerance = "single"
) -> Callable[[Callable[[Device], Pairs]], Callable[[Device], Pairs]]:
    """Register a small device-against-twin comparison under the shader's name."""

    def register(pairs_on: Callable[[Device], Pairs]) -> Callable[[Device], Pairs]:
        def check(device: Device) -> None:
            for pair in pairs_on(device):
                what = f"{stage}.{pair.part}" if pair.part else stage
                compare(what, pair.device, pair.twin, pair.tolerance or tolerance)

        if stage in _CHECKS:
            raise InputError(f"twin check {stage!r} is registered twice")
        _CHECKS[stage] = check
        return pairs_on

    return register


def twin_checks() -> dict[str, Callable[[Any], None]]:
    """The checks of every stage that has a shader, by name, in alphabetical order.

    Importing the modules of `gpusim.gpu.probes` and `gpusim.twin_checks` registers them.
    """
    for package in ("gpusim.gpu.probes", "gpusim.twin_checks"):
        for module in iter_modules(import_module(package).__path__, f"{package}."):
            import_module(module.name)
    return dict(sorted(_CHECKS.items()))
