"""The quick part of the stability suite at large displacements: right, or said what is wrong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.stability.nonlinear_cases import large_cases
from benchmarks.stability.nonlinear_suite import WARNED, LargeCase, judge, run_cases
from benchmarks.stability.suite import RIGHT, SILENT, STOPPED, TOLD
from gpusim.errors import NotConverged
from gpusim.fem import Solution, solve

CASES = list(large_cases())
QUICK = [case for case in CASES if case.quick]


@pytest.mark.parametrize("case", QUICK, ids=lambda case: f"{case.family}, {case.name}")
def test_right_or_told(case: LargeCase) -> None:
    verdict = judge(case)
    assert verdict.verdict == case.ending, f"error {verdict.error:.1e}: {verdict.message}"


def test_every_ending_and_family_is_there() -> None:
    names = [(case.family, case.name) for case in CASES]
    assert len(set(names)) == len(names) >= 140
    assert {case.ending for case in QUICK} == {RIGHT, TOLD, WARNED}
    assert all(case.cause for case in CASES if case.ending != RIGHT)


def named(text: str) -> LargeCase:
    (case,) = [case for case in CASES if text in f"{case.family}, {case.name}"]
    return case


def test_a_wrong_answer_is_a_silent_failure() -> None:
    case = named("hardening, there and back")

    def liar(*arguments: Any, **options: Any) -> Solution:
        found = solve(*arguments, **options)
        steps = [replace(step, u=step.u * (1.0 + 3e-4)) for step in found.steps]
        return replace(found, steps=tuple(steps))

    assert judge(case).verdict == RIGHT
    wrong = judge(case, liar)
    assert wrong.verdict == SILENT and wrong.error > case.tolerance


def test_a_load_that_has_no_equilibrium_is_not_answered() -> None:
    case = named("1.5 of Euler, perfect")

    def quiet(*arguments: Any, **options: Any) -> Solution:
        return replace(solve(*arguments, **options), warnings=())

    assert judge(case).verdict == WARNED
    assert judge(case, quiet).verdict == SILENT


@pytest.mark.parametrize(
    ("error", "ending"),
    [
        (NotConverged("loads turned back at 0.9 (a limit load?)"), TOLD),
        (NotConverged("no luck"), STOPPED),
        (ZeroDivisionError("1/0"), SILENT),
    ],
)
def test_other_endings_are_told_apart(error: Exception, ending: str) -> None:
    def fails(*arguments: Any, **options: Any) -> Solution:
        raise error

    assert judge(named("perfectly plastic, [1.05]"), fails).verdict == ending


def test_steps_before_one_that_is_told_of_are_judged() -> None:
    case = named("perfectly plastic, 0.99")
    asked = case.build()

    def stops(*arguments: Any, **options: Any) -> Solution:
        found = solve(asked.model, geometry="nonlinear", factors=asked.factors)
        steps = tuple(replace(step, u=np.full_like(step.u, np.nan)) for step in found.steps)
        return replace(found, steps=steps, converged=False, message="a limit load")

    told = replace(case, ending=TOLD, cause="limit")
    (verdict,) = run_cases([told])
    assert verdict.verdict == RIGHT
    assert judge(told, stops).verdict == SILENT
