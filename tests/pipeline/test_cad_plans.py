"""Scenes with a CAD part: a plan knows what a run would fail of, and the mesh is made once."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from gpusim.cli import app
from gpusim.cli.console import waiting
from gpusim.mesh import Mesh, mesh_cad
from gpusim.mesh.formats import cad_cache
from gpusim.scene import load_scene
from gpusim.view.content.loading import load_content
from tests.support.gmsh_meshes import Gmsh

PART = """
schema = 1
name = "part"
material = [{ name = "steel", youngs_modulus_GPa = 210.0, poissons_ratio = 0.3 }]
[[body]]
name = "part"
material = "steel"
mesh = { file = "part.step", size_mm = 10.0 }
paint = [{ type = "plain", name = "grey", albedo = 0.5 }]
support = [{ name = "clamp", where = { x_max_mm = 0.0 }, fix = ["x", "y", "z"] }]
load = [{ type = "force", name = "pull", where = { x_min_mm = 40.0 }, force_N = [0.0, 0.0, 9.0] }]
[[camera]]
name = "front"
sensor_mm = [36.0, 27.0]
resolution_px = [32, 24]
focal_mm = 50.0
position_mm = [20.0, -100.0, 5.0]
target_mm = [20.0, 0.0, 5.0]
up = [0.0, 0.0, 1.0]
"""
Run = Callable[..., Any]


@pytest.fixture
def cli() -> Run:
    def invoke(*arguments: str | Path) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return invoke


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("cad") / "part.step"
    with Gmsh() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 40, 30, 10)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path.read_bytes()


@pytest.fixture
def part(step: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("GPUSIM_NO_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (tmp_path / "part.step").write_bytes(step)
    (tmp_path / "part.toml").write_text(PART)
    return tmp_path / "part.toml"


@pytest.fixture
def meshed(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Sizes (m) that Gmsh was asked for."""
    sizes: list[float] = []

    def counted(path: Any, **options: Any) -> Mesh:
        sizes.append(options["size"])
        return mesh_cad(path, **options)

    monkeypatch.setattr(cad_cache, "mesh_cad", counted)
    return sizes


BODY = "body.part"
FAULTS = {
    f'{BODY}.support.clamp.where={{set="face_99"}}': "support 'clamp': select_nodes: unknown set",
    f"{BODY}.paint.grey.where={{x_min_mm=77.0}}": (
        "paint 'grey': where: no faces found; got x_min_mm 77; expected a part of x "
    ),
    f"{BODY}.load.pull.where={{x_min_mm=77.0}}": (
        "load 'pull': where: no faces found; got x_min_mm 77"
    ),
    f'{BODY}.support.clamp.fix=["x"]': "can move freely",
    f"{BODY}.mesh.size_mm=0.004": "got 0.004 in the file's unit, which makes about 2e+12 elements",
}


def test_a_plan_ends_with_what_a_run_would_end_with(
    cli: Run, part: Path, meshed: list[float]
) -> None:
    for change, words in FAULTS.items():
        planned = cli("plan", part, "--set", change)
        assert planned.exit_code == 2 and words in planned.stderr, (change, planned.stderr)
        ran = cli("run", part, "-o", part.parent / "out", "--backend", "numpy", "--set", change)
        assert (ran.exit_code, ran.stderr) == (2, planned.stderr), change
    assert meshed == [0.01, 4e-6, 4e-6]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("target_mm=[20.0, -200.0, 5.0]", "sees no surface: everything is behind it"),
        ("position_mm=[20.0, 15.0, 5.0]", "is inside 'part': move it out"),
    ],
)
def test_a_plan_warns_of_a_camera_that_sees_nothing(
    cli: Run, part: Path, change: str, words: str
) -> None:
    planned = cli("plan", part, "--json", "--set", f"camera.front.{change}")
    assert planned.exit_code == 0
    assert any(words in text for text in json.loads(planned.stdout)["warnings"])


def test_plan_run_and_view_mesh_once(cli: Run, part: Path, meshed: list[float]) -> None:
    out = part.parent / "out"
    assert cli("plan", part, "-o", out).exit_code == 0
    assert cli("run", part, "-o", out, "--backend", "numpy").exit_code == 0
    assert load_content(part).title == "part"
    assert load_scene(part).has_cad and meshed == [0.01]


def test_a_part_whose_results_are_there_is_not_meshed_for_a_plan(
    cli: Run, part: Path, meshed: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GPUSIM_NO_CACHE", "1")
    out = part.parent / "out"
    assert cli("run", part, "-o", out, "--backend", "numpy").exit_code == 0
    planned = cli("plan", part, "-o", out, "--backend", "numpy")
    assert "reused" in planned.stdout and meshed == [0.01]


def test_a_terminal_is_told_what_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    for terminal in (True, False):
        shown = StringIO()
        make = partial(Console, file=shown, force_terminal=terminal)
        monkeypatch.setattr("gpusim.cli.console.Console", lambda make=make, **_: make())
        with waiting("meshing CAD with Gmsh"):
            pass
        assert ("meshing CAD with Gmsh" in shown.getvalue()) == terminal
        with waiting(""):
            pass
        assert terminal or not shown.getvalue()
