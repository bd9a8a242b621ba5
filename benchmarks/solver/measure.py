"""The solver benchmark beside other solvers: memory, bandwidth, growth, second load cases."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.solver.bandwidth import measure_operator
from benchmarks.solver.peers import EXACT, PEERS, Peer, run_peer
from benchmarks.solver.problem import write_problem
from gpusim.bench.solver import (
    LIMIT_S,
    CaseResult,
    Point,
    Tell,
    in_fresh_process,
    machine,
    measure_case,
    reference_of,
    solve_cold,
)
from gpusim.bench.solver_cases import Case
from gpusim.errors import GpusimError

__all__ = ["PeerCaseResult", "SolverResult", "run_peer_bench"]

ENOUGH = 1e-6
WITHOUT_PEERS = {"cube-3M"}
"""Cases that are too large for any peer here."""


@dataclass
class PeerCaseResult(CaseResult):
    """A case with what a second load case adds, and what the operator moves."""

    second_case: float = float("nan")
    operator: dict[str, Any] = field(default_factory=dict)

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
    """Everything measured, ready for `benchmarks.solver.tables`."""

    machine: str
    cases: list[PeerCaseResult] = field(default_factory=list)

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


def run_peer_bench(
    cases: Sequence[Case],
    work: Path,
    *,
    peers: Sequence[Peer] = PEERS,
    repeat: int = 3,
    tell: Tell = print,
    save: Callable[[SolverResult], object] = lambda result: None,
) -> SolverResult:
    """Run every case; ``work`` is a folder for references (kept) and the peers' arrays.

    ``repeat`` pairs of runs, with one load case and with two, tell what a second one costs.
    A case that fails is reported as such, and the next one is run. ``save`` is called with what
    there is after each, so that an interrupted run keeps its results.
    """
    result = SolverResult(machine())
    for case in cases:
        found = PeerCaseResult(case.name, case.family)
        result.cases.append(found)
        try:
            _run_case(case, found, work / case.name, peers, repeat, tell)
        except GpusimError as error:
            found.fail(str(error), tell)
        shutil.rmtree(work / case.name / "problem", ignore_errors=True)
        save(result)
    return result


def _run_case(
    case: Case, found: PeerCaseResult, folder: Path, peers: Sequence[Peer], repeat: int, tell: Tell
) -> None:
    problem, reference = folder / "problem", reference_of(case, folder.parent, tell)
    with_peers = bool(peers) and case.name not in WITHOUT_PEERS
    measure_case(case, found, reference, tell)
    found.second_case = second_case(case, repeat)
    if with_peers:
        in_fresh_process(case.name, export_problem, case, reference, problem)
        if case.family == "beam" and not (problem / "solved.npy").exists():
            for failed in run_peer(EXACT, problem, LIMIT_S):
                _take_peer(found, failed, tell)
        for peer in peers:
            if peer.takes(case, found.unknowns):
                for variant in run_peer(peer, problem, LIMIT_S):
                    _take_peer(found, variant, tell)
    try:
        found.operator = in_fresh_process(case.name, measure_operator, case)
    except GpusimError as error:
        found.operator = {"failed": str(error)}


def export_problem(case: Case, reference: Path, folder: Path) -> None:
    """What peers read; the displacements in the file ``reference`` are those that are wanted."""
    write_problem(case, case.model(), np.load(reference), folder)


def second_case(case: Case, repeat: int) -> float:
    """What a second load case costs, over the first: of ``repeat`` alternating pairs of runs with
    one load case and with both, the least of each. Single runs of a second differ by a third on a
    shared machine, by more than what is to be told. NaN if one has failed."""
    least = [np.inf, np.inf]
    for _ in range(repeat):
        for cases in (1, 2):
            one = in_fresh_process(case.name, solve_cold, case, ENOUGH, load_cases=cases)
            if not one.get("converged"):
                return float("nan")
            least[cases - 1] = min(least[cases - 1], one["seconds"])
    return least[1] / least[0] - 1.0


def _take_peer(found: PeerCaseResult, variant: dict[str, Any], tell: Tell) -> None:
    if "failed" in variant:
        found.fail(f"{variant['name']}: {variant['failed']}", tell)
        return
    for run in variant["runs"]:
        point = Point(
            variant["name"], run["tolerance"], variant["setup_s"], run["solve_s"], run["error"],
            run["iterations"], variant["peak_kib"], run["difference"], variant.get("note", ""),
        )  # fmt: skip
        found.add(point, tell)
