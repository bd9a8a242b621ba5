"""Stages that need no scene, and runs of them that say what was made."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gpusim.graph.folder import INNER, Folder
from gpusim.graph.graph import Graph, Task
from gpusim.graph.runner import Inputs, Runner
from gpusim.graph.session import Session
from gpusim.graph.stage import Stage, StageResult, digest, every, same
from gpusim.graph.store import Store

__all__ = ["FRAMES", "ToyRun", "framed", "run_frames", "stage"]

FRAMES = 30

Scenes = Mapping[str, Sequence[Stage]]


def stage(name: str, work: str = "kept", argument: Any = None, **more: Any) -> Stage:
    """A toy stage; what it ``keeps`` is told by its ``work``."""
    more = {"keeps": work != "value", "parts": {"toy": digest(argument)}} | more
    return Stage(name, f"{__name__}:{work}", (name, argument), **more)


def _text(argument: Any, inputs: Inputs) -> str:
    """All that a record can know, as a text."""
    values = [f"{name}={all_of}" for name, all_of in inputs._values.items()]
    results = [
        f"{name}={[inputs.read(name, file).data.decode() for one in records for file in one.files]}"
        for name, records in inputs._records.items()
    ]
    name, given = argument
    return f"{name}({', '.join([*map(str, filter(None, (given, inputs.row))), *values, *results])})"


def value(argument: Any, inputs: Inputs, session: Session) -> str:
    return _text(argument, inputs)


def kept(argument: Any, inputs: Inputs, session: Session) -> StageResult:
    name, _ = argument
    text = _text(argument, inputs)
    return StageResult(
        {f"{name}/{inputs.record:04d}.txt": text.encode()}, {"length": len(text)}, name
    )


def by_writer(argument: Any, inputs: Inputs, session: Session) -> StageResult:
    """The file is made while it is written, by another thread."""
    name, given = argument

    def write(path: Path) -> None:
        assert path.suffix == ".txt"
        path.write_text("half of it")
        if given == "fails":
            raise OSError(28, "No space left on device", str(path))
        path.write_text(_text(argument, inputs))

    return StageResult({f"{name}.txt": write})


def by_scratch(argument: Any, inputs: Inputs, session: Session) -> StageResult:
    name, given = argument
    path = inputs.new_file("made")
    path.write_text(_text(argument, inputs))
    if given == "fails":
        raise ValueError("after the file")
    return StageResult({f"{name}.txt": path})


def failing(argument: Any, inputs: Inputs, session: Session) -> Any:
    _, which = argument
    if inputs.record == which:
        raise ValueError(f"record {which}")
    return kept(argument, inputs, session)


def failing_value(argument: Any, inputs: Inputs, session: Session) -> Any:
    raise ValueError("a value")


def greedy(argument: Any, inputs: Inputs, session: Session) -> StageResult:
    """Reads what it didn't name."""
    _, (how, name) = argument
    return StageResult(notes={"got": repr(getattr(inputs, how)(*name))})


def slow(argument: Any, inputs: Inputs, session: Session) -> StageResult:
    name, seconds = argument
    time.sleep(seconds)
    text = f"{name} {inputs.record}"
    return StageResult({f"{name}/{inputs.record:04d}.txt": text.encode()}, {"maker": os.getpid()})


class ToyRun:
    """A run of stages by place into ``out``; ``made``: (stage, record) begun, in their order;
    ``heard``: all that was told; ``whole``: places, as they became whole."""

    def __init__(
        self, scenes: Scenes | Sequence[Stage], out: Path, store: Path | None = None, **how: Any
    ) -> None:
        self.scenes = scenes if isinstance(scenes, Mapping) else {"": scenes}
        self.graph, self.out = Graph(), out
        for place, stages in self.scenes.items():
            self.graph.add(stages, place)
        self.store = Store(store or out / INNER)
        self.folders = {place: Folder(out / place) for place in self.scenes}
        self.graph.decide(self.store, self.folders, **how)
        self.session = Session(None)
        self.made: list[tuple[str, int]] = []
        self.heard: list[tuple[str, float, str]] = []
        self.whole: list[str] = []
        self.runner = Runner(self.graph, self.store, self.folders, self.session, self._observe)

    def _observe(self, task: Task, done: float, words: str) -> None:
        self.heard.append((task.stage.name, done, words))
        if done == 0.0:
            self.made.append((task.stage.name, task.record))

    def work(self) -> ToyRun:
        """Do it; what fails leaves all in order."""
        try:
            for place, folder in self.folders.items():
                for key in self.graph.kept(place):
                    record = self.store.find(key)
                    if record is not None and not self.graph.tasks[key].runs:
                        folder.show(record, self.store)
            self.runner.work(self.whole.append)
            for place, folder in self.folders.items():
                folder.retire(self.graph.current(place, self.store))
                folder.depends(self.graph.parts[place])
        finally:
            self.session.values.clear()
            for folder in self.folders.values():
                folder.close()
            self.store.close()
        return self

    @property
    def counted(self) -> Counter[str]:
        """How many records were made, by stage."""
        return Counter(name for name, _ in self.made)

    @property
    def states(self) -> dict[str, list[tuple[str, str]]]:
        """State and reason of every task, by stage."""
        told: dict[str, list[tuple[str, str]]] = {}
        for task in self.graph.tasks.values():
            told.setdefault(task.stage.name, []).append((task.state, task.reason))
        return told

    @property
    def files(self) -> dict[str, str]:
        """The public files."""
        return {
            path.relative_to(self.out).as_posix(): path.read_text()
            for path in sorted(self.out.rglob("*"))
            if path.is_file() and INNER not in path.parts
        }


def framed(seed: int, seconds: float = 0.01) -> list[Stage]:
    """Of which two with different seeds share all but the last stage."""
    return [
        stage("solve", "slow", 3 * seconds, on_device=True),
        stage("radiance", "slow", seconds, rows=range(FRAMES), on_device=True,
              needs={"solve": every}),
        stage("truth", "slow", seconds, rows=range(5)),
        stage("picture", argument=seed, rows=range(FRAMES), needs={"radiance": same}),
    ]  # fmt: skip


def run_frames(seed: int, out: Path, store: Path) -> None:
    """What another process does. It imports the module that this is in, and one of tests would
    bring pytest along."""
    ToyRun(framed(seed), out, store).work()
