"""A graph worked off: what is made when, what is let go, and what stays if something fails."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

import pytest

from gpusim.errors import InputError
from gpusim.graph import runner
from gpusim.graph.runner import Runner, StageFailed
from gpusim.graph.stage import every, first, same
from gpusim.graph.store import Store
from tests.graph.toy_stages import ToyRun, stage


def test_results_are_those_of_their_inputs(tmp_path: Path) -> None:
    run = ToyRun(
        [stage("mesh", "value", 7), stage("solve", argument="k", needs={"mesh": first}),
         stage("motion", "value", rows=["u", "v"], needs={"solve": first}),
         stage("render", rows=["x", "y"], needs={"motion": same, "solve": first}),
         stage("both", "by_writer", needs={"render": every}),
         stage("none", "by_scratch", needs={"render": lambda record: ()})], tmp_path
    ).work()  # fmt: skip
    solved = "solve(k, mesh=['mesh(7)'])"
    frames = [f"render({row}, motion={[f'motion({u}, solve={[solved]})']}, solve={[solved]})"
              for row, u in (("x", "u"), ("y", "v"))]  # fmt: skip
    assert run.files == {
        "solve/0000.txt": solved, "render/0000.txt": frames[0], "render/0001.txt": frames[1],
        "both.txt": f"both(render={frames})", "none.txt": "none(render=[])",
    }  # fmt: skip
    assert run.whole == [""] and run.session.values == {}
    record = run.store.find(run.graph.records[""]["solve"][0])
    assert record is not None and record.notes == {"length": len(solved)}


def test_values_are_made_once_and_let_go_with_their_last_user(tmp_path: Path) -> None:
    scenes = {
        place: [
            stage("mesh", "value", on_device=False),
            stage("skin", "value", needs={"mesh": first}),
            stage("render", argument=place, rows=range(3), needs={"skin": first}, on_device=True),
        ]
        for place in ("a", "b")
    }
    run, sizes = ToyRun(scenes, tmp_path), []
    kept = Store.put

    def counted(store: Store, *arguments: Any) -> Any:
        sizes.append(len(run.session.values))
        return kept(store, *arguments)

    Store.put = counted  # type: ignore[method-assign]
    try:
        run.runner.work(run.whole.append)
    finally:
        Store.put = kept  # type: ignore[method-assign]
    assert run.counted == {"mesh": 1, "skin": 1, "render": 6} and len(sizes) == 6
    assert set(sizes) == {1} and run.session.values == {}  # the skin alone


def test_values_of_frames_go_frame_by_frame(tmp_path: Path) -> None:
    """Scenes that share them are worked off side by side."""
    held: list[int] = []
    scenes = {
        place: [
            stage("solve", on_device=True),
            stage("radiance", "value", rows=range(20), needs={"solve": first}),
            stage("render", argument=place, rows=range(20), needs={"radiance": same},
                  on_device=True),
        ]
        for place in ("a", "b", "c")
    }  # fmt: skip
    run = ToyRun(scenes, tmp_path)
    observe = run.runner.observe
    run.runner.observe = lambda *told: (held.append(len(run.session.values)), observe(*told))[1]
    run.runner.work(run.whole.append)
    assert run.counted == {"solve": 1, "radiance": 20, "render": 60}
    assert max(held) <= 1 + runner.AHEAD + 1 and run.session.values == {}


def test_scenes_that_share_nothing_come_one_after_the_other(tmp_path: Path) -> None:
    scenes = {
        place: [stage("mesh", "value", place),
                stage("render", argument=place, rows=range(3), needs={"mesh": first},
                      on_device=True)]
        for place in ("a", "b")
    }  # fmt: skip
    run = ToyRun(scenes, tmp_path).work()
    assert [name for name, _ in run.made] == ["mesh", "render", "render", "render"] * 2
    assert run.whole == ["a", "b"]


def test_a_result_is_shown_in_all_places(tmp_path: Path) -> None:
    scenes = {place: [stage("solve"), stage("noise", argument=place)] for place in ("a", "b")}
    run = ToyRun(scenes, tmp_path).work()
    assert run.counted == {"solve": 1, "noise": 2}
    assert (tmp_path / "a/solve/0000.txt").samefile(tmp_path / "b/solve/0000.txt")
    assert set(run.whole) == {"a", "b"}


@pytest.mark.parametrize("on_device", [True, False])
def test_lanes(tmp_path: Path, on_device: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """What needs the device is made by the thread that has it, all else beside it."""
    threads = set()
    made = Runner._made

    def noted(self: Runner, task: Any, inputs: Any) -> Any:
        threads.add((task.stage.name, current_thread() is main_thread()))
        return made(self, task, inputs)

    monkeypatch.setattr(Runner, "_made", noted)
    ToyRun([stage("value", "value"),
            stage("a", rows=range(5), needs={"value": first}, on_device=on_device)],
           tmp_path).work()  # fmt: skip
    assert threads == {("value", True), ("a", on_device)}


def test_what_is_beside_the_device_doesnt_stop_it(tmp_path: Path) -> None:
    run = ToyRun([stage("truth", "slow", 0.3), stage("render", rows=range(20), on_device=True)],
                 tmp_path).work()  # fmt: skip
    ended = [name for name, done, _ in run.heard if done == 1.0]
    assert run.made[0] == ("truth", 0) and ended[-1] == "truth"


def fails(run: ToyRun) -> tuple[str, Exception]:
    with pytest.raises(StageFailed) as told:
        run.work()
    assert isinstance(told.value.__cause__, Exception)
    return told.value.task.stage.name, told.value.__cause__


@pytest.mark.parametrize(
    ("work", "error"),
    [("failing", "record 3"), ("by_writer", "No space"), ("by_scratch", "after the file"),
     ("failing_value", "a value")],
)  # fmt: skip
@pytest.mark.parametrize("on_device", [True, False])
def test_what_is_finished_before_a_failure_is_kept(
    tmp_path: Path, work: str, error: str, on_device: bool
) -> None:
    def stages(fault: Any) -> Iterable[Any]:
        kind = work if fault else "kept"
        rows = range(5) if work == "failing" else (None,)
        return [
            stage("before", rows=range(4), on_device=on_device, parts={}),
            stage("bad", kind, fault, rows=rows, on_device=on_device, parts={},
                  needs={"before": every}),
            stage("user", needs={"bad": every}),
        ]  # fmt: skip

    run = ToyRun(list(stages(3 if work == "failing" else "fails")), tmp_path)
    name, cause = fails(run)
    assert name == "bad" and error in str(cause)
    assert run.whole == [] and run.runner.session.values == {}
    run.store.close()
    told = [told for told in run.store.root.rglob("*") if told.name.startswith(".new")]
    assert not told and not (run.store.root / "scratch").exists()
    for key in [*run.graph.records[""]["before"]]:
        assert Store(run.store.root).fault(key, "before") is None
    kept = 3 if work == "failing" and on_device else 0
    found = [run.store.find(key) for key in run.graph.records[""]["bad"]]
    assert sum(one is not None for one in found) >= kept
    again = ToyRun(list(stages(3 if work == "failing" else "fails")), tmp_path)
    assert fails(again)[0] == "bad"
    assert "before" not in again.counted and ("bad", 0) not in again.made[: bool(kept)]
    assert again.store.claim(run.graph.records[""]["bad"][0])  # nobody has it


@pytest.mark.parametrize("work", ["kept", "by_writer", "by_scratch"])
def test_a_failure_and_then_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, work: str
) -> None:
    stages = [stage("a", work, on_device=True), stage("b", needs={"a": first}, on_device=True)]
    with monkeypatch.context() as patch:
        patch.setattr(Store, "put", lambda *_: (_ for _ in ()).throw(OSError("no")))
        assert isinstance(fails(ToyRun(stages, tmp_path))[1], OSError)
    run = ToyRun(stages, tmp_path).work()
    assert run.counted == {"a": 1, "b": 1}
    assert run.files == ToyRun(stages, tmp_path / "new").work().files


@pytest.mark.parametrize(
    "what",
    [("__getitem__", ("a",)), ("read", ("b", "b/0000.txt")), ("read", ("c", "other.txt")),
     ("notes", ("b",)), ("path", ("b", "b/0000.txt")),
     ("open", ("b", "b/0000.txt")), ("read", ("c", "c/0001.txt"))],
)  # fmt: skip
def test_a_need_that_wasnt_named_is_an_error(tmp_path: Path, what: tuple[str, Any]) -> None:
    stages = [stage("a", "value"), stage("b"), stage("c", rows=[1, 2])]
    greedy = stage("greedy", "greedy", what, parts={}, needs={"c": first})
    name, cause = fails(ToyRun([*stages, greedy], tmp_path))
    # records of a stage that was named may have been exchanged in the log
    assert name == "greedy" and isinstance(cause, InputError if what[1][0] == "c" else KeyError)


def test_nothing_of_a_need_is_none(tmp_path: Path) -> None:
    needs = {"a": lambda record: (), "b": lambda record: ()}
    stages = [stage("a", "value"), stage("b")]
    for how, got in (("get", "None"), ("has", "False")):
        for name in ("a", "b", "unknown"):
            greedy = stage("greedy", "greedy", (how, [name]), needs=needs)
            run = ToyRun([*stages, greedy], tmp_path).work()
            record = run.store.find(run.graph.records[""]["greedy"][0])
            assert record is not None and record.notes == {"got": got}


def test_early_stages_come_first_and_are_kept_later(tmp_path: Path) -> None:
    stages = [stage("mesh", "value"), stage("slow", rows=range(3)),
              stage("check", needs={"mesh": first}, early=True),
              stage("render", needs={"mesh": first, "slow": every}, on_device=True)]  # fmt: skip
    run = ToyRun(stages, tmp_path)
    run.runner.make_early()
    assert run.made == [("mesh", 0), ("check", 0)]
    assert list(tmp_path.iterdir()) == []
    run.work()
    assert run.counted == {"mesh": 1, "check": 1, "slow": 3, "render": 1}
    assert "check/0000.txt" in run.files
    again = ToyRun(stages, tmp_path)
    again.runner.make_early()
    assert again.made == []


@pytest.mark.parametrize("bad", ["early", "value"])
def test_faults_of_early_stages_leave_no_trace(tmp_path: Path, bad: str) -> None:
    stages = [stage("mesh", "failing_value" if bad == "value" else "value", keeps=False),
              stage("check", "failing" if bad == "early" else "kept", 0, needs={"mesh": first},
                    early=bad == "early"),
              stage("render", needs={"mesh": first})]  # fmt: skip
    run = ToyRun(stages, tmp_path)
    with pytest.raises(StageFailed):
        run.runner.make_early()
    assert list(tmp_path.iterdir()) == []


def test_results_that_another_run_makes_meanwhile_are_taken(tmp_path: Path) -> None:
    def stages(seed: int) -> list[Any]:
        return [stage("solve", rows=range(3), on_device=True),
                stage("noise", argument=seed, needs={"solve": every}, on_device=True)]  # fmt: skip

    late = ToyRun(stages(1), tmp_path / "late", tmp_path / "store")
    ToyRun(stages(2), tmp_path / "quick", tmp_path / "store").work()
    late.work()
    assert late.counted == {"noise": 1}
    assert ("solve", 1.0, "made by another run") in late.heard
    assert late.files == ToyRun(stages(1), tmp_path / "alone").work().files


def test_a_result_that_another_made_and_that_was_damaged_is_made_again(tmp_path: Path) -> None:
    stages = [stage("solve", on_device=True)]
    late = ToyRun(stages, tmp_path / "late", tmp_path / "store")
    quick = ToyRun(stages, tmp_path / "quick", tmp_path / "store").work()
    (tmp_path / "quick" / "solve" / "0000.txt").write_text("edited")
    assert late.work().counted == {"solve": 1}
    assert late.files == {"solve/0000.txt": "solve()"} and quick.out != late.out


def test_work_is_put_off_while_another_is_at_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rest is done meanwhile; then it is looked for, and made if it isn't there."""
    stages = [stage("solve", on_device=True), stage("other", rows=range(3), on_device=True)]
    run = ToyRun(stages, tmp_path)
    taken, claim = run.graph.records[""]["solve"][0], run.store.claim
    until = time.monotonic() + 0.2
    monkeypatch.setattr(
        run.store, "claim",
        lambda key: (key != taken or time.monotonic() > until) and claim(key),
    )  # fmt: skip
    run.work()
    assert [name for name, _ in run.made] == 3 * ["other"] + ["solve"]
    assert time.monotonic() > until


def test_put_off_work_is_taken_up_while_something_long_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stages = [stage("solve", on_device=True), stage("long", "slow", 1.0)]
    run = ToyRun(stages, tmp_path)
    taken, claim = run.graph.records[""]["solve"][0], run.store.claim
    asked = iter([False])
    monkeypatch.setattr(run.store, "claim",
                        lambda key: (key != taken or next(asked, True)) and claim(key))  # fmt: skip
    run.work()
    assert [name for name, done, _ in run.heard if done == 1.0] == ["solve", "long"]
