"""What is run, skipped and reused, and why."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import InputError, SceneError
from gpusim.optics.light.lights import EnvironmentLight
from gpusim.pipeline.build.lights import build_lights
from gpusim.plan.plan import Plan, make_plan
from gpusim.plan.stages import START_SECONDS
from gpusim.plan.state import StateFile
from gpusim.scene import Scene, load_scene

PERSISTENT = ("solve", "render", "truth", "measure", "export")


@pytest.fixture(scope="module")
def crane(checkout: Path) -> Scene:
    return load_scene(checkout / "examples" / "crane.toml")


def pretend_run(plan: Plan, out: Path) -> None:
    """Write what a run of the plan would: one file per stage that writes any."""
    out.mkdir(exist_ok=True)
    state = StateFile(out)
    for stage in plan.stages:
        if stage.runs and stage.name == "mesh":
            state.record("mesh", stage.key, [], {})
        if stage.runs and stage.name.split("/")[0] in PERSISTENT:
            path = out / f"{stage.name}.bin"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(stage.key, encoding="utf-8")
            state.record(stage.name, stage.key, [path])


def states(plan: Plan) -> dict[str, str]:
    return {stage.name: stage.state for stage in plan.stages}


def running(plan: Plan) -> set[str]:
    return {stage.name for stage in plan.stages if stage.runs}


def test_a_new_run_of_the_crane(crane: Scene, tmp_path: Path) -> None:
    plan = make_plan(crane, tmp_path / "absent", "gpu")
    assert [stage.name for stage in plan.stages] == [
        "mesh", "model", "solve", "surface", "render/front/0000", "render/front/0001", "truth",
        "measure", "stress", "export", "report",
    ]  # fmt: skip
    assert running(plan) == set(states(plan)) - {"stress"}
    assert plan["stress"].reason == "not asked for: [output] stress is false"
    assert not (tmp_path / "absent").exists()
    assert all(s.seconds > 0 and s.memory_bytes > 0 for s in plan.stages if s.runs)
    assert len({stage.key for stage in plan.stages}) == len(plan.stages)
    frame = plan["render/front/0001"]
    assert (frame.camera, frame.frame) == ("front", 1)
    assert frame.detail == "5616x3744 px, 3 lights, shadows of 2, pinhole, no noise, load x 1"
    assert plan["measure"].detail == "26 markers"
    json.dumps(plan.to_dict(), allow_nan=False)
    with pytest.raises(KeyError):
        plan["render"]


def test_nothing_changed(crane: Scene, tmp_path: Path) -> None:
    pretend_run(make_plan(crane, tmp_path), tmp_path)
    plan = make_plan(crane, tmp_path)
    assert running(plan) == {"report"}
    assert plan["mesh"].state == plan["model"].state == plan["surface"].state == "skipped"
    assert plan["mesh"].reason == "nothing that runs needs it"
    assert plan["solve"].state == "reused"
    assert plan.seconds == START_SECONDS + plan["report"].seconds
    assert running(make_plan(crane, tmp_path, fresh=True)) == set(states(plan)) - {"stress"}
    assert make_plan(crane, tmp_path, fresh=True)["solve"].reason == "--fresh"
    assert running(make_plan(crane, tmp_path, skip=False)) == set(states(plan)) - {"stress"}
    assert "render/front/0000" in running(make_plan(crane, tmp_path, "numpy"))


@pytest.mark.parametrize(
    ("key", "value", "runs"),
    [
        ("camera.front.focal_mm", 31.0,
         {"mesh", "surface", "render/front/0000", "render/front/0001", "truth", "measure"}),
        ("light.lamp-far.power_W", 30.0,
         {"mesh", "surface", "render/front/0000", "render/front/0001", "measure"}),
        ("body.crane.load.weight.force_N.2", -12.0,
         {"mesh", "model", "solve", "surface", "render/front/0001", "truth", "measure", "export"}),
        ("solver.tolerance", 1e-7,
         {"mesh", "model", "solve", "surface", "render/front/0001", "truth", "measure", "export"}),
        ("analysis.load_factors", [0.0, 1.0, 2.0],
         {"mesh", "surface", "render/front/0002", "truth", "measure", "export"}),
        ("analysis.load_factors", [0.0, 0.5],
         {"mesh", "surface", "render/front/0001", "truth", "measure", "export"}),
        ("measure.deflection.subset_px", 15, {"mesh", "surface", "measure"}),
        ("output.vtu", False, {"mesh", "surface", "export"}),
        ("output.truth", ["flow"], {"mesh", "surface", "truth"}),
        ("output.truth", [], set()),
        ("name", "Another crane", set()),
        ("body.crane.paint.steel.albedo", 0.3,
         {"mesh", "surface", "render/front/0000", "render/front/0001", "truth", "measure",
          "export"}),
    ],
)  # fmt: skip
def test_a_change_runs_what_depends_on_it(
    crane: Scene, tmp_path: Path, key: str, value: object, runs: set[str]
) -> None:
    pretend_run(make_plan(crane, tmp_path), tmp_path)
    assert running(make_plan(crane.replace(key, value), tmp_path)) == runs | {"report"}


def test_automatic_exposure_ties_frames_to_the_first(crane: Scene) -> None:
    """With a fixed exposure a frame depends on its own load factor alone."""
    for exposure, tied in (("auto", True), (0.5, False)):
        scene = crane.replace("sensor.exposure", exposure)
        other = scene.replace("analysis.load_factors", [0.3, 1.0])
        a = make_plan(scene)["render/front/0001"].key
        b = make_plan(other)["render/front/0001"].key
        assert (a != b) == tied


def test_a_body_named_like_a_key_hides_no_other(crane: Scene) -> None:
    document = crane.document
    second = copy.deepcopy(document["body"][0])
    document["body"][0]["name"] = "mesh"
    second |= {"name": "second", "paint": [{"name": "grey", "type": "plain", "albedo": 0.3}]}
    document["body"].append(second)
    both = Scene.from_document(document)
    changed = both.replace("body.second.mesh.width_mm", 41.0)
    assert make_plan(both)["solve"].key != make_plan(changed)["solve"].key


def test_frames_of_equal_load_have_results_of_their_own(crane: Scene, tmp_path: Path) -> None:
    scene = crane.replace("analysis.load_factors", [0.0, 1.0, 1.0])
    pretend_run(make_plan(scene, tmp_path), tmp_path)
    (tmp_path / "render/front/0001.bin").unlink()
    assert running(make_plan(scene, tmp_path)) == {
        "mesh", "surface", "render/front/0001", "report",
    }  # fmt: skip


def test_going_back_and_forth_never_reuses_what_was_overwritten(
    crane: Scene, tmp_path: Path
) -> None:
    other = crane.replace("camera.front.focal_mm", 31.0)
    for scene in (crane, other):
        pretend_run(make_plan(scene, tmp_path), tmp_path)
    plan = make_plan(crane, tmp_path)
    assert plan["solve"].state == "reused"
    assert plan["render/front/0000"].runs


@pytest.mark.parametrize("damage", ["gone", "changed", "state", "version"])
def test_damaged_results_are_made_again(crane: Scene, tmp_path: Path, damage: str) -> None:
    pretend_run(make_plan(crane, tmp_path), tmp_path)
    target = tmp_path / "solve.bin"
    state = tmp_path / "state.json"
    if damage == "gone":
        target.unlink()
    elif damage == "changed":
        text = target.read_text(encoding="utf-8")
        target.write_text(text[:-1] + ("0" if text[-1] != "0" else "1"), encoding="utf-8")
    elif damage == "state":
        state.write_bytes(state.read_bytes()[: state.stat().st_size // 2])
    else:
        state.write_text(json.dumps({"version": 99, "stages": {}}), encoding="utf-8")
    plan = make_plan(crane, tmp_path)
    assert plan["solve"].runs
    if damage in ("gone", "changed"):
        assert (
            plan["solve"].reason == f"solve.bin {'is gone' if damage == 'gone' else 'was changed'}"
        )
        assert plan["render/front/0000"].state == "reused"
    else:
        assert StateFile(tmp_path).problem
        assert plan["render/front/0000"].runs


@pytest.mark.parametrize(
    "text",
    ["[]", '{"version": 1}', '{"version": 1, "stages": [1]}', "3", "", "[" * 100_000],
    ids=["list", "bare", "wrong stages", "number", "empty", "nested"],
)
def test_any_state_file_is_survived(tmp_path: Path, text: str) -> None:
    (tmp_path / "state.json").write_text(text, encoding="utf-8")
    state = StateFile(tmp_path)
    assert state.problem
    assert state.fault("x", "solve") == state.problem


@pytest.mark.parametrize("at", [0, (37 << 20) + 12345, (66 << 20) - 1])
def test_large_files_of_one_size_are_told_apart(tmp_path: Path, at: int) -> None:
    """By every byte."""
    path = tmp_path / "0000.tif"
    with path.open("wb") as stream:
        stream.truncate(66 << 20)
    state = StateFile(tmp_path)
    state.record("render", "key", [path])
    assert StateFile(tmp_path).fault("key", "render") is None
    with path.open("r+b") as stream:
        stream.seek(at)
        stream.write(b"x")
    assert StateFile(tmp_path).fault("key", "render") == "0000.tif was changed"


def test_skipped_because_the_scene_does_not_need_it(crane: Scene) -> None:
    document = crane.document
    document["body"][0]["load"] = []
    document["measure"] = []
    document["camera"] = []
    document["output"] = {}
    plan = make_plan(Scene.from_document(document))
    assert running(plan) == {"report"}
    reasons = {stage.name: stage.reason for stage in plan.stages}
    assert reasons["solve"] == "no load and no prescribed displacement"
    assert reasons["render"] == "no [[camera]]"
    assert reasons["measure"] == "not asked for: no [[measure]]"
    assert reasons["truth"] == "not asked for: [output] truth is empty"
    assert reasons["export"] == "not asked for: neither vtu nor stl in [output]"
    moved = document["body"][0]["support"][0]
    moved["displacement_mm"] = [0.0, 0.0, 1.0]
    assert make_plan(Scene.from_document(document))["solve"].runs


def test_a_scene_without_bodies(crane: Scene) -> None:
    document = crane.document
    del document["body"], document["measure"], document["output"]
    plan = make_plan(Scene.from_document(document))
    assert running(plan) == {"surface", "render/front/0000", "render/front/0001", "report"}
    assert plan["solve"].reason == "no [[body]]"


def test_no_skip_computes_even_what_is_trivially_zero(crane: Scene) -> None:
    still = crane.replace("analysis.load_factors", [0.0, 0.0])
    assert make_plan(still)["solve"].reason == "every load factor is 0"
    assert make_plan(still, skip=False)["solve"].runs


def test_files_of_a_replaced_result_go_unless_someone_changed_them(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in "abcd":
        (out / name).write_text(name)
    state = StateFile(out)
    state.record("export", "old", ["a", "b", "c"])
    state.record("truth", "other", ["d"])
    (out / "c").write_text("mine")
    StateFile(out).record("export", "new", ["a"])
    assert {path.name for path in out.iterdir()} == {"a", "c", "d", "state.json"}


def test_state_takes_only_files_of_its_folder(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (tmp_path / "elsewhere").write_text("x", encoding="utf-8")
    state = StateFile(out)
    for file in (tmp_path / "elsewhere", "../elsewhere", "absent"):
        with pytest.raises(InputError, match="expected a file in"):
            state.record("solve", "k", [file])
    (out / "a").write_text("x", encoding="utf-8")
    state.record("solve", "k", ["a"])
    assert StateFile(out).files("k") == (out / "a",)
    assert StateFile(out).fault("k", "solve") is None
    assert StateFile(out).fault("other", "solve") == "its inputs changed"
    assert StateFile(out).fault("k2", "export") == "not made yet"


def test_shaders_are_compiled_once_and_that_counts(crane: Scene, tmp_path: Path) -> None:
    """Measured on two cores, 1404 x 936 px: 12 s of processor time for the first frame of the lit
    steel crane, 0.3 s for the second; 5.6 and 0.2 s unlit; 3.9 s with what the driver has kept."""
    small = crane.replace("camera.front.resolution_px", [1404, 936]).replace("measure", [])
    first, second = (make_plan(small)[f"render/front/000{k}"] for k in (0, 1))
    assert 9.0 < first.seconds < 15.0 and 0.15 < second.seconds < 0.6
    assert "shaders are compiled" in first.detail and "shaders" not in second.detail
    unlit = [make_plan(small.replace("light", []))[f"render/front/000{k}"] for k in (0, 1)]
    assert 4.0 < unlit[0].seconds < 8.0 and 0.1 < unlit[1].seconds < 0.5
    plan = make_plan(small, tmp_path)
    assert plan["render/front/0000"].seconds == first.seconds
    pretend_run(plan, tmp_path)
    kept = make_plan(small, tmp_path, fresh=True)["render/front/0000"]
    assert 2.0 < kept.seconds < 6.0 and "shaders are loaded" in kept.detail
    assert make_plan(small, backend="numpy")["render/front/0000"].seconds == pytest.approx(
        second.seconds
    )
    # a whole frame of the crane: 3.2 s of processor time on two cores, written, once everything is
    # compiled
    assert 0.8 < make_plan(crane)["render/front/0001"].seconds < 3.2


def test_programs_of_a_run_are_kept(tmp_path: Path) -> None:
    state = StateFile(tmp_path)
    assert state.programs == []
    (tmp_path / "picture.png").write_bytes(b"")
    state.add_programs(
        [("optics/shading/forward_pass", ("vertex", "fragment"), (("lit", np.float64(1)),))]
    )
    state.record("render", "k", ["picture.png"])
    shade = ["optics/shading/forward_pass", ["vertex", "fragment"], [["lit", 1.0]]]
    again = StateFile(tmp_path)
    assert again.programs == [shade]
    # what a run that takes up another's work asks for comes to that
    again.add_programs([("optics/edge_pixels/resolve", "main", ()), tuple(shade)])
    again.record("truth", "t", ["picture.png"])
    assert StateFile(tmp_path).programs == [["optics/edge_pixels/resolve", "main", []], shade]


def test_occlusion_is_planned_where_it_is_asked_for(crane: Scene, tmp_path: Path) -> None:
    plain = make_plan(crane, tmp_path)["render/front/0001"]
    hidden = crane.replace("light.room.occlusion", True)
    frame = make_plan(hidden, tmp_path)["render/front/0001"]
    assert "shadows of 2, surroundings hidden by surfaces, pinhole" in frame.detail
    assert frame.seconds > plain.seconds
    lights = build_lights(hidden)
    assert lights is not None
    assert isinstance(lights[2], EnvironmentLight)
    assert lights[2].occlusion
    with pytest.raises(SceneError, match="occlusion"):
        crane.replace("light.room.occlusion", "yes")
    with pytest.raises(SceneError, match="occlusion"):
        crane.replace("light.lamp-far.occlusion", True)
