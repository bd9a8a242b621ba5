"""Scenes as graphs: stages get what their keys name, and variants share what is equal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gpusim.graph.runner import Runner
from gpusim.pipeline import run
from gpusim.pipeline.stages import bodies
from gpusim.plan.decision import decide, states_of
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from tests.hostile.tiny_runs import results
from tests.support.every_table import everything, given_field, write_inputs
from tests.support.small_crane import crane, crane_variants
from tests.support.small_scene import small_scene


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter[str]]:
    """How many records of each stage were made."""
    count, make = Counter[str](), Runner._made

    def counted(self: Runner, task: Any, inputs: Any) -> Any:
        count[task.stage.name] += 1
        return make(self, task, inputs)

    monkeypatch.setattr(Runner, "_made", counted)
    yield count


def test_every_kind_of_table_runs_on_parts_alone(
    tmp_path: Path, checkout: Path, made: Counter[str]
) -> None:
    """A stage that read anything else would be an error."""
    write_inputs(tmp_path)
    first = Scene.from_document(everything(), folder=tmp_path)
    second = Scene.from_document(given_field(checkout / "examples" / "strip.frd"), folder=tmp_path)
    third = small_scene(analysis={"geometry": "linear"})
    for number, scene in enumerate((first, second, third)):
        report = run(scene, tmp_path / str(number))
        assert report.status == "done"
    kinds = {name.split("/")[0] for name in made}
    assert kinds == {
        "mesh", "surface", "props", "meshes", "geometry", "model", "solve", "solution",
        "equilibria", "motion",
        "linear theory", "radiance", "exposure", "picture", "target", "calib-exposure",
        "calib-picture", "truth", "measure", "stress", "fields", "export", "calibration files",
    }  # fmt: skip
    before = made.copy()
    for number, scene in enumerate((first, second, third)):
        run(scene, tmp_path / str(number))
    assert made == before


def test_stages_are_given_parts(tmp_path: Path) -> None:
    write_inputs(tmp_path)
    scene = Scene.from_document(everything(), folder=tmp_path)
    decision = decide(states_of(scene), None, RunOptions("numpy"))
    known: dict[str, set[str]] = {}
    for stage in decision.stages[""].stages:
        known.setdefault(stage.name.split("/")[0], set()).update(vars(stage.argument))
    tables = {kind: names - {"source", "files"} for kind, names in known.items()}
    assert tables["solve"] == {"solver", "bodies"} and tables["mesh"] == {"bodies"}
    assert tables["radiance"] == {"cameras", "lights", "render", "props", "bodies"}
    assert tables["exposure"] == {"cameras", "lights", "sensor"}
    assert tables["picture"] == {"cameras", "sensor"}
    assert all("content" not in names for names in known.values())


@pytest.mark.parametrize("section", ["cameras", "sensor", "analysis", "output", "name", "content"])
def test_a_stage_that_reads_what_its_key_doesnt_hold_is_red(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, section: str
) -> None:
    mesh = bodies.mesh

    def curious(scene: Scene, *rest: Any) -> Any:
        getattr(scene, section)
        return mesh(scene, *rest)

    monkeypatch.setattr(bodies, "mesh", curious)
    with pytest.raises(AttributeError, match=section):
        run(small_scene(), tmp_path / "out", backend="numpy")


def test_a_stage_that_reads_more_of_a_body_is_red(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bodies, "mesh", lambda scene, *rest: scene.bodies[0].loads)
    with pytest.raises(AttributeError, match="loads"):
        run(small_scene(), tmp_path / "out", backend="numpy")


def pictures(out: Path) -> dict[str, str]:
    return {name: what for name, what in results(out).items() if name.endswith(".png")
            and "images" in name}  # fmt: skip


def expected(seeds: int, places: int, loads: int) -> dict[str, int]:
    """Of variants with two frames; the unloaded one is the same for all loads."""
    views = places * (1 + loads)
    return {
        "mesh/crane": 1, "surface/crane": 1, "props": 1, "meshes": 1, "model/crane": loads,
        "solve": loads, "solution": loads, "motion/crane": loads, "radiance/front": views,
        "exposure/front": places, "picture/front": seeds * views,
    }  # fmt: skip


def test_variants_make_each_thing_once(tmp_path: Path, made: Counter[str]) -> None:
    scene, out = crane_variants(3, 2, 2), tmp_path / "out"
    run(scene, out, backend="numpy")
    assert {name: made[name] for name in expected(3, 2, 2)} == expected(3, 2, 2)
    made.clear()
    before = pictures(out)
    run(scene, out, backend="numpy")
    assert not made and pictures(out) == before and len(before) == 12 * 2
    for name in ("seed0-place0-load0", "seed2-place1-load1"):
        alone = tmp_path / name
        run(scene.variant(name), alone, backend="numpy")
        assert pictures(alone) == pictures(out / "variants" / name)


def test_runs_into_two_folders_share_a_store(tmp_path: Path, made: Counter[str]) -> None:
    one, two = crane(), crane(sensor={**crane().document["sensor"], "seed": 1})
    store = tmp_path / "store"
    run(one, tmp_path / "one", backend="numpy", store=store)
    first = made.copy()
    run(two, tmp_path / "two", backend="numpy", store=store)
    again = made - first
    assert again["solve"] == 0 and again["picture/front"] == 2 and again["radiance/front"] == 2
    run(one, tmp_path / "three", backend="numpy", store=store)
    assert made - first == again
    assert pictures(tmp_path / "one") == pictures(tmp_path / "three")
    assert not (tmp_path / "one" / ".gpusim" / "blobs").exists()


@pytest.mark.parametrize("how", [{"fresh": True}, {"skip": False}])
def test_options_that_make_everything_again(
    tmp_path: Path, made: Counter[str], how: dict[str, bool]
) -> None:
    run(crane(), tmp_path, backend="numpy", **how)
    before, files = made.copy(), results(tmp_path)
    run(crane(), tmp_path, backend="numpy", **how)
    assert made == before + before and results(tmp_path) == files


def test_plans_of_many_frames_are_linear() -> None:
    """Tasks, and calls of what makes keys; the benchmark has seconds."""

    def work(frames: int) -> tuple[int, int]:
        graph = decide({"": crane(frames, 2)}, None, RunOptions("numpy")).graph
        return len(graph.tasks), sum(
            len(keys) for task in graph.tasks.values() for keys in task.needs.values()
        )

    small, large = work(20), work(200)
    assert large[0] < 10.5 * small[0] and large[1] < 10.5 * small[1]


@pytest.mark.parametrize(
    "setting",
    [{"camera.front.position_mm": [350.0, -1020.0, 290.0]}, {"camera.front.focal_mm": 35.0}],
)
def test_variants_that_show_the_same_to_another_camera(
    tmp_path: Path, setting: dict[str, Any]
) -> None:
    """What the device drew last is no picture of theirs, though nothing has moved."""
    scene = crane(
        variant=[{"name": "as-it-is"}, {"name": "changed", "set": setting}],
        sensor={"exposure": 0.3},
    ).replace("analysis.load_factors", [1.0])  # fmt: skip
    run(scene, tmp_path / "both", backend="numpy")
    alone = [tmp_path / name for name in ("as-it-is", "changed")]
    for out in alone:
        run(scene.variant(out.name), out, backend="numpy")
    assert pictures(alone[0]) != pictures(alone[1])
    for out in alone:
        assert pictures(out) == pictures(tmp_path / "both" / "variants" / out.name)
