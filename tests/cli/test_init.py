"""``gpusim init``: scenes of parts and from templates that plan as they are, and see their part."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.cli.init import templates
from gpusim.mesh.formats import cad
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene, load_scene
from tests.support.gmsh_meshes import Gmsh

Run = Callable[..., Any]


@pytest.fixture
def cli(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def invoke(*arguments: str | Path) -> Any:
        return CliRunner().invoke(app, [str(argument) for argument in arguments])

    return invoke


def planned(cli: Run, scene: str) -> list[str]:
    """The warnings of a plan that succeeds."""
    result = cli("plan", scene, "--json")
    assert result.exit_code == 0, result.output
    warnings: list[str] = json.loads(result.stdout)["warnings"]
    return warnings


def seen(scene: Scene, corners: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """By camera where corners (m) are in its picture, px, and the picture's size."""
    return [
        (build_camera(one).project(corners), np.array(one.resolution_px)) for one in scene.cameras
    ]


def corners_of(low: list[float], high: list[float]) -> np.ndarray:
    """Of a box in mm, in m."""
    ends = np.array([low, high]) / 1e3
    return np.array([[ends[i, 0], ends[j, 1], ends[k, 2]]
                     for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip


def write_step(path: Path, build: Callable[[Any], object]) -> None:
    with Gmsh() as gmsh:
        build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))


def write_plate(path: Path) -> None:
    """100 x 40 x 3 mm about (5, 2, 1.5) with a hole of 6 mm radius."""

    def build(occ: Any) -> None:
        body, hole = occ.addBox(-45, -18, 0, 100, 40, 3), occ.addCylinder(5, 2, -1, 0, 0, 5, 6)
        occ.cut([(3, body)], [(3, hole)])

    write_step(path, build)


@pytest.mark.parametrize("name", sorted(templates()))
def test_every_template_plans_as_it_is(cli: Run, name: str, tmp_path: Path) -> None:
    result = cli("init", name, "-o", "new/first.toml")
    assert result.exit_code == 0, result.output
    assert "gpusim run new/first.toml -o out/first" in result.stdout
    text = (tmp_path / "new" / "first.toml").read_text(encoding="utf-8")
    assert "examples/" not in text.partition("schema = 1")[0]
    assert planned(cli, "new/first.toml") == []


def test_templates_are_listed(cli: Run) -> None:
    for arguments in (("init",), ("init", "--list")):
        words = " ".join(cli(*arguments).stdout.split())
        for name, sentence in (
            ("plate_with_hole", "A steel plate with a hole, pulled at its ends"),
            ("cantilever", "A clamped aluminium bar, bent by a force at its free end."),
            ("damaged_beam", "where did its slope change?"),
        ):
            assert name in words and sentence in words
    assert list(Path().iterdir()) == []


def test_nothing_is_overwritten_unless_asked_for(cli: Run, tmp_path: Path) -> None:
    scene = tmp_path / "scene.toml"
    scene.write_text("mine", encoding="utf-8")
    result = cli("init", "cantilever")
    assert result.exit_code == 2
    assert "scene.toml: is there already; expected another -o, or --force" in result.stderr
    assert scene.read_text(encoding="utf-8") == "mine"
    assert cli("init", "cantilever", "--force").exit_code == 0
    assert load_scene(scene).name == "Cantilever"


def test_files_that_an_example_needs_come_along(cli: Run, tmp_path: Path) -> None:
    own = tmp_path / "lug.msh"
    assert cli("init", "lug").exit_code == 0
    assert own.stat().st_size > 10_000
    assert cli("init", "lug", "-o", "again.toml").exit_code == 0  # it is the same
    own.write_bytes(b"mine")
    for options in ([], ["--force"]):
        result = cli("init", "lug", "-o", "other.toml", *options)
        assert result.exit_code == 2
        assert "lug.msh: is there already, and not the template's" in result.stderr
        assert "expected another folder: -o NEW/other.toml" in result.stderr
    assert own.read_bytes() == b"mine" and not (tmp_path / "other.toml").exists()
    assert cli("init", "lug", "-o", "NEW/other.toml").exit_code == 0
    assert planned(cli, "NEW/other.toml") == []


@pytest.mark.parametrize("name", ["a\nb.toml", "a\x1b[31m.toml", "a\u202eb.toml"])
def test_a_name_that_commands_the_terminal_is_refused(cli: Run, tmp_path: Path, name: str) -> None:
    result = cli("init", "plate_with_hole", "-o", name)
    assert result.exit_code == 2
    assert "-o: control characters" in result.stderr and name not in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_name_that_is_neither_file_nor_template(cli: Run, tmp_path: Path) -> None:
    result = cli("init", "cantilver")
    assert result.exit_code == 2
    assert "no such file or template; got cantilver" in result.stderr
    assert "(did you mean cantilever?)" in result.stderr
    (tmp_path / "notes.txt").write_text("no mesh", encoding="utf-8")
    result = cli("init", "notes.txt")
    assert result.exit_code == 2
    assert "notes.txt" in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "scene.toml").exists()


def test_a_step_part(cli: Run, tmp_path: Path) -> None:
    (tmp_path / "cad").mkdir()
    write_plate(tmp_path / "cad" / "my plate.step")
    result = cli("init", "cad/my plate.step", "-o", "scenes/plate.toml")
    assert result.exit_code == 0, result.output
    text = (tmp_path / "scenes" / "plate.toml").read_text(encoding="utf-8")
    assert "it reaches from [-45.0, -18.0, 0.0] to [55.0, 22.0, 3.0]" in text
    assert "hollow, radius 6 mm about z" in text
    assert text.count("plane that looks") == 6
    assert planned(cli, "scenes/plate.toml") == []

    scene = load_scene(tmp_path / "scenes" / "plate.toml")
    (body,) = scene.bodies
    assert Path(body.mesh.path).samefile(tmp_path / "cad" / "my plate.step")
    assert 0.001 < body.mesh.size < 0.003  # about half the plate's thickness
    grid = gs.mesh_cad(body.mesh.path, size=body.mesh.size, scale=1e-3)

    def face(name: str) -> tuple[list[float], float]:
        faces = gs.mesh.select_faces(grid, name=name)
        middle = faces.areas @ faces.centroids / faces.areas.sum()
        return [round(1e3 * value, 3) for value in middle], float(faces.areas.sum())

    held, pulled, painted = (
        entry.where.set for entry in (body.supports[0], body.loads[0], body.paints[1])
    )
    assert face(held)[0] == [-45.0, 2.0, 1.5] and face(pulled)[0] == [55.0, 2.0, 1.5]
    middle, area = face(painted)
    assert middle[2] in (0.0, 3.0) and area == pytest.approx(4e-3 - np.pi * 6e-3**2, rel=1e-2)
    # 60 MPa in a section of 40 x 3 mm less a bit of hole
    assert body.loads[0].force == (7000.0, 0.0, 0.0)

    scale = []
    for pixels, size in seen(scene, corners_of([-45, -18, 0], [55, 22, 3])):
        assert (pixels > 0.02 * size).all() and (pixels < 0.98 * size).all()
        wide = np.ptp(pixels[:, 0])
        assert wide > 0.75 * size[0]  # it fills the picture, its longer side level
        scale.append(100.0 / wide)
    assert 3.0 <= 1e3 * body.paints[1].diameter / np.mean(scale) <= 5.0


def test_the_board_is_seen_whole_in_every_pose(cli: Run, tmp_path: Path) -> None:
    write_plate(tmp_path / "part.step")
    for source in ("part.step", "plate_with_hole"):
        assert cli("init", source, "--force").exit_code == 0
        document = tomllib.loads((tmp_path / "scene.toml").read_text(encoding="utf-8"))
        (measure,) = document["measure"]
        assert measure["type"] == "dic" and measure["cameras"] == ["left", "right"]
        scene = Scene.from_document(document, folder=tmp_path)
        (board,) = scene.props
        fields = board.paint
        assert (fields.columns, fields.rows) == (12, 9)
        right = np.cross(board.up, board.normal)
        ends = [np.array(fields.origin) + fields.cell * (i * right + j * np.array(board.up))
                for i in (0, 12) for j in (0, 9)]  # fmt: skip
        arms = np.array(ends) - board.center
        np.testing.assert_allclose(arms @ board.normal, 0.0, atol=1e-9)
        np.testing.assert_allclose(arms.mean(axis=0), 0.0, atol=1e-9)  # in the board's middle
        assert np.abs(arms).max() < max(board.size) / 2
        assert scene.calibration is not None and len(scene.calibration.poses) == 12
        for pose in scene.calibration.poses:
            turned = Rotation.from_euler("xyz", pose.rotation_deg, degrees=True).apply(arms)
            for pixels, size in seen(scene, turned + pose.position):
                assert (pixels > 10.0).all() and (pixels < size - 10.0).all()
                assert np.ptp(pixels, axis=0).max() > 0.35 * size[0]


def test_faces_go_by_the_names_of_the_file(cli: Run, tmp_path: Path) -> None:
    part = tmp_path / "named.step"
    write_step(part, lambda occ: occ.addBox(0, 0, 0, 60, 20, 10))
    text = part.read_text(encoding="utf-8")
    (first,) = [one for one in re.findall(r"#\d+ = ADVANCED_FACE[^;]*;", text)
                if plane_of(text, one) == ((0.0, 0.0, 0.0), "x")]  # fmt: skip
    text = text.replace(first, first.replace("''", "'clamping face'", 1))
    # the order of a shell is not that of the lines
    shell = re.search(r"CLOSED_SHELL\('',\(([^)]*)\)", text)
    assert shell is not None
    text = text.replace(shell[1], ",".join(reversed(shell[1].split(","))))
    part.write_text(text, encoding="utf-8")
    assert cli("init", part).exit_code == 0
    text = (tmp_path / "scene.toml").read_text(encoding="utf-8")
    assert re.search(
        r"#   clamping face +plane that looks -x, near \[0.0, 10.0, 5.0], 200 mm2", text
    )
    assert tomllib.loads(text)["body"][0]["support"][0]["where"] == {"set": "clamping face"}
    assert planned(cli, "scene.toml") == []


def plane_of(text: str, face: str) -> tuple[tuple[float, ...], str]:
    """A point of a face's plane in a STEP text, and the axis along its normal."""
    lines = dict(re.findall(r"(#\d+) = ([^;]*);", text))

    def referred(line: str, place: int) -> str:
        return lines[re.findall(r"#\d+", line)[place]]

    axes = referred(referred(face.partition("=")[2], -1), 0)
    point, normal = (
        tuple(float(one) for one in re.findall(r"-?\d+\.\d*(?:E[+-]?\d+)?", referred(axes, k)))
        for k in (0, 1)
    )
    return point, "xyz"[int(np.argmax(np.abs(normal)))]


@pytest.mark.parametrize("kind", ["rod", "ball", "turned plate"])
def test_round_and_turned_parts(cli: Run, tmp_path: Path, kind: str) -> None:
    def build(occ: Any) -> None:
        if kind == "rod":
            occ.addCylinder(0, 0, 0, 0, 0, 120, 10)
        elif kind == "ball":
            occ.addSphere(0, 0, 0, 15)
        else:
            body = occ.addBox(-50, -20, 0, 100, 40, 3)
            occ.rotate([(3, body)], 0, 0, 0, 1, 0.3, 0.2, 0.7)

    write_step(tmp_path / "part.step", build)
    assert cli("init", "part.step").exit_code == 0
    assert planned(cli, "scene.toml") == []
    scene = load_scene(tmp_path / "scene.toml")
    points = gs.mesh_cad(tmp_path / "part.step", size=0.02, scale=1e-3).points
    for pixels, size in seen(scene, points):
        assert (pixels > 0.01 * size).all() and (pixels < 0.99 * size).all()


def test_a_mesh_file_with_and_without_sets(cli: Run, tmp_path: Path, checkout: Path) -> None:
    shutil.copy(checkout / "examples" / "lug.msh", tmp_path)
    assert cli("init", "lug.msh").exit_code == 0
    text = (tmp_path / "scene.toml").read_text(encoding="utf-8")
    assert "#   clamp     plane that looks -x" in text and "#   eye" in text
    assert 'unit = "mm"' in text
    assert planned(cli, "scene.toml") == []
    block = gs.mesh.box(size=(60, 20, 10), divisions=(12, 4, 2))
    gs.export.write_vtu(tmp_path / "block.vtu", block.points, block.cells)
    assert cli("init", "block.vtu", "-o", "block.toml").exit_code == 0
    text = (tmp_path / "block.toml").read_text(encoding="utf-8")
    assert "(the file names none)" in text
    assert "where = { x_max_mm = 6 }" in text and "where = { x_min_mm = 54 }" in text
    assert planned(cli, "block.toml") == []


def test_solids_that_touch_nowhere_are_refused(cli: Run, tmp_path: Path) -> None:
    def build(apart: float) -> Callable[[Any], object]:
        return lambda occ: [occ.addBox(x, 0, 0, 10, 10, 10) for x in (0, 10 + apart)]

    write_step(tmp_path / "two.step", build(10))
    result = cli("init", "two.step")
    assert result.exit_code == 2
    assert "two.step: pieces that share no nodes; got 2; expected one" in result.stderr
    assert "[[body]]" in result.stderr and not (tmp_path / "scene.toml").exists()
    write_step(tmp_path / "touching.step", build(0))
    assert cli("init", "touching.step").exit_code == 0
    assert planned(cli, "scene.toml") == []


def test_without_gmsh_a_step_part_is_refused(
    cli: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "part.step").write_text("ISO-10303-21;", encoding="utf-8")
    find = importlib.util.find_spec
    monkeypatch.setattr(cad, "find_spec", lambda name: None if name == "gmsh" else find(name))
    result = cli("init", "part.step")
    assert result.exit_code == 2
    assert "a CAD file needs gmsh, which is not installed" in result.stderr
    assert "pip install gmsh" in result.stderr
    assert not (tmp_path / "scene.toml").exists()
