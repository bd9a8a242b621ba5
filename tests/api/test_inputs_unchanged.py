"""An input that is edited between loading a scene and running it is an error, never a result."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.export.meshes import write_pvd, write_vtu
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from tests.support.small_scene import DOCUMENT, small_scene

BRICK = gs.mesh.box((0.24, 0.02, 0.01), (6, 1, 1))
INP = """*INCLUDE, INPUT=nodes.inc
*ELEMENT, TYPE=C3D8, ELSET=all
1, 1, 2, 3, 4, 5, 6, 7, 8
"""
NODES = """*NODE
1, 0, 0, 0
2, 240, 0, 0
3, 240, 20, 0
4, 0, 20, 0
5, 0, 0, 10
6, 240, 0, 10
7, 240, 20, 10
8, 0, 20, 10
"""
STL = """solid s
facet normal 0 -1 0
 outer loop
  vertex 0 50 0
  vertex 200 50 0
  vertex 0 50 90
 endloop
endfacet
endsolid s
"""
CALIBRATION = """%YAML:1.0
---
image_width: 450
image_height: 120
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1500., 0., 224.5, 0., 1500., 59.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -0.01, 0., 0., 0., 0. ]
"""


def text(folder: Path, name: str, content: str) -> None:
    (folder / name).write_text(content)


def changed(content: str) -> str:
    """The same with one number that differs."""
    return content.replace("240", "250").replace("200 ", "210 ").replace("-0.01", "-0.02")


def mesh(folder: Path, other: bool) -> None:
    write_vtu(folder / "brick.vtu", BRICK.points * ([1, 1, 1.1] if other else 1), BRICK.cells)


def field(folder: Path, other: bool) -> None:
    for step in (0, 1):
        u = np.zeros_like(BRICK.points)
        u[:, 2] = BRICK.points[:, 0] * step * (0.02 if other and step else 0.01)
        write_vtu(folder / f"u{step}.vtu", BRICK.points, BRICK.cells, point_data={"U": u})
    write_pvd(folder / "u.pvd", [(float(step), folder / f"u{step}.vtu") for step in (0, 1)])


def picture(folder: Path, other: bool) -> None:
    grey = np.arange(48, dtype=np.uint8).reshape(6, 8) * 4
    assert cv2.imwrite(str(folder / "print.png"), grey + 3 * other)


def panorama(folder: Path, other: bool) -> None:
    np.save(folder / "sky.npy", np.linspace(0.1, 2.0 + other, 32).reshape(4, 8))


def prop(**paint: Any) -> list[dict[str, Any]]:
    return [{"name": "wall", "center_mm": [120.0, 80.0, 5.0], "normal": [0.0, -1.0, 0.0],
             "size_mm": [400.0, 200.0], "paint": [{"name": "print", **paint}]}]  # fmt: skip


def body(**values: Any) -> list[dict[str, Any]]:
    whole = {**DOCUMENT["body"][0], **values}
    return [{key: value for key, value in whole.items() if value is not None}]


PICTURE = {"type": "image", "file": "print.png", "texel_mm": 20.0, "albedo": 0.3,
           "origin_mm": [20.0, 80.0, -40.0]}  # fmt: skip
CAMERA = {key: value for key, value in DOCUMENT["camera"][0].items()
          if key not in ("sensor_mm", "focal_mm")}  # fmt: skip
KINDS: dict[str, tuple[Callable[[Path, bool], None], dict[str, Any]]] = {
    "mesh": (mesh, {"body": body(mesh={"file": "brick.vtu", "unit": "m"}, support=[
        {"name": "clamp", "where": {"x_max_mm": 0.1}, "fix": ["x", "y", "z"]}],
        load=[{**DOCUMENT["body"][0]["load"][0], "where": {"x_min_mm": 239.9}}])}),
    "include": (
        lambda folder, other: [text(folder, "part.inp", INP), text(
            folder, "nodes.inc", changed(NODES) if other else NODES)] and None,
        {"body": body(mesh={"file": "part.inp", "unit": "mm"}, support=[
            {"name": "clamp", "where": {"x_max_mm": 0.1}, "fix": ["x", "y", "z"]}],
            load=[{**DOCUMENT["body"][0]["load"][0], "where": {"x_min_mm": 239.9}}])}),
    "series": (field, {"body": body(mesh=None, support=None, load=None, material=None,
                                    field={"file": "u.pvd", "unit": "m"}),
                       "analysis": {"type": "field", "times": [0.0, 1.0]}, "material": [],
                       "output": {"vtu": True}}),
    "picture": (picture, {"prop": prop(**PICTURE)}),
    "faces": (
        lambda folder, other: text(folder, "thing.stl", changed(STL) if other else STL),
        {"prop": [{"name": "thing", "type": "mesh", "file": "thing.stl", "unit": "mm",
                   "paint": [{"name": "dull", "type": "plain", "albedo": 0.3}]}]}),
    "calibration": (
        lambda folder, other: text(folder, "lens.yml",
                                   changed(CALIBRATION) if other else CALIBRATION),
        {"camera": [{**CAMERA, "calibration": "lens.yml"}]}),
    "panorama": (panorama, {"light": [{"name": "sky", "type": "environment",
                                       "file": "sky.npy"}]}),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_an_edit_between_loading_and_running_is_an_error(kind: str, tmp_path: Path) -> None:
    make, changes = KINDS[kind]
    make(tmp_path, False)
    loaded = small_scene(tmp_path, measure=[], **{"output": {}, **changes})
    with_other = {str(path): path.read_bytes() for path in tmp_path.iterdir()}
    make(tmp_path, True)
    assert any(path.read_bytes() != with_other[str(path)] for path in tmp_path.iterdir())
    with pytest.raises((InputError, SceneError), match="was changed after it was first read"):
        gs.run(loaded, tmp_path / "out", backend="numpy")
    assert not (tmp_path / "out").exists()
    for path, content in with_other.items():  # put back: what was loaded is what is there
        Path(path).write_bytes(content)
    gs.run(loaded, tmp_path / "out", backend="numpy")
    make(tmp_path, True)
    newer = small_scene(tmp_path, measure=[], **{"output": {}, **changes})
    states = {
        stage.name: stage.state for stage in make_plan(newer, tmp_path / "out", "numpy").stages
    }
    assert states["render/side/0001"] == "run"


def test_a_scene_that_is_made_of_another_reads_the_same_files(tmp_path: Path) -> None:
    picture(tmp_path, False)
    loaded = small_scene(tmp_path, prop=prop(**PICTURE), variant=[
        {"name": "a"}, {"name": "b", "set": {"camera.side.focal_mm": 49.0}},
    ])  # fmt: skip
    picture(tmp_path, True)
    for derive in (lambda: loaded.replace("camera.side.focal_mm", 51.0),
                   lambda: loaded.variant("b")):  # fmt: skip
        with pytest.raises(SceneError, match=r"prop\.wall\.paint\.print\.file: was changed after"):
            derive()


def test_files_that_a_file_names_must_be_there(tmp_path: Path) -> None:
    text(tmp_path, "part.inp", INP)
    with pytest.raises(SceneError, match=r"nodes\.inc: not found"):
        small_scene(tmp_path, **KINDS["include"][1])
    field(tmp_path, False)
    (tmp_path / "u1.vtu").unlink()
    with pytest.raises(SceneError, match=r"names u1\.vtu, not found"):
        small_scene(tmp_path, **KINDS["series"][1])
    with pytest.raises(InputError, match="no file of"):
        small_scene().input(str(tmp_path / "part.inp"))


def test_a_result_that_is_edited_during_a_run_is_an_error(tmp_path: Path) -> None:
    """Pictures that are reused are measured as they were recorded, or not at all."""
    whole = small_scene(output={})
    gs.run(whole, tmp_path / "out", backend="numpy")
    scene = Scene.from_document({**whole.document, "measure": [
        {**DOCUMENT["measure"][0], "name": "again"}]})  # fmt: skip
    shown, other = (tmp_path / "out/images/side" / name for name in ("0001.png", "0000.png"))

    def progress(stage: str, done: float, text: str) -> None:
        if stage == "measure" and done == 0.0:
            shutil.copyfile(other, shown)  # into the file that the store has, too

    with pytest.raises(InputError, match=r"0001\.png: .* run again to make it anew"):
        gs.run(scene, tmp_path / "out", backend="numpy", progress=progress)
    report = gs.run(scene, tmp_path / "out", backend="numpy")
    assert {s.name: s.state for s in report.stages}["render/side/0001"] == "run"
    assert report.measurements[0].measured == pytest.approx(1.827, abs=0.01)


def test_a_shown_result_that_is_replaced_during_a_run_changes_nothing(tmp_path: Path) -> None:
    whole, out = small_scene(output={}), tmp_path / "out"
    gs.run(whole, out, backend="numpy")
    scene = Scene.from_document({**whole.document, "measure": [
        {**DOCUMENT["measure"][0], "name": "again"}]})  # fmt: skip
    shown = out / "images/side/0001.png"
    before = shown.read_bytes()

    def progress(stage: str, done: float, text: str) -> None:
        if stage == "measure" and done == 0.0:
            shown.unlink()
            shown.write_bytes((out / "images/side/0000.png").read_bytes())

    report = gs.run(scene, out, backend="numpy", progress=progress)
    assert report.measurements[0].measured == pytest.approx(1.827, abs=0.01)
    assert shown.read_bytes() != before
    gs.run(scene, out, backend="numpy")
    assert shown.read_bytes() == before
