"""The stability suite at large displacements: every case is right, or it is said what is wrong.

A case states a question and its answer, from a closed form, an integrated bar, or a second program.
Where a load has no equilibrium, or the question makes no sense, that is the answer.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.stability.suite import RIGHT, SILENT, STOPPED, TOLD
from gpusim.errors import GpusimError
from gpusim.fem import LoadStep, Model, Solution, solve

__all__ = ["WARNED", "LargeCase", "LargeVerdict", "Question", "describe", "judge", "run_cases"]

Float = npt.NDArray[np.float64]

WARNED = "warned"
"""Converged, and a warning names what is doubtful."""


@dataclass(frozen=True)
class Question:
    """A model, its load ``factors``, and the ``expected`` (K,V) ``values`` of each load step.

    Errors are relative to ``size``, or to the greatest expected value of each column. A row of NaN:
    there is no (stable) equilibrium. ``options`` go to `solve`.
    """

    model: Model
    factors: npt.ArrayLike | None
    values: Callable[[LoadStep], Float]
    expected: Float
    source: str
    size: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class LargeCase:
    """``build`` makes the question, or raises what is refused before there is a model.

    ``ending`` is how it has to end; ``cause``, a regular expression, what a message or warning must
    say to count as naming the cause. ``tolerance`` of its values: what the mesh reaches. ``quick``:
    part of the test suite.
    """

    family: str
    name: str
    build: Callable[[], Question]
    tolerance: float = 1e-3
    ending: str = RIGHT
    cause: str = ""
    quick: bool = False


@dataclass(frozen=True)
class LargeVerdict:
    """How a case ended: "right" (within its tolerance), "warned", "told" (an error, or not
    converged; the cause is named, steps before are right), "stopped" (not named), "SILENT FAILURE".
    """

    family: str
    case: str
    wanted: str
    tolerance: float
    source: str = ""
    unknowns: int = 0
    error: float = float("nan")
    stated: float = float("nan")
    iterations: int = 0
    seconds: float = 0.0
    verdict: str = SILENT
    message: str = ""


def judge(case: LargeCase, solver: Callable[..., Solution] = solve) -> LargeVerdict:
    """Ask ``solver`` the question of one case."""
    verdict = LargeVerdict(case.family, case.name, case.ending, case.tolerance)
    begin = time.process_time()
    try:
        question = case.build()
        verdict = replace(verdict, source=question.source)
        begin = time.process_time()
        found = solver(
            question.model, geometry="nonlinear", factors=question.factors, **question.options
        )
    except GpusimError as raised:
        message = f"{type(raised).__name__}: {raised}"
        verdict = replace(verdict, verdict=_named(case, message, TOLD), message=message)
        return replace(verdict, seconds=time.process_time() - begin)
    except Exception as raised:  # whatever else comes out tells a user nothing
        return replace(verdict, message=f"{type(raised).__name__}: {raised}")
    steps = [step for step in found.steps if step.wanted]
    error = greatest_error(question, steps)
    warnings = "; ".join(found.warnings)
    if not found.converged:
        message, ending = found.message, _named(case, found.message, TOLD)
        ending = SILENT if error > case.tolerance else ending
    elif case.cause and re.search(case.cause, warnings):
        message, ending = warnings, WARNED
    else:
        message, ending = warnings, RIGHT if error <= case.tolerance else SILENT
    return replace(
        verdict,
        unknowns=found.unknowns,
        error=error,
        stated=found.error_estimate,
        iterations=sum(len(step.iterations) for step in found.steps),
        seconds=time.process_time() - begin,
        verdict=ending,
        message=message,
    )


def _named(case: LargeCase, message: str, ending: str) -> str:
    return ending if case.cause and re.search(case.cause, message) else STOPPED


def greatest_error(question: Question, steps: Sequence[LoadStep]) -> float:
    """Of the values of the ``steps`` that there are, relative; inf where one isn't finite, or no
    equilibrium was expected."""
    expected = np.asarray(question.expected, dtype=np.float64)
    worst = 0.0
    size = question.size
    if size is None:
        size = np.nan_to_num(np.abs(expected)).max(axis=0)
        size = np.where(size > 0.0, size, 1.0)
    for step, wanted in zip(steps, expected, strict=False):
        error = np.abs(np.asarray(question.values(step)) - wanted) / size
        worst = max(worst, float(error.max()) if np.isfinite(error).all() else float("inf"))
    return worst


def run_cases(
    cases: Iterable[LargeCase], tell: Callable[[LargeVerdict], None] | None = None
) -> list[LargeVerdict]:
    """Every case, in order; ``tell`` hears of each verdict at once."""
    verdicts = []
    for case in cases:
        verdicts.append(judge(case))
        if tell is not None:
            tell(verdicts[-1])
    return verdicts


def describe(verdict: LargeVerdict) -> str:
    """One line for the screen."""
    ending = verdict.verdict if verdict.verdict == verdict.wanted else (
        f"{verdict.verdict}, WANTED {verdict.wanted}"
    )  # fmt: skip
    return (
        f"{verdict.family + ': ' + verdict.case:<64} error {verdict.error:.1e} "
        f"{verdict.iterations:4d} iterations {verdict.seconds:5.1f} s  "
        f"{ending}{': ' + verdict.message if verdict.message else ''}"
    )
