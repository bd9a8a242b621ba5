"""What is run, skipped and reused, and why."""

from __future__ import annotations

import copy
import json
import os
from pathlib import Path

import numpy as np
import pytest

from gpusim.errors import SceneError
from gpusim.optics.light.lights import EnvironmentLight
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.plan.decision import decide, states_of
from gpusim.plan.plan import Plan, make_plan
from gpusim.plan.programs import earlier_programs, keep_programs
from gpusim.plan.stages import START_SECONDS, RunOptions
from gpusim.scene import Scene, load_scene
from tests.support.speckled_plate import speckled_plate


@pytest.fixture(scope="module")
def crane(checkout: Path) -> Scene:
    return load_scene(checkout / "examples" / "crane.toml")


def pretend_run(scene: Scene, out: Path) -> None:
    """Keep what a run would: a file of each stage that writes any."""
    decision = decide(states_of(scene), out, RunOptions("gpu"))
    assert decision.store is not None
    for task in decision.graph.order():
        name = f"{task.stage.name}/{task.record}.bin"
        record = decision.store.put(task.key, task.stage.name, {name: task.key.encode()}, {})
        decision.folders[""].show(record, decision.store)
    decision.folders[""].depends(decision.graph.parts[""])
    decision.folders[""].close()
    decision.store.collect(decision.graph.kept(""))
    decision.store.close()


def states(plan: Plan) -> dict[str, str]:
    return {stage.name: stage.state for stage in plan.stages}


def running(plan: Plan) -> set[str]:
    return {stage.name for stage in plan.stages if stage.runs}


def test_a_new_run_of_the_crane(crane: Scene, tmp_path: Path) -> None:
    plan = make_plan(crane, tmp_path / "absent", "gpu")
    assert [stage.name for stage in plan.stages] == [
        "mesh", "model", "solve", "surface", "render/front/0000", "render/front/0001",
        "truth/front", "truth", "measure", "stress", "export", "report",
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
    pretend_run(crane, tmp_path)
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


TRUTH = "truth/front", "truth"


@pytest.mark.parametrize(
    ("key", "value", "runs"),
    [
        ("camera.front.focal_mm", 31.0,
         {"mesh", "model", "surface", "render/front/0000", "render/front/0001", *TRUTH,
          "measure"}),
        ("light.lamp-far.power_W", 30.0,
         {"mesh", "surface", "render/front/0000", "render/front/0001", "measure"}),
        ("body.crane.load.weight.force_N.2", -12.0,
         {"mesh", "model", "solve", "surface", "render/front/0001", *TRUTH, "measure", "export"}),
        ("solver.tolerance", 1e-7,
         {"mesh", "model", "solve", "surface", "render/front/0001", *TRUTH, "measure", "export"}),
        ("analysis.geometry", "linear",  # frames depend on other loads without it
         {"mesh", "model", "surface", "render/front/0001", *TRUTH, "measure", "export"}),
        ("analysis.load_factors", [0.0, 1.0, 2.0],
         {"mesh", "model", "solve", "surface", "render/front/0001", "render/front/0002", *TRUTH,
          "measure", "export"}),
        ("analysis.load_factors", [0.0, 0.5],
         {"mesh", "model", "solve", "surface", "render/front/0001", *TRUTH, "measure", "export"}),
        ("measure.deflection.subset_px", 15, {"mesh", "surface", "measure"}),
        ("output.vtu", False, {"mesh", "surface", "export"}),
        ("output.truth", ["flow"], {"mesh", "surface", *TRUTH}),
        ("output.truth", [], set()),
        ("name", "Another crane", {"mesh", "surface", "truth"}),  # which says whose it is
        ("body.crane.paint.steel.albedo", 0.3,
         {"mesh", "surface", "render/front/0000", "render/front/0001", *TRUTH, "measure",
          "export"}),
    ],
)  # fmt: skip
def test_a_change_runs_what_depends_on_it(
    crane: Scene, tmp_path: Path, key: str, value: object, runs: set[str]
) -> None:
    pretend_run(crane, tmp_path)
    assert running(make_plan(crane.replace(key, value), tmp_path)) == runs | {"report"}


def test_by_linear_theory_a_frame_depends_on_its_own_load_alone(
    crane: Scene, tmp_path: Path
) -> None:
    linear = crane.replace("analysis.geometry", "linear")
    pretend_run(linear, tmp_path)
    more = linear.replace("analysis.load_factors", [0.0, 1.0, 2.0])
    after = {"measure", "export", "report", *TRUTH}
    assert running(make_plan(more, tmp_path)) == {
        "mesh", "model", "surface", "render/front/0002", *after
    }  # fmt: skip


def test_automatic_exposure_ties_frames_to_the_first(crane: Scene) -> None:
    """With a fixed exposure a frame depends on its own load factor alone."""
    linear = crane.replace("analysis.geometry", "linear")
    for exposure, tied in (("auto", True), (0.5, False)):
        scene = linear.replace("sensor.exposure", exposure)
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
    pretend_run(scene, tmp_path)
    with (tmp_path / "picture/front/1.bin").open("r+b") as stream:
        stream.write(b"x")
    assert running(make_plan(scene, tmp_path)) == {
        "mesh", "surface", "render/front/0001", "report",
    }  # fmt: skip


def test_going_back_and_forth_never_reuses_what_was_overwritten(
    crane: Scene, tmp_path: Path
) -> None:
    other = crane.replace("camera.front.focal_mm", 31.0)
    for scene in (crane, other):
        pretend_run(scene, tmp_path)
    plan = make_plan(crane, tmp_path)
    assert plan["solve"].state == "reused"
    assert plan["render/front/0000"].runs


@pytest.mark.parametrize("damage", ["gone", "changed", "torn", "no log"])
def test_damaged_results_are_made_again(crane: Scene, tmp_path: Path, damage: str) -> None:
    pretend_run(crane, tmp_path)
    (log,) = (tmp_path / ".gpusim" / "log").iterdir()
    shown = tmp_path / "solve" / "0.bin"
    if damage == "gone":
        os.unlink(next(one for one in (tmp_path / ".gpusim/blobs").rglob("*")
                       if one.is_file() and one.samefile(shown)))  # fmt: skip
    elif damage == "changed":
        with shown.open("r+b") as stream:
            stream.write(b"x")
    elif damage == "torn":
        lines = log.read_bytes().splitlines(keepends=True)
        log.write_bytes(b"".join(line.replace(b'"solve"', b'"Solve"') for line in lines))
    else:
        log.unlink()
    plan = make_plan(crane, tmp_path)
    assert plan["solve"].runs
    assert plan["render/front/0000"].runs == (damage == "no log")
    reasons = {"gone": "solve/0.bin is gone", "changed": "solve/0.bin was changed"}
    assert plan["solve"].reason == reasons.get(damage, "not made yet")


def test_a_result_with_size_and_time_set_back_is_found_by_its_bytes(
    crane: Scene, tmp_path: Path
) -> None:
    pretend_run(crane, tmp_path)
    shown = tmp_path / "solve" / "0.bin"
    before = shown.stat()
    with shown.open("r+b") as stream:
        stream.write(b"x")
    os.utime(shown, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert make_plan(crane, tmp_path)["solve"].state == "reused"
    plan = make_plan(crane, tmp_path, verify=True)
    assert plan["solve"].runs and plan["solve"].reason == "solve/0.bin was changed"


def test_a_reason_names_what_changed(crane: Scene, tmp_path: Path) -> None:
    crane = crane.replace("analysis.geometry", "linear")
    pretend_run(crane, tmp_path)
    plan = make_plan(crane.replace("camera.front.focal_mm", 31.0), tmp_path)
    assert plan["render/front/0000"].reason == "camera.front changed"
    plan = make_plan(crane.replace("body.crane.load.weight.force_N.2", -12.0), tmp_path)
    assert plan["render/front/0001"].reason == "body.crane.solid changed"
    plan = make_plan(crane.replace("analysis.load_factors", [0.0, 0.5]), tmp_path)
    assert plan["render/front/0001"].reason == "loads or places of frames changed"


def test_ten_thousand_frames_are_planned_in_proportion(crane: Scene) -> None:
    """Twice as many frames have twice as many tasks, not four times."""
    counts = []
    for frames in (500, 1000):
        factors = [k / (frames - 1) for k in range(frames)]
        many = crane.replace("analysis.load_factors", factors)
        counts.append(len(decide(states_of(many), None, RunOptions("gpu")).graph.tasks))
    assert counts[1] - counts[0] == 2 * 500  # radiance and picture


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
    assert (
        reasons["export"]
        == "not asked for: neither vtu, stl, labels nor calibration in [output], no [video]"
    )
    moved = document["body"][0]["support"][0]
    moved["displacement_mm"] = [0.0, 0.0, 1.0]
    assert make_plan(Scene.from_document(document))["solve"].runs


def test_what_a_measurement_takes_is_known_for_its_subsets_alone() -> None:
    works = [
        {work.kind: work for work in make_plan(speckled_plate({"camera": "left"} | asked)).works}[
            "measure"
        ]
        for asked in ({}, {"min_zncc": 0.5}, {"step_px": 5})
    ]
    first, same, finer = (work.signature for work in works)
    assert first == same != finer


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
    pretend_run(small, tmp_path)
    kept = make_plan(small, tmp_path, fresh=True)["render/front/0000"]
    assert 2.0 < kept.seconds < 6.0 and "shaders are loaded" in kept.detail
    assert make_plan(small, backend="numpy")["render/front/0000"].seconds == pytest.approx(
        second.seconds
    )
    # a whole frame of the crane: 3.2 s of processor time on two cores, written, once everything is
    # compiled
    assert 0.8 < make_plan(crane)["render/front/0001"].seconds < 3.2


def test_programs_of_a_run_are_kept(tmp_path: Path) -> None:
    assert earlier_programs(tmp_path) == []
    shade = ("optics/shading/forward_pass", ("vertex", "fragment"), (("lit", np.float64(1)),))
    kept = ["optics/shading/forward_pass", ["vertex", "fragment"], [["lit", 1.0]]]
    keep_programs(tmp_path, [shade, ("fem/krylov/cg", "main", ())])
    assert earlier_programs(tmp_path) == [kept]
    # what a run that takes up another's work asks for comes to that
    keep_programs(tmp_path, [("optics/edge_pixels/resolve", "main", ()), shade])
    assert earlier_programs(tmp_path) == [["optics/edge_pixels/resolve", "main", []], kept]
    (tmp_path / ".gpusim" / "programs.json").write_text('[["x", {}], {"a": 1}, 5')
    assert earlier_programs(tmp_path) == []


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
