"""The stability suite of vibration: questions are answered rightly, or it is said what is wrong.

A case asks for frequencies, loads of buckling, or a response, and knows the answer from a closed
form, from dense algebra, or from extended precision. Where a question makes no sense, that is the
answer.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchmarks.stability.nonlinear_suite import WARNED, LargeVerdict
from benchmarks.stability.suite import RIGHT, SILENT, STOPPED, TOLD
from gpusim.errors import GpusimError

__all__ = ["Answer", "VibrationCase", "judge_vibration", "run_vibration"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Answer:
    """``values`` (V,) and what they should be; NaN: there is no answer. ``stated``: the error that
    is stated of them, NaN if none is. ``says``: messages and warnings."""

    values: Float
    expected: Float
    source: str
    stated: float = float("nan")
    converged: bool = True
    says: str = ""
    unknowns: int = 0

    @property
    def error(self) -> float:
        """Greatest relative one; of zeros, over the greatest expected value; inf where a value
        isn't finite."""
        if self.values.shape != self.expected.shape or not np.isfinite(self.values).all():
            return float("inf")
        if not np.isfinite(self.expected).all():
            return float("inf")
        if not len(self.expected):
            return 0.0
        size = np.abs(self.expected)
        size = np.where(size > 0.0, size, max(size.max(), 1e-300))
        return float((np.abs(self.values - self.expected) / size).max())


@dataclass(frozen=True)
class VibrationCase:
    """``ask`` answers, or raises what is refused. ``ending`` is how it has to end; ``cause``, a
    regular expression, what a message must say to count as naming the cause. ``same_mesh``: the
    expected values have the mesh's own error, so that what is stated has to hold, too."""

    family: str
    name: str
    ask: Callable[[], Answer]
    tolerance: float = 1e-8
    ending: str = RIGHT
    cause: str = ""
    same_mesh: bool = True
    quick: bool = False


# what rounding does to references
_ROUNDING = 1e-9


def judge_vibration(case: VibrationCase) -> LargeVerdict:
    """Ask one case's question."""
    verdict = LargeVerdict(case.family, case.name, case.ending, case.tolerance)
    begin = time.process_time()
    try:
        found = case.ask()
    except GpusimError as raised:
        message = f"{type(raised).__name__}: {raised}"
        ending = _named(case, message)
        return replace(verdict, verdict=ending, message=message,
                       seconds=time.process_time() - begin)  # fmt: skip
    except Exception as raised:  # whatever else comes out tells a user nothing
        return replace(verdict, message=f"{type(raised).__name__}: {raised}")
    error = found.error
    trusted = error <= case.tolerance
    if case.same_mesh and np.isfinite(found.stated):
        trusted = trusted and error <= found.stated + _ROUNDING
    if not found.converged:
        ending = _named(case, found.says)
    elif case.cause and re.search(case.cause, found.says):
        ending = WARNED
    else:
        ending = RIGHT if trusted else SILENT
    return replace(
        verdict, source=found.source, unknowns=found.unknowns, error=error, stated=found.stated,
        seconds=time.process_time() - begin, verdict=ending, message=found.says,
    )  # fmt: skip


def _named(case: VibrationCase, message: str) -> str:
    return TOLD if case.cause and re.search(case.cause, message) else STOPPED


def run_vibration(
    cases: Iterable[VibrationCase], tell: Callable[[LargeVerdict], None] | None = None
) -> list[LargeVerdict]:
    """Every case, in order; ``tell`` hears of each verdict at once."""
    verdicts = []
    for case in cases:
        verdicts.append(judge_vibration(case))
        if tell is not None:
            tell(verdicts[-1])
    return verdicts
