"""What runs of many frames and many variants cost, and what they guarantee.

``python -m benchmarks.run_graph [plan] [books] [share] [kill] [two]``

``plan``: decisions for 10,000 frames; ``books``: what the runner and the store take for frames that
cost nothing; ``share``: 200 variants, and what was made for them; ``kill``: a run killed at random
moments and taken up; ``two``: two processes and one store, of which one is killed.
"""

from __future__ import annotations

import hashlib
import os
import random
import resource
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from gpusim.graph.folder import INNER, Folder
from gpusim.graph.graph import Graph, Task
from gpusim.graph.log import Log, read_log
from gpusim.graph.runner import Inputs, Runner
from gpusim.graph.session import Session
from gpusim.graph.stage import Stage, StageResult
from gpusim.graph.store import Store
from gpusim.plan.decision import decide, states_of
from gpusim.plan.plan import make_plan
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from tests.support.small_crane import crane, crane_variants

FRAMES = 10_000
KILLS = 20
OPTIONS = RunOptions("numpy")


def plan() -> None:
    """Decisions, without any work."""
    for frames in (100, 1000, FRAMES):
        scene = crane(frames, 2)
        wall, processor = time.perf_counter(), time.process_time()
        count = len(make_plan(scene, None, "numpy").stages)
        spent = time.process_time() - processor
        print(f"plan of {frames} frames, 2 cameras: {time.perf_counter() - wall:.2f} s, "
              f"{spent:.2f} s of processor, {count} stages")  # fmt: skip
    scenes = states_of(crane_variants(10, 4, 5))
    wall = time.perf_counter()
    tasks = decide(scenes, None, OPTIONS).graph.tasks
    kinds = dict(Counter(task.stage.name for task in tasks.values()))
    print(f"plan of {len(scenes)} variants: {time.perf_counter() - wall:.2f} s; {kinds}")


_pixels = b""
_moments: list[tuple[float, float]] = []


def small_frame(argument: None, inputs: Inputs, session: Session) -> StageResult:
    """A picture of 64 x 48 px that costs nothing."""
    _moments.append((time.perf_counter(), time.process_time()))
    k = inputs.record
    return StageResult({f"images/a/{k:04d}.png": _pixels[8 * k : 8 * k + 3072]}, {"warnings": []})


def books() -> None:
    """Milliseconds a frame, at the beginning and at the end."""
    global _pixels
    _pixels = random.Random(1).randbytes(8 * FRAMES + 3072)
    stage = Stage("render/a", f"{__name__}:small_frame", keeps=True, on_device=True,
                  rows=range(FRAMES), public=lambda k: f"render/a/{k:04d}")  # fmt: skip

    def decided(out: Path) -> Runner:
        graph, store = Graph(), Store(out / INNER)
        graph.add([stage])
        folders = {"": Folder(out)}
        graph.decide(store, folders)
        return Runner(graph, store, folders, Session(OPTIONS), lambda *_: None)

    with TemporaryDirectory() as name:
        runner, memory = decided(Path(name)), []
        runner.observe = lambda task, done, words: (
            memory.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10)
            if task.record in (500, FRAMES - 1) and done == 0.0 else None
        )  # fmt: skip
        runner.work(lambda place: None)
        for begin, end in ((0, 500), (500, 1500), (FRAMES - 1000, FRAMES - 1)):
            wall, processor = (
                1e3 * (_moments[end][k] - _moments[begin][k]) / (end - begin) for k in (0, 1)
            )
            print(
                f"frames {begin} to {end}: {wall:.2f} ms, {processor:.2f} ms of processor a frame"
            )
        start = time.perf_counter()
        runner.folders[""].close()
        runner.store.close()
        closed = time.perf_counter()
        again = decided(Path(name))
        decided_s = time.perf_counter() - closed
        left = len(again.graph.order())
        print(f"close {closed - start:.2f} s; decided again {decided_s:.2f} s, {left} to be made; "
              f"MiB at 500 and the last: {memory}")  # fmt: skip


def made_in(
    scenes: dict[str, Scene], out: Path, store: Path, begun: Log | None = None
) -> Counter[str]:
    """Run scenes into folders below ``out``; what was made, by stage."""
    decision = decide(scenes, out, OPTIONS, store)
    count = Counter[str]()

    def observe(task: Task, done: float, words: str) -> None:
        if done == 0.0 and not words:
            count[task.stage.name] += 1
            if begun is not None and task.stage.keeps:
                begun.append({"key": task.key})

    assert decision.store is not None
    decision.store.clean()
    for place, folder in decision.folders.items():
        for key in decision.graph.kept(place):
            record = decision.store.find(key)
            if record is not None and not decision.graph.tasks[key].runs:
                folder.show(record, decision.store)
    session = Session(OPTIONS)
    Runner(decision.graph, decision.store, decision.folders, session, observe).work(
        lambda place: None
    )
    assert not session.values
    for folder in decision.folders.values():
        folder.close()
    decision.store.close()
    return count


def share() -> None:
    """200 variants."""
    scenes = states_of(crane_variants(10, 4, 5))
    with TemporaryDirectory() as name:
        for words in ("first", "again"):
            start = time.perf_counter()
            made = dict(made_in(scenes, Path(name), Path(name, "store")))
            print(f"{len(scenes)} variants, {words}: {time.perf_counter() - start:.1f} s, {made}")


def tree(out: Path) -> dict[str, str]:
    """Hashes of the public files."""
    return {
        str(path.relative_to(out)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in out.rglob("*")
        if path.is_file() and not {INNER, "store"} & set(path.relative_to(out).parts)
        and path.suffix != ".log"
    }  # fmt: skip


def begun_in(out: Path) -> Counter[str]:
    """Results that were begun, by all processes."""
    logs = out.glob("begun-*.log")
    return Counter(line["key"] for path in logs for line in read_log(path)[0])


def child(out: Path, which: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "benchmarks.run_graph", "child", str(out), which]
    )


def work(out: str, which: str) -> None:
    """What a `child` does: it says which result it begins."""
    scenes = {"a": crane(12)} if which == "a" else states_of(crane_variants(2, 2, 2))
    if which == "backwards":
        scenes = dict(reversed(scenes.items()))
    made_in(scenes, Path(out), Path(out, "store"), Log(Path(out, f"begun-{os.getpid()}.log")))


def kill() -> None:
    """At random moments of the work."""
    chance, done, rounds = random.Random(7), 0, []
    with TemporaryDirectory() as name:
        made_in({"a": crane(12)}, Path(name, "whole"), Path(name, "whole", "store"))
        expected = tree(Path(name, "whole"))
        while done < KILLS:
            out, twice, code = Path(name, str(done)), 0, 1
            while code:
                recorded, before = set(Store(out / "store")._records), begun_in(out)
                process = child(out, "a")
                while process.poll() is None and begun_in(out) == before:
                    time.sleep(0.005)
                try:
                    code = process.wait(chance.uniform(0.0, 1.5) if done < KILLS else 300)
                except subprocess.TimeoutExpired:
                    process.send_signal(signal.SIGKILL)
                    code, done = process.wait(), done + 1
                twice += sum(key in recorded for key in begun_in(out) - before)
            rounds.append((tree(out) == expected, twice))
    same = all(same for same, _ in rounds)
    print(f"killed {done} times in {len(rounds)} runs: same bytes {same}, "
          f"recorded and made again {sum(twice for _, twice in rounds)}")  # fmt: skip


def two() -> None:
    """At once, the same variants in opposite orders."""
    with TemporaryDirectory() as name:
        made_in(states_of(crane_variants(2, 2, 2)), Path(name, "whole"), Path(name, "w-store"))
        expected = tree(Path(name, "whole"))
        for fatal in (False, True):
            out, start = Path(name, str(fatal)), time.perf_counter()
            pair = [child(out, "forwards"), child(out, "backwards")]
            if fatal:
                while len(begun_in(out)) < 10:
                    time.sleep(0.01)
                pair[0].kill()
            codes: list[Any] = [process.wait() for process in pair]
            begun = begun_in(out)
            print(f"two processes: {time.perf_counter() - start:.1f} s, codes {codes}, results "
                  f"{len(begun)}, begun twice {begun.total() - len(begun)}, same bytes "
                  f"{tree(out) == expected}")  # fmt: skip


if __name__ == "__main__":
    if sys.argv[1:2] == ["child"]:
        work(*sys.argv[2:])
    else:
        for name in sys.argv[1:] or ("plan", "books", "share", "kill", "two"):
            {"plan": plan, "books": books, "share": share, "kill": kill, "two": two}[name]()
