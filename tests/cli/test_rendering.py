"""``gpusim render``: options, the way on, errors."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

from typer.testing import CliRunner, Result

import gpusim as gs
from gpusim.cli import app


def render(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["render", *map(str, arguments)])


def test_a_file_becomes_pictures_truth_and_a_scene_to_go_on_with(
    checkout: Path, tmp_path: Path
) -> None:
    field, out = checkout / "examples" / "strip.frd", tmp_path / "out"
    options = ("--resolution", "153x128", "--speckle-mm", "4", "--step", "all")
    done = render("--field", field, "-o", out, *options)
    assert done.exit_code == 0, done.stderr
    assert f"gpusim run {out / 'scene.toml'} -o {out}" in done.stdout
    assert len(list((out / "images" / "front").glob("*.png"))) == 5
    assert (out / "truth.h5").is_file() and (out / "report.html").is_file()
    scene = gs.load_scene(out / "scene.toml", {"camera.front.focal_mm": 40.0})
    assert scene.bodies[0].paints[0].diameter == 0.004
    again = CliRunner().invoke(
        app, ["run", str(out / "scene.toml"), "-o", str(out), "--set", "light=[]", "--json"]
    )
    report = json.loads(again.stdout)
    states = {stage["name"]: stage["state"] for stage in report["stages"]}
    assert states["render/front/0004"] == states["truth"] == "reused"


def test_an_edited_scene_is_kept_when_the_file_is_rendered_again(
    checkout: Path, tmp_path: Path
) -> None:
    field, out = checkout / "examples" / "strip.frd", tmp_path / "out"
    options = ("--field", field, "-o", out, "--resolution", "153x128", "-q")
    assert render(*options).exit_code == 0
    assert render(*options, "--speckle-mm", "4").exit_code == 0
    assert not list(out.glob("scene-*.toml"))
    edited = "# my camera\n" + (out / "scene.toml").read_text(encoding="utf-8")
    (out / "scene.toml").write_text(edited, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("default")  # as outside of tests
        again = render(*options)
    assert again.exit_code == 0 and "scene-1.toml" in again.stderr
    assert (out / "scene-1.toml").read_text(encoding="utf-8") == edited
    assert gs.load_scene(out / "scene.toml").bodies[0].paints[0].diameter != 0.004


def test_faults_end_with_2_and_leave_nothing(checkout: Path, tmp_path: Path) -> None:
    strip, mesh = (checkout / "examples" / name for name in ("strip.frd", "lug.msh"))
    for arguments, part in (
        (("--field", mesh), "unknown kind of field; got '.msh'"),
        (("--field", strip, "--resolution", "many"), "--resolution; got 'many'; expected like"),
        (("--field", strip, "--camera", mesh), "calibration file"),
        (("--field", strip, "--displacement", "UU"), "no block UU; got results DISP"),
    ):
        done = render(*arguments, "-o", tmp_path / "no")
        assert done.exit_code == 2 and part in done.stderr, done.stderr
    assert not (tmp_path / "no").exists()
