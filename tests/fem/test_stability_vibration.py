"""The quick part of the stability suite of vibration: right, or said what is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.stability.nonlinear_suite import WARNED
from benchmarks.stability.suite import RIGHT, SILENT, STOPPED, TOLD
from benchmarks.stability.vibration_cases import vibration_cases
from benchmarks.stability.vibration_suite import (
    Answer,
    VibrationCase,
    judge_vibration,
    run_vibration,
)
from gpusim.errors import NotConverged

CASES = list(vibration_cases())
QUICK = [case for case in CASES if case.quick]


@pytest.mark.parametrize("case", QUICK, ids=lambda case: f"{case.family}, {case.name}")
def test_right_or_told(case: VibrationCase) -> None:
    verdict = judge_vibration(case)
    assert verdict.verdict == case.ending, f"error {verdict.error:.1e}: {verdict.message}"


def test_every_ending_and_family_is_there() -> None:
    names = [(case.family, case.name) for case in CASES]
    assert len(set(names)) == len(names) >= 85
    assert {case.ending for case in QUICK} == {RIGHT, TOLD}
    assert all(case.cause for case in CASES if case.ending != RIGHT)


def answer(value: float, **more: object) -> VibrationCase:
    found = Answer(np.array([value]), np.array([2.0]), "nobody")
    found = replace(found, **more)  # type: ignore[arg-type]
    return VibrationCase("made up", "case", lambda: found, 1e-6, cause="soft")


@pytest.mark.parametrize(
    ("case", "ending"),
    [
        (answer(2.0), RIGHT),
        (answer(2.0 + 1e-5), SILENT),
        (answer(np.nan), SILENT),
        # near enough, but further off than is stated
        (answer(2.0 + 1e-6, stated=1e-8), SILENT),
        (answer(2.0 + 1e-6, stated=1e-6), RIGHT),
        (answer(2.0, expected=np.array([np.nan])), SILENT),
        (answer(2.0, expected=np.array([2.0, 3.0])), SILENT),
        (answer(9.0, says="a soft body"), WARNED),
        (answer(9.0, converged=False, says="a soft body"), TOLD),
        (answer(9.0, converged=False, says="no luck"), STOPPED),
    ],
)
def test_endings_are_told_apart(case: VibrationCase, ending: str) -> None:
    assert judge_vibration(case).verdict == ending


@pytest.mark.parametrize(
    ("error", "ending"),
    [
        (NotConverged("a soft body"), TOLD),
        (NotConverged("no luck"), STOPPED),
        (ZeroDivisionError("1/0"), SILENT),
    ],
)
def test_errors_are_told_apart(error: Exception, ending: str) -> None:
    def fails() -> Answer:
        raise error

    (verdict,) = run_vibration([replace(answer(2.0), ask=fails)])
    assert verdict.verdict == ending
