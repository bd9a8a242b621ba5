"""Run time of the solver against the error of its displacements, on this machine's adapter.

Each solve is cold, in a process of its own. The clock runs around `gpusim.fem.solve` alone and
holds everything it does: checks, assembly, set-up, opening the device, compiling kernels,
iterations, reactions. Python's imports and the making of the mesh come before.
"""

from __future__ import annotations

import hashlib
import os
import platform
import resource
import time
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numpy as np
from loky import ProcessPoolExecutor

from gpusim._version import __version__
from gpusim.bench.solver_cases import Case
from gpusim.errors import GpusimError
from gpusim.fem import solve
from gpusim.files.atomic_files import atomic_stream, write_text
from gpusim.gpu import default_device

P = ParamSpec("P")
R = TypeVar("R")


def solve_cold(
    case: Case,
    tolerance: float,
    *,
    load_cases: int = 1,
    reference: Path | None = None,
    write: Path | None = None,
) -> dict[str, Any]:
    """Solve one case; times, iterations, memory and the error as plain values.

    ``reference``: a file of displacements with which the result is compared; ``write``: one for it.
    """
    model = case.model(load_cases)
    before = _peak_kib()
    start = time.perf_counter()
    try:
        solution = solve(model, tolerance=tolerance, formulation={case.kind: case.rule})
    except GpusimError as error:
        return {"failed": f"{type(error).__name__}: {error}"}
    seconds = time.perf_counter() - start
    first = solution.u if solution.u.ndim == 2 else solution.u[0]
    result: dict[str, Any] = {
        "tolerance": tolerance,
        "seconds": seconds,
        "timings": dict(solution.timings),
        "iterations": solution.iterations,
        "converged": solution.converged,
        "message": solution.message,
        "stated": solution.error_estimate,
        "path": f"{solution.method}, {solution.backend}, {solution.real}",
        "unknowns": solution.unknowns,
        "before_kib": before,
        "peak_kib": _peak_kib(),
    }
    if reference is not None:
        wanted = np.load(reference)
        result["error"] = float(np.abs(first - wanted).max() / np.abs(wanted).max())
    if write is not None:
        with atomic_stream(write) as stream:
            np.save(stream, first)
    return result


def _peak_kib() -> int:
    """The most memory that this process has had."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


Tell = Callable[[str], None]

REFERENCE_TOLERANCE = 1e-10
TOLERANCES = (1e-3, 1e-6, 1e-8)
LIMIT_S = 3600.0


@dataclass(frozen=True)
class Point:
    """One run: seconds of everything counted, and the error it reached.

    ``setup_s`` holds assembly too for gpusim, and not for other programs, which are given the
    matrix. ``difference`` is to the reference; ``error`` the same, but for another program on a
    slender body to the exact solution of the matrix it was given, whose rounding to float64 it
    can't help. ``stated``: a solver's own estimate of it, NaN where it makes none.
    """

    solver: str
    tolerance: float
    setup_s: float
    solve_s: float
    error: float
    iterations: int
    peak_kib: float
    difference: float
    note: str = ""
    stated: float = float("nan")

    @property
    def seconds(self) -> float:
        return self.setup_s + self.solve_s


@dataclass
class CaseResult:
    """The runs of one case; ``timings`` and ``path`` are those of the run at tolerance 1e-6."""

    case: str
    family: str
    unknowns: int = 0
    points: list[Point] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    bytes_per_unknown: float = float("nan")
    timings: dict[str, float] = field(default_factory=dict)
    path: str = ""

    def fail(self, text: str, tell: Tell) -> None:
        self.failures.append(text)
        tell(f"{self.case}: {text}")

    def add(self, point: Point, tell: Tell) -> None:
        self.points.append(point)
        tell(f"{self.case}: {describe(point)}")


def run_solver_bench(
    cases: Sequence[Case], work: Path, tell: Tell, save: Callable[[list[CaseResult]], object]
) -> list[CaseResult]:
    """Every case at three tolerances; ``work`` is a folder that keeps references.

    A case that fails is reported as such, and the next one is run. ``save`` is called with what
    there is after each, so that an interrupted run keeps its results.
    """
    results = []
    for case in cases:
        result = CaseResult(case.name, case.family)
        results.append(result)
        try:
            measure_case(case, result, reference_of(case, work, tell), tell)
        except GpusimError as error:
            result.fail(str(error), tell)
        save(results)
    return results


def measure_case(case: Case, result: CaseResult, reference: Path, tell: Tell) -> None:
    """gpusim's runs of one case, each cold, in a fresh process; large ones at 1e-6 alone."""
    for tolerance in TOLERANCES if case.size != "full" else (1e-6,):
        run = in_fresh_process(case.name, solve_cold, case, tolerance, reference=reference)
        if "failed" in run:
            result.fail(f"gpusim at {tolerance:g}: {run['failed']}", tell)
            continue
        timings = run["timings"]
        result.unknowns, result.path = run["unknowns"], run["path"]
        if tolerance == 1e-6:
            result.timings = timings
            grown = max(run["peak_kib"] - run["before_kib"], 0)
            result.bytes_per_unknown = 1024.0 * grown / run["unknowns"]
        solve_s = timings.get("iterations", 0.0) + timings.get("reactions", 0.0)
        note = "" if run["converged"] else f"not converged: {run['message']}"
        result.add(Point("gpusim", tolerance, run["seconds"] - solve_s, solve_s, run["error"],
                         run["iterations"], run["peak_kib"], run["error"], note, run["stated"]),
                   tell)  # fmt: skip


def reference_of(case: Case, work: Path, tell: Tell) -> Path:
    """The file in ``work`` with displacements at a tolerance of 1e-10, made unless it is there."""
    facts = repr((case.name, case.rule, case.lengths, case.divisions, case.material))
    path = work / case.name / f"{hashlib.sha256(facts.encode()).hexdigest()[:16]}.npy"
    if not path.exists():
        tell(f"{case.name}: reference, tolerance {REFERENCE_TOLERANCE:g}")
        made = in_fresh_process(case.name, solve_cold, case, REFERENCE_TOLERANCE, write=path)
        if "failed" in made:
            raise GpusimError(f"bench {case.name}: no reference: {made['failed']}")
    return path


def describe(point: Point) -> str:
    """One line for the screen."""
    return (
        f"{point.solver}: {point.setup_s:.2f} + {point.solve_s:.2f} s, error {point.error:.1e}"
        f" (to the reference {point.difference:.1e}, stated {error_text(point.stated)}), "
        f"{point.iterations} iterations"
        f"{f' ({point.note})' if point.note else ''}"
    )


def in_fresh_process(name: str, function: Callable[P, R], *args: P.args, **options: P.kwargs) -> R:
    """What a function returns that is called in a process of its own; ``name``: of the case."""
    pool = ProcessPoolExecutor(1)
    try:
        result: R = pool.submit(function, *args, **options).result(LIMIT_S)
    except TimeoutError:
        raise GpusimError(f"bench {name}: stopped after {LIMIT_S:.0f} s") from None
    except BrokenExecutor as error:
        raise GpusimError(f"bench {name}: the solve's process failed: {error}") from error
    finally:
        pool.shutdown(kill_workers=True)
    return result


def machine() -> str:
    """What the numbers were measured on."""
    return (
        f"gpusim {__version__}, {default_device().name}, {os.cpu_count()} cores, "
        f"{platform.system()} {platform.machine()}, NumPy {np.__version__}"
    )


def write_solver(cases: Sequence[CaseResult], folder: Path) -> Path:
    """``solver.md`` in ``folder``."""
    lines = [
        "# Solver: run time against displacement error", "", machine(), "",
        "Each run is cold, in a fresh process, wall-clock seconds of everything from the model to "
        "displacements and reactions. Errors are the greatest difference to the reference (gpusim "
        "at tolerance 1e-10) over the greatest displacement.",
    ]  # fmt: skip
    for case in cases:
        lines += ["", f"## {case.case}: {case.unknowns} unknowns", "", *solver_table(case)]
    return write_text(folder / "solver.md", "\n".join(lines) + "\n")


def solver_table(case: CaseResult) -> list[str]:
    """Every run of one case."""
    parts = ", ".join(f"{name} {seconds:.2f}" for name, seconds in case.timings.items())
    lines = [
        f"gpusim: {case.path}; seconds: {parts}.", "",
        "| solver | tolerance | set-up s | solve s | total s | error | to reference | stated "
        "| iterations | peak MB |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for p in case.points:
        note = f" ({p.note})" if p.note else ""
        lines.append(
            f"| {p.solver}{note} | {p.tolerance:g} | {p.setup_s:.2f} | {p.solve_s:.2f} "
            f"| {p.seconds:.2f} | {error_text(p.error)} | {error_text(p.difference)} "
            f"| {error_text(p.stated)} | {p.iterations} | {p.peak_kib / 1024:.0f} |"
        )
    return lines + ([""] if case.failures else []) + [f"- {text}" for text in case.failures]


def error_text(value: float) -> str:
    return f"{value:.1e}" if np.isfinite(value) else "-"
