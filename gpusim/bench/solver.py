"""The solver benchmark: run time against displacement error, beside other solvers."""

from __future__ import annotations

import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gpusim._version import __version__
from gpusim.bench.cases import Case
from gpusim.bench.peers import EXACT, PEERS, Peer, peer_folder, run_peer
from gpusim.errors import GpusimError

__all__ = ["CaseResult", "Point", "SolverResult", "run_solver_bench"]

Tell = Callable[[str], None]

ENOUGH = 1e-6
REFERENCE_TOLERANCE = 1e-10
_LIMIT_S = 3600.0


@dataclass(frozen=True)
class Point:
    """One run: seconds of everything counted, and the error it reached.

    ``setup_s`` holds assembly too for gpusim, and not for peers, who are given the matrix.
    ``difference`` is to the reference; ``error`` the same, but for a peer on a slender body to the
    exact solution of the matrix it was given, whose rounding to float64 it can't help.
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

    @property
    def seconds(self) -> float:
        return self.setup_s + self.solve_s


@dataclass
class CaseResult:
    """``checks``: differences between the reference and other solvers' best answers."""

    case: str
    family: str
    unknowns: int
    points: list[Point] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    second_case: float = float("nan")
    bytes_per_unknown: float = float("nan")
    operator: dict[str, Any] = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)
    path: str = ""

    def own(self) -> Point | None:
        """gpusim's run at the default tolerance, if it is right to 1e-6."""
        own = [p for p in self.points if p.solver == "gpusim" and p.tolerance == ENOUGH]
        return _fastest(own)

    def best_peer(self, whole_runs: bool = False) -> Point | None:
        """The fastest peer that is right to 1e-6; CalculiX's whole runs count apart."""
        return _fastest(
            [
                p for p in self.points
                if p.solver != "gpusim" and p.solver.startswith("CalculiX") == whole_runs
            ]
        )  # fmt: skip


@dataclass
class SolverResult:
    """Everything measured, ready for `gpusim.bench.tables`."""

    machine: str
    cases: list[CaseResult] = field(default_factory=list)

    def exponents(self) -> dict[str, float]:
        """Per family with three sizes or more, the exponent of time against unknowns."""
        found = {}
        for family in dict.fromkeys(case.family for case in self.cases):
            pairs = [
                (case.unknowns, own.seconds)
                for case in self.cases
                if case.family == family and case.unknowns >= 25_000 and (own := case.own())
            ]
            if len(pairs) >= 3:
                size, seconds = np.log(np.array(pairs)).T
                found[family] = float(np.polyfit(size, seconds, 1)[0])
        return found


def _fastest(points: Sequence[Point]) -> Point | None:
    right = [p for p in points if p.error <= ENOUGH]
    return min(right, key=lambda p: p.seconds) if right else None


def run_solver_bench(
    cases: Sequence[Case],
    work: Path,
    *,
    peers: Sequence[Peer] = PEERS,
    repeat: int = 3,
    tell: Tell = print,
    keep: bool = False,
    save: Callable[[SolverResult], object] = lambda result: None,
) -> SolverResult:
    """Run every case; ``work`` is a folder for references (kept) and the peers' arrays.

    ``repeat`` pairs of runs, with one load case and with two, tell what a second one costs.

    A case that fails is reported as such, and the next one is run. ``save`` is called with what
    there is after each, so that an interrupted run keeps its results.
    """
    result = SolverResult(_machine())
    for case in cases:
        try:
            result.cases.append(_run_case(case, work / case.name, peers, repeat, tell))
        except GpusimError as error:
            result.cases.append(CaseResult(case.name, case.family, 0, failures=[str(error)]))
            tell(str(error))
        if not keep:
            shutil.rmtree(work / case.name / "problem", ignore_errors=True)
        save(result)
    return result


def _run_case(
    case: Case, folder: Path, peers: Sequence[Peer], repeat: int, tell: Tell
) -> CaseResult:
    scripts = peer_folder() if peers else None
    problem = folder / "problem"
    reference = folder / "reference"
    want_problem = scripts is not None and case.peers
    stamp = json.dumps(case.describe(), sort_keys=True)
    if not _is_current(reference, stamp) or (want_problem and not (problem / "u.npy").exists()):
        tell(f"{case.name}: reference, tolerance {REFERENCE_TOLERANCE:g}")
        made = _worker(case, {"tolerance": REFERENCE_TOLERANCE, "write": str(problem),
                              "export": want_problem})  # fmt: skip
        if "failed" in made:
            raise GpusimError(f"bench {case.name}: no reference: {made['failed']}")
        reference.mkdir(parents=True, exist_ok=True)
        shutil.copy(problem / "u.npy", reference / "u.npy")
        (reference / "case.json").write_text(stamp, encoding="utf-8")
    found = CaseResult(case.name, case.family, 0)
    small = case.size != "full"
    for tolerance in (1e-3, 1e-6, 1e-8) if small else (1e-6,):
        one = _worker(case, {"tolerance": tolerance, "reference": str(reference)})
        _take(found, one, tolerance, tell)
    found.second_case = _second_case(case, repeat)
    if want_problem:
        assert scripts is not None
        if case.family == "beam" and not (problem / "solved.npy").exists():
            for failed in run_peer(EXACT, scripts, problem, _LIMIT_S):
                _take_peer(found, failed, tell)
        for peer in peers:
            if not peer.takes(case, found.unknowns):
                continue
            for variant in run_peer(peer, scripts, problem, _LIMIT_S):
                _take_peer(found, variant, tell)
    try:
        operator = _worker(case, {"operator": True})
    except GpusimError as error:
        operator = {"failed": str(error)}
    found.operator = operator
    return found


def _second_case(case: Case, repeat: int) -> float:
    """What a second load case costs, over the first: of ``repeat`` alternating pairs of runs with
    one load case and with both, the least of each. Single runs of a second differ by a third on a
    shared machine, by more than what is to be told. NaN if one has failed."""
    least = [np.inf, np.inf]
    for _ in range(repeat):
        for cases in (1, 2):
            one = _worker(case, {"tolerance": ENOUGH, "load_cases": cases})
            if not one.get("converged"):
                return float("nan")
            least[cases - 1] = min(least[cases - 1], one["seconds"])
    return least[1] / least[0] - 1.0


def _is_current(folder: Path, stamp: str) -> bool:
    note = folder / "case.json"
    return (folder / "u.npy").exists() and note.exists() and note.read_text("utf-8") == stamp


def _take(found: CaseResult, one: dict[str, Any], tolerance: float, tell: Tell) -> None:
    if "failed" in one:
        found.failures.append(f"gpusim at {tolerance:g}: {one['failed']}")
        tell(f"{found.case}: {found.failures[-1]}")
        return
    found.unknowns, found.path = one["unknowns"], one["path"]
    timings = one["timings"]
    solve_s = timings.get("iterations", 0.0) + timings.get("reactions", 0.0)
    if tolerance == 1e-6:
        found.timings = timings
        grown = max(one["peak_kib"] - one["before_kib"], 0)
        found.bytes_per_unknown = 1024.0 * grown / one["unknowns"]
    note = "" if one["converged"] else f"not converged: {one['message']}"
    point = Point("gpusim", tolerance, one["seconds"] - solve_s, solve_s, one["error"],
                  one["iterations"], one["peak_kib"], one["error"], note)  # fmt: skip
    found.points.append(point)
    tell(f"{found.case}: {describe(point)}")


def _take_peer(found: CaseResult, variant: dict[str, Any], tell: Tell) -> None:
    if "failed" in variant:
        found.failures.append(f"{variant['name']}: {variant['failed']}")
        tell(f"{found.case}: {found.failures[-1]}")
        return
    for run in variant["runs"]:
        point = Point(
            variant["name"], run["tolerance"], variant["setup_s"], run["solve_s"], run["error"],
            run["iterations"], variant["peak_kib"], run["difference"], variant.get("note", ""),
        )  # fmt: skip
        found.points.append(point)
        tell(f"{found.case}: {describe(point)}")


def describe(point: Point) -> str:
    """One line for the screen."""
    return (
        f"{point.solver}: {point.setup_s:.2f} + {point.solve_s:.2f} s, error {point.error:.1e}"
        f" (to the reference {point.difference:.1e}), {point.iterations} iterations"
        f"{f' ({point.note})' if point.note else ''}"
    )


def _worker(case: Case, options: dict[str, Any]) -> dict[str, Any]:
    """Run one cold solve in a fresh process."""
    command = [sys.executable, "-m", "gpusim.bench.worker", case.name, json.dumps(options)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=_LIMIT_S)
    except subprocess.TimeoutExpired:
        raise GpusimError(f"bench {case.name}: stopped after {_LIMIT_S:.0f} s") from None
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode != 0 or not lines:
        why = (done.stderr.strip().splitlines() or [f"ended with {done.returncode}"])[-1]
        raise GpusimError(f"bench {case.name}: the solve's process failed: {why}")
    result: dict[str, Any] = json.loads(lines[-1])
    return result


def _machine() -> str:
    from gpusim.gpu import default_device

    return (
        f"gpusim {__version__}, {default_device().name}, {os.cpu_count()} cores, "
        f"{platform.system()} {platform.machine()}, NumPy {np.__version__}"
    )
