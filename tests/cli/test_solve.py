"""``gpusim solve``: files, report, table, exit codes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from typer.testing import CliRunner, Result

import gpusim as gs
from gpusim.cli import app
from tests.support.deck_texts import LABELS, MODEL, POINTS, deck, step, write

TEXT = deck(
    step("*CLOAD", "22, 3, -2.", "*NODE PRINT", "U"),
    step("*TEMPERATURE", "ALL, 10."),
    step("*BOUNDARY", "13, 1, 3, 0.01"),
)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["solve", *map(str, arguments)])


def solved(folder: Path, text: str = TEXT, *more: str) -> tuple[Result, Path]:
    path, out = write(folder, text), folder / "out"
    return run(path, "-o", out, "--backend", "numpy", *more), out


def report_of(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / "report.json").read_text(encoding="utf-8"))
    return found


def test_files_and_report(tmp_path: Path) -> None:
    result, out = solved(tmp_path)
    assert result.exit_code == 0
    assert sorted(path.name for path in out.iterdir()) == [
        "displacements.npz", "report.json", "solution.pvd",
        "solution_0001.vtu", "solution_0002.vtu", "solution_0003.vtu",
    ]  # fmt: skip
    solutions = gs.load_deck(tmp_path / "two.inp").solve(backend="numpy")
    report = report_of(out)
    assert report["status"] == "ok" and report["ignored"] == ["*HEADING", "*NODE PRINT"]
    assert report["cells"] == {"hex8": 2} and report["formulation"] == {"hex8": "full"}
    first, second, _third = report["steps"]
    assert first["unknowns"] == 24 and first["converged"] and first["error_estimate"] <= 1e-6
    assert first["largest_displacement_node"] == 22
    np.testing.assert_allclose(first["reaction"], [0, 0, 2], atol=1e-9)
    np.testing.assert_allclose(first["force"], [0, 0, -2], atol=1e-12)
    assert first["energy_balance"] <= 1e-6 and first["strain_energy"] > 0.0
    assert second["time"] == 2.0
    with np.load(out / "displacements.npz") as stored:
        assert stored["node_labels"].tolist() == LABELS.tolist()
        np.testing.assert_array_equal(stored["points"], POINTS)
        for k, solution in enumerate(solutions):
            np.testing.assert_allclose(stored["u"][k], solution.u, atol=1e-9)
    mesh = meshio.read(out / "solution_0002.vtu")
    np.testing.assert_allclose(mesh.point_data["u"], solutions[1].u, atol=1e-9)
    np.testing.assert_array_equal(mesh.point_data["temperature_change"], np.full(12, 10.0))
    assert mesh.cell_data["element_label"][0].tolist() == [7, 9]


def test_table_and_json(tmp_path: Path) -> None:
    result, _ = solved(tmp_path)
    lines = [line.split() for line in result.stdout.splitlines()]
    rows = [line for line in lines if line and line[0] in ("1", "2", "3")]
    assert [row[1] for row in rows] == ["24", "24", "21"]
    assert rows[0][5] == "22"
    assert "read over: *HEADING, *NODE PRINT" in result.stdout
    result, out = solved(tmp_path, TEXT, "--json")
    assert json.loads(result.stdout) == report_of(out)
    result, _ = solved(tmp_path, TEXT, "--quiet")
    assert result.stdout == ""


def test_stress(tmp_path: Path) -> None:
    """A bar pulled along x: the same stress everywhere."""
    pull = step("*DSLOAD", "END, P, -3.")
    result, out = solved(
        tmp_path, deck(pull, fixed="*BOUNDARY\nLEFT, 1\n11, 2, 3\n17, 2\n"), "--stress"
    )
    assert result.exit_code == 0 and "largest von Mises stress 3 in element" in result.stdout
    assert report_of(out)["steps"][0]["largest_von_mises"] == pytest.approx(3.0, abs=1e-6)
    mesh = meshio.read(out / "solution_0001.vtu")
    expected = [[3.0, 0, 0, 0, 0, 0]] * 2
    np.testing.assert_allclose(mesh.cell_data["stress"][0], expected, atol=1e-6)
    np.testing.assert_allclose(mesh.cell_data["von_mises"][0], [3.0, 3.0], atol=1e-6)


def test_results_of_an_earlier_deck_are_gone(tmp_path: Path) -> None:
    _, out = solved(tmp_path)
    assert (out / "solution_0003.vtu").exists()
    _, out = solved(tmp_path, deck(step("*CLOAD", "22, 3, -2.")))
    assert sorted(path.name for path in out.glob("solution*")) == [
        "solution.pvd", "solution_0001.vtu",
    ]  # fmt: skip
    assert len(report_of(out)["steps"]) == 1


def test_numbers_that_overflow_end_in_one_message(tmp_path: Path) -> None:
    path = write(tmp_path, deck(step("*TEMPERATURE", "ALL, 1e308"), step("*TEMPERATURE", "13, 1.")))
    command = [sys.executable, "-m", "gpusim", "solve", str(path), "-o", str(tmp_path / "out")]
    ended = subprocess.run([*command, "--backend", "numpy"], capture_output=True, text=True)
    assert ended.returncode in (2, 3)
    assert ended.stderr.startswith("error: ") and "Warning" not in ended.stderr


def test_a_refused_deck_ends_with_2_and_a_report(tmp_path: Path) -> None:
    result, out = solved(tmp_path, TEXT.replace("*STATIC", "*VISCO", 1))
    assert result.exit_code == 2
    assert "*VISCO: not supported" in result.stderr
    report = report_of(out)
    assert report["status"] == "failed" and "*VISCO" in report["error"]
    assert [path.name for path in out.iterdir()] == ["report.json"]


def test_a_free_body_ends_with_2(tmp_path: Path) -> None:
    text = deck(step("*CLOAD", "22, 3, -2."), fixed="*BOUNDARY\n11, 1, 3\n")
    result, out = solved(tmp_path, text)
    assert result.exit_code == 2 and "rotation" in result.stderr
    assert report_of(out)["status"] == "failed"


def test_not_converged_ends_with_3_and_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dataclasses import replace

    import gpusim.deck.deck as module

    whole = module.solve
    monkeypatch.setattr(
        module,
        "solve",
        lambda *args, **kw: replace(whole(*args, **kw), converged=False, message="stagnation"),
    )
    result, out = solved(tmp_path)
    assert result.exit_code == 3 and "stagnation" in result.stderr
    assert report_of(out)["status"] == "not converged"
    assert (out / "solution_0003.vtu").is_file()


def test_wrong_arguments(tmp_path: Path) -> None:
    path = write(tmp_path, TEXT)
    assert run(tmp_path / "absent.inp", "-o", tmp_path / "out").exit_code == 2
    assert run(path, "-o", path).exit_code == 2
    result = run(path, "-o", tmp_path / "out", "--tolerance", "2")
    assert result.exit_code == 2 and "tolerance" in result.stderr
    assert run(path).exit_code == 2


def test_mesh_without_a_step(tmp_path: Path) -> None:
    result, _ = solved(tmp_path, MODEL)
    assert result.exit_code == 2 and "no *SOLID SECTION" in result.stderr
