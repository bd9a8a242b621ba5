"""Scenes with a CAD part: a plan knows what a run would fail of, and the mesh is made once."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.cli.console import waiting
from gpusim.mesh import Mesh, mesh_cad
from gpusim.mesh.formats import cad_cache
from gpusim.pipeline.checks import resources
from gpusim.scene import load_scene
from gpusim.scene import part as scene_part
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
    f'{BODY}.support.clamp.where={{set="face_99"}}': (
        "support 'clamp': where.set: unknown set; got 'face_99'; expected one of face_1"
    ),
    f'{BODY}.load.pull.where={{set="face_l"}}': "face_4, face_5, face_6 (did you mean 'face_",
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


BUILT = 'mesh = { builder = "box", size_mm = [40.0, 30.0, 10.0], divisions = [4, 3, 1] }'
VIEWS = {
    "camera.front.target_mm=[20.0, -200.0, 5.0]": "sees no surface: everything is behind it",
    "camera.front.target_mm=[900.0, 0.0, 5.0]": "sees no surface: all that is before it lies",
    "camera.front.position_mm=[20.0, 15.0, 5.0]": "is inside 'part': move it out",
    "camera.front.position_mm=[20.0, -1e5, 5.0]": "sees all surfaces within",
    'light=[{type="point", name="lamp", position_mm=[20.0, 15.0, 5.0], power_W=1.0}]': (
        "light 'lamp' is inside 'part'"
    ),
}


def planned(cli: Run, scene: Path, *arguments: str | Path) -> Any:
    made = cli("plan", scene, "--json", "--backend", "numpy", *arguments)
    assert made.exit_code == 0, made.stderr
    return json.loads(made.stdout)


def built(part: Path) -> Path:
    """The same part from a builder."""
    scene = part.with_name("built.toml")
    text = PART.replace('mesh = { file = "part.step", size_mm = 10.0 }', BUILT)
    assert text != PART
    scene.write_text(text)
    return scene


@pytest.mark.parametrize("change", VIEWS)
def test_a_part_is_warned_of_like_what_a_builder_makes(
    cli: Run, part: Path, meshed: list[float], change: str
) -> None:
    of_cad, of_builder = (
        planned(cli, scene, "--set", change)["warnings"] for scene in (part, built(part))
    )
    assert of_cad == of_builder
    assert any(VIEWS[change] in text for text in of_cad)


@pytest.mark.parametrize("cache", ["", "1"])
def test_a_plan_knows_how_large_the_mesh_is(
    cli: Run, part: Path, cache: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GPUSIM_NO_CACHE", cache)
    grid = mesh_cad(part.with_name("part.step"), size=10.0)
    stages = {one["name"]: one for one in planned(cli, part)["stages"]}
    nodes, words = grid.node_count, f"{grid.node_count:,} nodes, {grid.cell_count:,} elements"
    assert stages["mesh"]["detail"] == f"part.step, {words}"
    assert stages["solve"]["detail"].startswith(f"{3 * nodes:,} unknowns, ")
    assert stages["solve"]["memory_bytes"] == 4500 * nodes
    out = part.with_name("out")
    lines: list[str] = []
    gs.run(load_scene(part), out, backend="numpy", progress=lambda *told: lines.append(told[2]))
    assert any(line.startswith(f"{3 * nodes:,} unknowns, ") for line in lines)


def test_a_mesh_that_the_memory_does_not_hold_ends_a_run_before_it_writes(
    cli: Run, part: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    nodes = mesh_cad(part.with_name("part.step"), size=4.0).node_count
    monkeypatch.setattr(resources, "_LEAST", 0)
    monkeypatch.setattr(resources, "host_memory", lambda: 4500 * nodes // 4)
    finer = f"{BODY}.mesh.size_mm=4.0"
    words = f"solve: needs about {4500 * nodes / 1e9:.3g} GB of memory ({3 * nodes:,} unknowns"
    assert any(words in text for text in planned(cli, part, "--set", finer)["warnings"])
    ran = cli("run", part, "-o", part.with_name("out"), "--backend", "numpy", "--set", finer)
    assert ran.exit_code == 2 and words in ran.stderr
    assert not part.with_name("out").exists()


def test_a_new_camera_needs_no_new_mesh(cli: Run, part: Path, meshed: list[float]) -> None:
    out = part.with_name("out")
    moved = "--set", "camera.front.position_mm=[30.0, -90.0, 20.0]"
    for more in ((), moved):
        assert cli("run", part, "-o", out, "--backend", "numpy", *more).exit_code == 0
    states = {one["name"]: one["state"] for one in planned(cli, part, "-o", out)["stages"]}
    assert states["solve"] == "reused" and states["render/front/0001"] == "run"
    # all is there, and still it is told, as of a builder
    blind = (
        "--set", "camera.front.target_mm=[900.0, 0.0, 5.0]", "--set", "sensor.exposure=1.0"
    )  # fmt: skip
    assert cli("run", part, "-o", out, "--backend", "numpy", *blind).exit_code == 0
    again = planned(cli, part, "-o", out, *blind)
    assert {one["state"] for one in again["stages"]} == {"reused", "skipped", "run"}
    assert [one["name"] for one in again["stages"] if one["state"] == "run"] == ["report"]
    assert any("sees no surface" in text for text in again["warnings"])
    assert meshed == [0.01]


def test_another_gmsh_makes_another_mesh(
    cli: Run, part: Path, meshed: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Seen before: a new camera's mesh of a new Gmsh, with displacements of the old one's nodes."""
    out = part.with_name("out")
    assert cli("run", part, "-o", out, "--backend", "numpy").exit_code == 0
    for module in (scene_part, cad_cache):
        monkeypatch.setattr(module, "version", lambda name: "99.0")
    states = {one["name"]: one for one in planned(cli, part, "-o", out)["stages"]}
    assert (states["solve"]["state"], states["solve"]["reason"]) == (
        "run", "body.part.mesh changed"
    )  # fmt: skip
    assert meshed == [0.01, 0.01]


def test_two_plans_at_once(part: Path) -> None:
    command = [sys.executable, "-m", "gpusim", "plan", str(part), "--backend", "numpy"]
    both = [subprocess.Popen(command, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    said = [one.communicate(timeout=120)[0] for one in both]
    assert [one.returncode for one in both] == [0, 0] and all("unknowns" in text for text in said)
    kept = list((part.parent / "cache" / "gpusim" / "meshes").iterdir())
    assert len(kept) == 1 and kept[0].suffix == ".npz"


def test_plan_run_and_view_mesh_once(cli: Run, part: Path, meshed: list[float]) -> None:
    out = part.parent / "out"
    assert cli("plan", part, "-o", out).exit_code == 0
    assert cli("run", part, "-o", out, "--backend", "numpy").exit_code == 0
    assert load_content(part).title == "part"
    assert meshed == [0.01]
    assert "<img" in load_scene(part)._repr_html_()  # a notebook draws what is meshed already
    other = load_scene(part, {"body.part.mesh.size_mm": 9.0})
    assert "Not drawn: meshing takes long." in other._repr_html_() and meshed == [0.01]


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
