"""The stability suite: every hard case is right within its stated error, or an error says why."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchmarks.solver.reference import Reference, reference_solution
from benchmarks.stability.hard_cases import HardCase, hard_cases
from gpusim.errors import GpusimError
from gpusim.fem import Model, solve
from gpusim.gpu import Device

__all__ = [
    "RIGHT",
    "SILENT",
    "STOPPED",
    "TOLD",
    "WAYS",
    "Verdict",
    "describe",
    "run_suite",
    "try_case",
]

Float = npt.NDArray[np.float64]

# way -> (method, backend, the device's arithmetic where it isn't its own choice)
WAYS = {
    "auto": ("auto", "gpu", None),
    "multigrid": ("multigrid", "gpu", None),
    "double-single": ("multigrid", "gpu", "double_single"),
    "numpy": ("multigrid", "numpy", None),
}
RIGHT, TOLD, STOPPED, SILENT = "right", "told", "stopped", "SILENT FAILURE"
# what a message must speak of to count as naming the cause
_CAUSES = ("slender", "aspect", "thin", "inverted", "condition", "rounding", "precision", "digits",
           "contrast", "incompressib", "rigid", "stiff")  # fmt: skip


@dataclass(frozen=True)
class Verdict:
    """One case, solved in one way of `WAYS`.

    ``error`` greatest relative error over load cases, max norm, against the reference;
    ``stated`` the solver's own estimate; NaN where nothing was returned. ``verdict``: "right"
    (converged, and the error is at most the tolerance), "told" (an error, or ``converged`` false,
    whose ``message`` names a cause), "stopped" (marked as not converged, without a cause),
    "SILENT FAILURE" (converged, and wrong; or an exception that isn't gpusim's own).
    """

    case: str
    family: str
    value: float
    way: str
    tolerance: float
    unknowns: int = 0
    error: float = float("nan")
    stated: float = float("nan")
    iterations: int = 0
    seconds: float = 0.0
    verdict: str = SILENT
    message: str = ""


def relative_error(u: Float, wanted: Float) -> float:
    """Greatest over load cases of max |u - wanted| / max |wanted|; inf where u isn't finite."""
    if u.shape != wanted.shape or not np.isfinite(u).all():
        return float("inf")
    size = np.abs(wanted).max(axis=(1, 2))
    difference = np.abs(u - wanted).max(axis=(1, 2))
    return float((difference / np.where(size > 0.0, size, 1.0)).max())


def try_case(
    case: HardCase,
    way: str,
    device: Device | None,
    known: tuple[Model, Reference],
    tolerance: float = 1e-6,
) -> Verdict:
    """Solve one case, built as ``known``, and judge the answer by its own tolerance, or this."""
    model, reference = known
    tolerance = tolerance if case.tolerance is None else case.tolerance
    verdict = Verdict(case.name, case.family, case.value, way, tolerance)
    method, backend, _ = WAYS[way]
    start = time.perf_counter()
    try:
        solution = solve(
            model,
            device,
            tolerance=tolerance,
            formulation=case.rules,
            backend=backend,
            method=method,
        )
    except GpusimError as raised:
        message = f"{type(raised).__name__}: {raised}"
        kind = _told(message)
        return replace(verdict, verdict=kind, message=message, seconds=time.perf_counter() - start)
    except Exception as raised:  # whatever else comes out tells a user nothing
        return replace(verdict, message=f"{type(raised).__name__}: {raised}")
    error = relative_error(solution.u if solution.u.ndim == 3 else solution.u[None], reference.u)
    stated = solution.error_estimate
    if not solution.converged:
        kind = _told(solution.message)
    else:
        kind = RIGHT if error <= tolerance and stated <= tolerance else SILENT
    return replace(
        verdict,
        unknowns=solution.unknowns,
        error=error,
        stated=stated,
        iterations=solution.iterations,
        seconds=time.perf_counter() - start,
        verdict=kind,
        message=solution.message,
    )


def _told(message: str) -> str:
    return TOLD if any(word in message for word in _CAUSES) else STOPPED


def run_suite(
    cases: Iterable[HardCase] | None = None,
    ways: Iterable[str] = tuple(WAYS),
    tolerance: float = 1e-6,
    tell: Callable[[Verdict], None] | None = None,
) -> list[Verdict]:
    """Every case in every way, in order; ``tell`` hears of each verdict at once."""
    devices = {way: Device(real=WAYS[way][2]) if WAYS[way][1] == "gpu" else None for way in ways}
    verdicts = []
    for case in hard_cases() if cases is None else cases:
        try:
            model = case.build()
        except GpusimError as raised:  # a mesh that is refused before any solve
            message = f"{type(raised).__name__}: {raised}"
            refused = Verdict(case.name, case.family, case.value, "mesh", tolerance,
                              verdict=_told(message), message=message)  # fmt: skip
            found = [refused]
        else:
            known = model, reference_solution(model, case.rules)
            found = [
                try_case(case, way, device, known, tolerance) for way, device in devices.items()
            ]
        verdicts += found
        if tell is not None:
            for verdict in found:
                tell(verdict)
    return verdicts


def describe(verdict: Verdict) -> str:
    """One line for the screen."""
    return (
        f"{verdict.case:<44} {verdict.way:<13} error {verdict.error:.1e} "
        f"stated {verdict.stated:.1e} {verdict.iterations:5d} iterations {verdict.seconds:6.1f} s  "
        f"{verdict.verdict}{'' if verdict.verdict == RIGHT else ': ' + verdict.message}"
    )
