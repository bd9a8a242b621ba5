"""Several states of a scene in one run: planned, made, compared, reused, refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import binary_erosion, gaussian_filter

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.files.picture_file import read_grey
from gpusim.pipeline import run
from gpusim.plan.plan import make_plan
from tests.support.documented_tables import documented_columns, head
from tests.support.small_crane import crane

NOTCH = {"position_mm": 110.0, "width_mm": 1.0, "depth_mm": 5.0, "side": "-z"}
CHANGES: dict[str, Any] = {
    "body.bar.mesh": {
        "builder": "beam", "length_mm": 240.0, "width_mm": 20.0, "height_mm": 10.0,
        "divisions": [48, 3, 6],
    },
    "body.bar.paint.side.line": {
        "start_mm": [8.0, -10.0, 0.0], "end_mm": [236.0, -10.0, 0.0], "count": 15,
    },
    "body.bar.paint.side.size_mm": 5.0,
    "camera.side.resolution_px": [1000, 400],
    "camera.side.target_mm": [120.0, 0.0, 0.0],
    "camera.side.position_mm": [120.0, -1000.0, 0.0],
    "body.bar.load.push.force_N": [0.0, 0.0, -150.0],
    "variant": [{"name": "whole"}, {"name": "cut", "set": {"body.bar.notch": [NOTCH]}}],
}  # fmt: skip


def scene_of(checkout: Path, **more: Any) -> gs.Scene:
    path = checkout / "examples" / "cantilever.toml"
    deflection = gs.load_scene(path).document["measure"][0]
    damage = {"name": "damage", "type": "damage", "of": "deflection", "reference": "whole"}
    return gs.load_scene(path, {**CHANGES, "measure": [deflection, damage], **more})


@pytest.fixture(scope="module")
def done(
    checkout: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[gs.Scene, gs.Report, Path]:
    scene, out = scene_of(checkout), tmp_path_factory.mktemp("variants") / "out"
    return scene, run(scene, out), out


def test_the_notch_is_located(done: tuple[gs.Scene, gs.Report, Path], checkout: Path) -> None:
    _, report, out = done
    notch = report.measurements[0]
    assert notch.name.startswith("cut: notch 1") and notch.truth == 110.0
    assert abs(notch.error) <= 4.0 and notch.verdict == "good"
    structure, images = report.measurements[1:3]
    assert structure.name.endswith("structure") and images.name.endswith("images")
    assert abs(structure.error) <= 0.5
    assert structure.error + images.error == pytest.approx(notch.error, abs=1e-9)
    noise = next(m for m in report.measurements if "RMS error of the difference" in m.name)
    assert noise.measured <= 0.005  # px
    with (out / "measure" / "damage-breaks.csv").open() as file:
        (found,) = csv.DictReader(file)
    assert found["state"] == "cut" and float(found["notch_mm"]) == 110.0
    lines = (out / "measure" / "damage.csv").read_text().splitlines()
    assert len(lines) == 1 + 2 * 15
    for ending in ("", "-breaks"):
        documented = documented_columns(checkout, f"measure/<damage>{ending}.csv")
        assert head(out / f"measure/damage{ending}.csv") == documented


def test_each_state_has_its_own_folder_and_report(
    done: tuple[gs.Scene, gs.Report, Path],
) -> None:
    scene, report, out = done
    for name in ("whole", "cut"):
        folder = out / "variants" / name
        assert (folder / "report.html").is_file()
        assert (folder / "images" / "side" / "0001.png").is_file()
        assert gs.load_scene(folder / "scene.toml") == scene.variant(name)
    assert (out / "report.html").stat().st_size > 10_000
    assert gs.load_scene(out / "scene.toml") == scene
    assert {s.name for s in report.stages} >= {"whole/solve", "cut/measure", "damage"}
    assert report.warnings == ()


def test_a_rerun_reuses_the_states(done: tuple[gs.Scene, gs.Report, Path]) -> None:
    scene, first, out = done
    plan = make_plan(scene, out)
    again = [s.name for s in plan.stages if s.runs]
    assert [n for n in again if not n.endswith("report")] == ["damage"]
    told: dict[str, str] = {}
    second = run(scene, out, progress=lambda stage, _, words: told.update({stage: words}))
    # one line for each state, and what is made
    assert {*told} - {"damage", "report"} == {"whole", "cut", "whole/report", "cut/report"}
    assert told["whole"].startswith("of its stages ") and " reused" in told["whole"]
    assert [m.measured for m in second.measurements] == pytest.approx(
        [m.measured for m in first.measurements], nan_ok=True, rel=1e-12
    )


def test_one_new_state_leaves_the_others_alone(
    done: tuple[gs.Scene, gs.Report, Path], checkout: Path
) -> None:
    _, _, out = done
    moved = [{"name": "whole"}, {"name": "cut", "set": {"body.bar.notch": [{**NOTCH,
             "position_mm": 60.0}]}}]  # fmt: skip
    plan = make_plan(scene_of(checkout, variant=moved), out)
    assert not plan["whole/solve"].runs and plan["cut/solve"].runs


def test_states_share_no_noise_but_the_sensor(checkout: Path, tmp_path: Path) -> None:
    """Photographed one after the other: noise that they shared would cancel in differences."""
    twice = [{"name": "whole"}, {"name": "again"}, {"name": "same", "set": {"sensor.series": 0}}]
    scene = scene_of(
        checkout, variant=twice, measure=[],
        sensor={"bits": 12, "full_well_e": 8000.0, "dsnu_e": 60.0, "read_noise_e": 20.0,
                "black_level_DN": 200.0},
    )  # fmt: skip
    run(scene, tmp_path)
    whole, again, same = (
        read_grey(tmp_path / "variants" / v["name"] / "images" / "side" / "0001.png").astype(float)
        for v in twice
    )
    assert np.array_equal(whole, same)
    # few electrons: the offsets of the pixels outweigh the other noise
    dark = binary_erosion(gaussian_filter(whole, 3.0) < 300, iterations=12)
    assert dark.sum() > 5000
    assert (whole - again)[dark].std() > 10
    left = [image - gaussian_filter(image, 3.0) for image in (whole, again)]
    # offsets of 60 e in both, 20 e of their own
    assert 0.7 < np.corrcoef(left[0][dark], left[1][dark])[0, 1] < 0.98
    series = [scene.variant(v["name"]).sensor.series for v in twice]
    assert series == [0, 1, 0]


def test_what_is_wrong_in_a_state_is_told(checkout: Path) -> None:
    wrong = [
        {"name": "whole", "set": {"camera.front.focal_mm": 3.0}},
        {"name": "cut", "set": {"body.bar.notch": [{**NOTCH, "depth_mm": -1.0}]}},
    ]
    with pytest.raises(SceneError) as caught:
        scene_of(checkout, variant=wrong)
    text = str(caught.value)
    assert "variant.whole.set -> camera.front: no such item" in text
    assert "variant.cut.set -> body.bar.notch.0.depth_mm" in text
    with pytest.raises(SceneError, match=r"measure\.[a-z]+\.reference: no such variant"):
        scene_of(checkout, variant=[])
    with pytest.raises(SceneError, match="name used twice"):
        scene_of(checkout, variant=[{"name": "whole"}, {"name": "whole"}])


def test_a_state_that_fails_says_so(checkout: Path, tmp_path: Path) -> None:
    two = [{"name": "whole"}, {"name": "cut", "set": {"solver.max_iterations": 1,
                                                     "solver.method": "multigrid"}}]  # fmt: skip
    with pytest.raises(gs.NotConverged):
        run(scene_of(checkout, variant=two), tmp_path / "out")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["status"] == "failed" and "variant 'cut'" in report["warnings"][0]


def test_a_state_whose_page_cannot_be_written_says_so(
    checkout: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr("gpusim.pipeline.runner.execution.write_report", full)
    with pytest.raises(OSError, match="no space left"):
        run(scene_of(checkout, variant=[{"name": "whole"}], measure=[]), tmp_path / "out")
    report = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    assert report["status"] == "failed"
    assert "variant 'whole': OSError: no space left" in report["warnings"][0]


def test_example_is_valid(checkout: Path) -> None:
    scene = gs.load_scene(checkout / "examples" / "damaged_beam.toml")
    assert [v.name for v in scene.variants] == [
        "intact", "one-notch", "two-notches", "three-notches",
    ]  # fmt: skip
    notches = [len(scene.variant(v.name).bodies[0].mesh.notches) for v in scene.variants]  # type: ignore[union-attr]
    assert notches == [0, 1, 2, 3] and np.isclose(scene.cameras[0].focal, 0.043)


def test_cameras_of_one_name_see_what_is_before_them(tmp_path: Path) -> None:
    """Bodies stand alike in all variants, and no frame comes between their pictures."""
    changes: list[dict[str, Any]] = [
        {"camera.front.position_mm": [350.0, -1020.0, 290.0]}, {"camera.front.focal_mm": 25.0}, {}
    ]  # fmt: skip
    sets = [{"sensor.series": 0, **change} for change in changes]
    variants = [{"name": f"v{number}", "set": change} for number, change in enumerate(sets)]
    scene = crane(variant=variants).replace("analysis.load_factors", [1.0])
    run(scene, tmp_path / "all", backend="numpy")
    name = "images/front/0000.png"
    pictures = []
    for number in range(len(sets)):
        run(scene.variant(f"v{number}"), tmp_path / f"{number}", backend="numpy")
        pictures.append((tmp_path / "all" / "variants" / f"v{number}" / name).read_bytes())
        assert pictures[-1] == (tmp_path / f"{number}" / name).read_bytes()
    assert len(set(pictures)) == 3
