"""Hard models: each is right within its stated error, or an error names the cause:
``python -m benchmarks.stability``, by linear theory, with ``--large`` at large displacements, or
with ``--vibration`` of what vibrates; ends with 1 after a silent failure."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from benchmarks.stability import nonlinear_suite
from benchmarks.stability.hard_cases import hard_cases
from benchmarks.stability.nonlinear_cases import large_cases
from benchmarks.stability.suite import SILENT, WAYS, describe, run_suite
from benchmarks.stability.tables import write_large, write_stability, write_vibration
from benchmarks.stability.vibration_cases import vibration_cases
from benchmarks.stability.vibration_suite import run_vibration
from gpusim.gpu import default_device


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--case", default="", metavar="TEXT", help="part of the cases' names")
    parser.add_argument("--quick", action="store_true", help="the cases of the test suite")
    other = parser.add_mutually_exclusive_group()
    other.add_argument("--large", action="store_true", help="those at large displacements")
    other.add_argument("--vibration", action="store_true", help="those of what vibrates")
    parser.add_argument("--way", choices=WAYS, action="append", help="repeatable; default all")
    parser.add_argument("-o", "--output", type=Path, default=Path("bench"), metavar="DIR")
    given = parser.parse_args()
    if given.large:
        return _large(given.case, given.quick, given.output)
    if given.vibration:
        return _vibration(given.case, given.quick, given.output)
    cases = [c for c in hard_cases() if given.case in c.name and (c.quick or not given.quick)]
    if not cases:
        parser.error(f"--case; got {given.case!r}; no case's name holds it")
    verdicts = run_suite(cases, given.way or tuple(WAYS), tell=lambda v: print(describe(v)))
    for path in write_stability(verdicts, given.output, default_device().name):
        print(path)
    silent = sum(v.verdict == SILENT for v in verdicts)
    print(f"{len(verdicts)} solves, {silent} silent failures")
    return 1 if silent else 0


def _large(text: str, quick: bool, output: Path) -> int:
    cases = [c for c in large_cases() if text in f"{c.family}: {c.name}" and (c.quick or not quick)]
    verdicts = nonlinear_suite.run_cases(
        cases, tell=lambda v: print(nonlinear_suite.describe(v), flush=True)
    )
    print(write_large(verdicts, output))
    return _count(verdicts)


def _vibration(text: str, quick: bool, output: Path) -> int:
    cases = [c for c in vibration_cases() if text in f"{c.family}: {c.name}"]
    verdicts = run_vibration(
        [c for c in cases if c.quick or not quick],
        tell=lambda v: print(nonlinear_suite.describe(v), flush=True),
    )
    print(write_vibration(verdicts, output))
    return _count(verdicts)


def _count(verdicts: Sequence[nonlinear_suite.LargeVerdict]) -> int:
    silent = sum(v.verdict == SILENT for v in verdicts)
    print(f"{len(verdicts)} cases, {silent} silent failures")
    return 1 if silent else 0


if __name__ == "__main__":
    raise SystemExit(main())
