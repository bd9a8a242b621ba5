"""Benchmark results: ratios, fits, tables, and peers that are missing or fail."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.solver import measure
from benchmarks.solver.cases import CASES
from benchmarks.solver.measure import PeerCaseResult, SolverResult
from benchmarks.solver.peers import PEERS, SCRIPTS, Peer, run_peer
from benchmarks.solver.problem import write_problem
from benchmarks.solver.tables import solver_markdown, write_solver
from benchmarks.stability.nonlinear_suite import WARNED, LargeVerdict
from benchmarks.stability.suite import RIGHT, SILENT, Verdict
from benchmarks.stability.tables import large_markdown, stability_markdown, write_stability
from gpusim.bench.solver import Point
from gpusim.bench.solver_cases import find_cases
from gpusim.cli import app
from gpusim.mesh import mesh_quality


def point(solver: str, seconds: float, error: float, tolerance: float = 1e-6) -> Point:
    return Point(solver, tolerance, 0.25 * seconds, 0.75 * seconds, error, 7, 2048.0, error)


def result() -> SolverResult:
    cases = []
    for unknowns in (30_000, 100_000, 1_000_000):
        seconds = 1e-6 * unknowns**1.1
        cases.append(
            PeerCaseResult(
                f"cube-{unknowns}", "cube", unknowns,
                [
                    point("gpusim", 0.5 * seconds, 1e-4, 1e-3),  # quicker, but not right to 1e-6
                    point("gpusim", seconds, 3e-7),
                    point("gpusim", 1.5 * seconds, 3e-9, 1e-8),
                    point("slow", 3.0 * seconds, 1e-9),
                    point("wrong", 0.1 * seconds, 2e-6),
                    point("CalculiX C3D8I, whole run", 2.0 * seconds, 9e-7),
                ],
                ["absent: missing: no such thing"], 900.0,
                {"assembly": 0.5}, "multigrid, gpu, f64", 0.2,
                {"share": 0.61, "assembled_share": 0.83, "copy_bytes_per_s": 1e10,
                 "host_copy_bytes_per_s": 9e9,
                 "operator_seconds": 2e-3, "operator_bytes": 7e7, "unknowns": unknowns},
            )
        )  # fmt: skip
    return SolverResult("this machine", cases)


def test_only_answers_right_to_1e_6_count() -> None:
    case = result().cases[0]
    assert case.own().error == 3e-7
    assert case.best_peer().solver == "slow"
    assert case.best_peer(whole_runs=True).solver.startswith("CalculiX")
    case.points = [p for p in case.points if p.solver == "wrong"]
    assert case.own() is None and case.best_peer() is None


def test_a_second_load_case_is_told_by_the_least_of_alternating_runs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    seconds = iter([2.0, 2.9, 1.0, 1.2, 1.5, 1.25])
    asked: list[int] = []

    def run(name: str, work: object, case: object, tolerance: float, load_cases: int) -> Any:
        asked.append(load_cases)
        return {"converged": len(asked) < 7, "seconds": next(seconds, 1.0)}

    monkeypatch.setattr(measure, "in_fresh_process", run)
    (case,) = find_cases("small", "beam-10k")
    assert measure.second_case(case, 3) == pytest.approx(0.2)
    assert asked == [1, 2, 1, 2, 1, 2]
    assert np.isnan(measure.second_case(case, 3))  # the seventh didn't converge


def test_exponent_of_growth() -> None:
    assert result().exponents() == {"cube": pytest.approx(1.1, abs=1e-12)}


def test_tables_and_figures_are_written(tmp_path: Path) -> None:
    text = solver_markdown(result())
    assert "| cube-30000 | 30000 | 0.08 | 3e-07 | slow | 0.25 | 3.00 | 2.00 | 20 % | 900 |" in text
    assert "Time of `cube` grows as N^1.10." in text
    assert "| 61 % | 83 % |" in text and "- absent: missing: no such thing" in text
    paths = write_solver(result(), tmp_path)
    assert [path.name for path in paths] == ["solver.md", "solver.json", "solver.png"]
    assert json.loads(paths[1].read_text())["cases"][2]["points"][1]["error"] == 3e-7
    assert paths[2].read_bytes()[:4] == b"\x89PNG"


def test_table_of_large_displacements_says_what_should_have_been() -> None:
    verdicts = [
        LargeVerdict("arch", "led", RIGHT, 1e-3, "beam", 12, 2e-4, 1e-7, 9, 0.5, RIGHT, ""),
        LargeVerdict("arch", "pressed", RIGHT, 1e-3, verdict=WARNED, message="a | b"),
    ]
    text = large_markdown(verdicts)
    assert "2 cases: 1 right, 1 warned, 0 told" in text
    assert "| arch: led | beam | 0.001 | 2e-04 | 1e-07 | 9 | 0.5 | right |  |" in text
    assert "| **warned**, wanted right | a / b |" in text


def test_stability_table_counts_and_names(tmp_path: Path) -> None:
    verdicts = [
        Verdict("bar 1", "bar", 1.0, "auto", 1e-6, 30, 1e-9, 1e-8, 3, 0.1, RIGHT, "converged"),
        Verdict("bar 2", "bar", 2.0, "auto", 1e-6, 30, 1e-3, 1e-8, 3, 0.1, SILENT, "a | b"),
    ]
    text = stability_markdown(verdicts, "this machine")
    assert "2 solves: 1 right, 1 SILENT FAILURE; 1 silent failures." in text
    assert "| bar 2 | auto | 30 | 1e-03 | 1e-08 | 3 | 0.1 | SILENT FAILURE | a / b |" in text
    assert [path.suffix for path in write_stability(verdicts, tmp_path, "")] == [
        ".md", ".json", ".png",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("script", "name", "failed"),
    [
        ('print(\'{"variants": [{"name": "good"}], "peak_kib": 5}\')', "good", None),
        ("import no_such_module_here", "p", "missing: ModuleNotFoundError: No module named"),
        ("raise SystemExit('out of luck')", "p", "out of luck"),
        ("print('nothing')", "p", "nothing"),
        ("import time; time.sleep(60)", "p", "stopped after"),
    ],
)
def test_a_peer_that_fails_says_so(
    script: str, name: str, failed: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GPUSIM_PEERS_PYTHON", sys.executable)
    (tmp_path / "p.py").write_text(script)
    limit = 1.0 if "sleep" in script else 60.0
    (variant,) = run_peer(Peer("p", "p.py"), tmp_path, limit, tmp_path)
    assert variant["name"] == name
    if failed is None:
        assert variant["peak_kib"] == 5
    else:
        assert failed in variant["failed"]


def test_a_peers_script_reads_the_problem_and_measures_its_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (case,) = find_cases("small", "cube-nu4999-10k")
    model = case.model()
    u = np.random.default_rng(1).normal(size=model.mesh.points.shape)
    write_problem(case, model, u, tmp_path / "problem")
    (tmp_path / "p.py").write_text(
        f"import sys; sys.path.insert(0, {str(SCRIPTS)!r})\n"
        "from common import main, sweep\n"
        "def run(problem, options):\n"
        "    k = problem.scipy_csr()\n"
        "    assert abs(k @ problem.rigid_modes()[:, 0]).sum() > 0\n"
        "    answer = lambda tolerance: (problem.wanted * (1 + tolerance), 4)\n"
        "    runs = sweep(problem, answer, [1e-3, 1e-7, 0])\n"
        "    return [{'name': 'p', 'setup_s': 0.0, 'runs': runs}]\n"
        "main(run)\n"
    )
    monkeypatch.setenv("GPUSIM_PEERS_PYTHON", sys.executable)
    (variant,) = run_peer(Peer("p", "p.py"), tmp_path / "problem", 60.0, tmp_path)
    assert [run["error"] for run in variant["runs"]] == pytest.approx([1e-3, 1e-7])


def test_every_peer_has_its_script() -> None:
    assert all((SCRIPTS / peer.script).is_file() for peer in PEERS)


def test_a_wrong_case_on_the_command_line() -> None:
    ended = CliRunner().invoke(app, ["bench", "solver", "--case", "sphere"])
    assert ended.exit_code == 2 and "expected one of beam" in ended.output


def test_a_user_gets_time_against_error_of_the_solver(tmp_path: Path) -> None:
    words = ["bench", "solver", "--case", "cube-10k", "-o", str(tmp_path)]
    ended = CliRunner().invoke(app, words)
    assert ended.exit_code == 0, ended.output
    rows = [
        line for line in (tmp_path / "solver.md").read_text().splitlines() if "| gpusim" in line
    ]
    assert [row.split(" | ")[1] for row in rows] == ["0.001", "1e-06", "1e-08"]
    assert all(float(row.split(" | ")[5]) <= float(row.split(" | ")[1]) for row in rows)


def test_no_two_bricks_of_an_uneven_cube_are_alike() -> None:
    (case,) = find_cases("small", "uneven-10k", CASES)
    mesh = case.model().mesh
    low, high = mesh.bounds
    assert (low == 0.0).all() and (high == 100.0).all()
    assert mesh_quality(mesh).scaled_jacobian.min() > 0.5
    corners = mesh.points[mesh.cells["hex8"]]
    shapes = (corners - corners[:, :1]).reshape(len(corners), -1).round(9)
    assert len(np.unique(shapes, axis=0)) == len(shapes)
