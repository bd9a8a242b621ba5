"""Keys of tasks, and what is to be done with each and why."""

from __future__ import annotations

from pathlib import Path

import pytest

from gpusim.graph.graph import Graph
from gpusim.graph.stage import Stage, every, first, same
from tests.graph.toy_stages import ToyRun, stage


def keys(*stages: Stage) -> dict[str, list[str]]:
    graph = Graph()
    graph.add(stages, "")
    return graph.records[""]


def test_a_key_is_of_what_is_named_and_of_nothing_else(monkeypatch: pytest.MonkeyPatch) -> None:
    (before,) = keys(stage("a", argument=1))["a"]
    changed = {
        "name": stage("b", argument=1),
        "function": stage("a", "by_scratch", argument=1),
        "part": stage("a", argument=2),
        "part's name": stage("a", parts={"other": stage("a", argument=1).parts["toy"]}),
        "row": stage("a", argument=1, rows=[0]),
    }
    others = {what: next(iter(keys(one).values()))[0] for what, one in changed.items()}
    assert len({before, *others.values()}) == 1 + len(others)
    how = dict(public=lambda record: "x", on_device=True, early=True, keeps=False)
    assert keys(stage("a", argument=1, **how))["a"] == [before]
    monkeypatch.setattr("gpusim.graph.graph.__version__", "0.0.0")
    assert keys(stage("a", argument=1))["a"] != [before]


def test_rows_that_are_equal_are_one_record() -> None:
    one, two, three = keys(stage("a", rows=[[0.5, "x"], [0.25, "x"], [0.5, "x"]]))["a"]
    assert one == three != two
    graph = Graph()
    graph.add([stage("a", rows=[7, 8, 7])], "")
    assert [task.places for task in graph.tasks.values()] == [[("", 0), ("", 2)], [("", 1)]]


def test_keys_hold_those_of_the_records_that_are_needed() -> None:
    def of(rows: list[int], which: object) -> list[str]:
        a = stage("a", "value", rows=rows)
        return keys(a, stage("b", rows=[0, 1], needs={"a": which}))["b"]  # type: ignore[dict-item]

    assert of([1, 2], same)[0] == of([1, 3], same)[0] and of([1, 2], same)[1] != of([1, 3], same)[1]
    assert of([1, 2], first) == of([1, 3], first) != of([2, 2], first)
    assert set(of([1, 2], every)).isdisjoint(of([1, 3], every))
    assert of([1, 2], every) != of([2, 1], every)
    assert of([1, 2], lambda record: (1, 0)) != of([1, 2], lambda record: (0, 1))
    assert of([1, 2], lambda record: ()) == of([3, 4], lambda record: ())


def test_equal_keys_of_two_scenes_are_one_task() -> None:
    def scene(load: int, seed: int) -> list[Stage]:
        return [
            stage("mesh", "value"),
            stage("solve", argument=load, needs={"mesh": first}),
            stage("noise", argument=seed, needs={"solve": first}),
        ]

    graph = Graph()
    for place, (load, seed) in {"a": (1, 1), "b": (1, 2), "c": (2, 2)}.items():
        graph.add(scene(load, seed), place)
    count = [task.stage.name for task in graph.tasks.values()]
    assert [count.count(name) for name in ("mesh", "solve", "noise")] == [1, 2, 3]
    assert graph.tasks[graph.records["b"]["solve"][0]].places == [("a", 0), ("b", 0)]


def crane(camera: int = 1, load: int = 1, shown: tuple[float, ...] = (0, 1)) -> list[Stage]:
    """Named as a scene's are: values between results."""
    return [
        stage("mesh", "value", parts={"body.bar.mesh": "m"}),
        stage("solve", needs={"mesh": first}, parts={"body.bar.solid": f"{load}"},
              public=lambda record: "solve"),
        stage("motion", "value", needs={"solve": first}),
        stage("radiance", "value", needs={"motion": first}, rows=shown,
              parts={"camera.front": f"{camera}", "light": "l"},
              public=lambda record: f"render/{record}"),
        stage("render", needs={"radiance": same}, rows=range(len(shown)),
              public=lambda record: f"render/{record}"),
        stage("note", needs={"mesh": first}),
    ]  # fmt: skip


def test_a_first_run_says_that_nothing_is_there(tmp_path: Path) -> None:
    states = ToyRun(crane(), tmp_path).states
    assert states["solve"] == [("run", "not made yet")]
    assert states["render"] == 2 * [("run", "not made yet")]
    assert states["radiance"] == 2 * [("run", "needed by render")]
    assert states["motion"] == [("run", "needed by render")]
    assert states["mesh"] == [("run", "needed by solve")]


def test_a_second_run_makes_nothing(tmp_path: Path) -> None:
    run = ToyRun(crane(), tmp_path).work()
    again = ToyRun(crane(), tmp_path)
    assert again.graph.order() == []
    for name in ("solve", "render", "note"):
        assert set(again.states[name]) == {("reused", "unchanged")}
    assert again.states["mesh"] == [("skipped", "nothing that runs needs it")]
    again.work()
    assert again.made == [] and again.files == run.files and again.whole == [""]


@pytest.mark.parametrize(
    ("change", "made", "reason"),
    [
        ({"camera": 2}, {"render": 2, "radiance": 2, "motion": 1}, "camera.front changed"),
        ({"load": 2}, {"solve": 1, "mesh": 1, "render": 2, "radiance": 2, "motion": 1},
         "body.bar.solid changed"),
        ({"camera": 2, "load": 2}, {"solve": 1, "mesh": 1, "render": 2, "radiance": 2, "motion": 1},
         "body.bar.solid, camera.front changed"),
        ({"shown": (0, 2)}, {"render": 1, "radiance": 1, "motion": 1},
         "loads or places of frames changed"),
    ],
)  # fmt: skip
def test_what_changed_is_named_through_all_needs(
    tmp_path: Path, change: dict[str, int], made: dict[str, int], reason: str
) -> None:
    ToyRun(crane(), tmp_path).work()
    changed = ToyRun(crane(**change), tmp_path)  # type: ignore[arg-type]
    assert changed.states["render"][1] == ("run", reason)
    assert changed.work().counted == made
    assert changed.files == ToyRun(crane(**change), tmp_path / "new").work().files  # type: ignore[arg-type]


def test_frames_that_are_added_or_taken_away(tmp_path: Path) -> None:
    ToyRun(crane(), tmp_path).work()
    more = ToyRun(crane(shown=(0, 1, 2)), tmp_path)
    assert [state for state, _ in more.states["render"]] == ["reused", "reused", "run"]
    more.work()
    fewer = ToyRun(crane(shown=(0,)), tmp_path)
    assert fewer.graph.order() == []
    assert "render/0001.txt" not in fewer.work().files and "render/0000.txt" in fewer.files


def test_a_file_that_is_gone_or_changed_is_the_reason(tmp_path: Path) -> None:
    run = ToyRun(crane(), tmp_path).work()
    (tmp_path / "render" / "0001.txt").write_text("edited: the store's file is the same one")
    again = ToyRun(crane(), tmp_path)
    assert again.states["render"] == [("reused", "unchanged"),
                                      ("run", "render/0001.txt was changed")]  # fmt: skip
    assert again.states["mesh"][0][0] == "skipped"  # the solution is there
    assert again.work().files == run.files
    (key,) = again.graph.records[""]["solve"]
    record = again.store.find(key)
    assert record is not None
    again.store.blob(record.files["solve/0000.txt"].sha256).unlink()
    third = ToyRun(crane(), tmp_path)
    assert third.states["solve"] == [("run", "solve/0000.txt is gone")]
    assert third.work().files == run.files


def test_options_that_reuse_nothing(tmp_path: Path) -> None:
    run = ToyRun(crane(), tmp_path).work()
    fresh = ToyRun(crane(), tmp_path, no_reuse="--fresh")
    assert fresh.states["render"] == 2 * [("run", "--fresh")]
    assert fresh.work().counted == run.counted and fresh.files == run.files


def test_targets_and_what_they_need(tmp_path: Path) -> None:
    run = ToyRun(crane(), tmp_path, targets=["solve"])
    assert run.states["render"] == 2 * [("skipped", "not asked for")]
    assert run.work().counted == {"mesh": 1, "solve": 1}


def test_values_that_only_the_report_needs_say_so(tmp_path: Path) -> None:
    told = ToyRun([stage("mesh", "value"), stage("note", needs={"mesh": first})], tmp_path).states
    assert told["mesh"] == [("run", "needed by the report")]
