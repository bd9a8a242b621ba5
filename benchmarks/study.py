"""What studies add to the work of their samples: ``python -m benchmarks.study [parts] [share]
[many] [--write]``.

``parts``: milliseconds of a processor that a sample takes beside its work. Its stages give back
what they gave for the first sample, so that all that is left is the study's own: the scene, its
keys, the graph, the store, the row. ``share``: 200 samples by two workers, and by two processes
that each make half of them and know of no scheduler, in turns. ``many``: 10,000 samples are
planned, and made for at most ``--minutes``, while somebody looks at the memory of client and
workers. A bar under a load, in pictures of 64 x 48 px; the deflection of two markers is measured,
but in the many, which are pairs of pictures alone, as for a data set.
"""

from __future__ import annotations

import argparse
import resource
import signal
import statistics
import subprocess
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

from gpusim.graph.graph import Graph
from gpusim.graph.stage import Stage, StageResult
from gpusim.graph.store import Store
from gpusim.studies import Sample, Study, batch, load_study, samples_of, study_plan
from gpusim.studies.executors import MOST_TOGETHER
from gpusim.studies.plan import check_samples
from gpusim.studies.rows import RowReader
from tests.hostile.tiny_runs import write_scene

RESULTS = Path(__file__).parent / "results" / "study.md"
YOUNG = "material.0.youngs_modulus_GPa"
STEP_S = 2.0
PAGE = resource.getpagesize()
SMALLER = {
    "[96, 48]": "[64, 48]", "[6.4, 3.2]": "[4.2, 3.15]", "[12.0, 0.0, 5.0]": "[17.0, 0.0, 5.0]",
    "[48.0, 0.0, 5.0]": "[43.0, 0.0, 5.0]", 'truth = ["depth"]': "fields = false",
}  # fmt: skip
Rows = list[tuple[str, str]]


def write_study(folder: Path, cameras: int, repeats: int, measured: bool = True) -> Path:
    """Ten structures before so many cameras, each with so many draws of noise."""
    folder.mkdir(parents=True, exist_ok=True)
    scene = write_scene(folder)
    text = scene.read_text()
    for old, new in SMALLER.items():
        assert old in text, old
        text = text.replace(old, new)
    if not measured:
        text = text[: text.index("[[measure]]")]
    scene.write_text(f'{text}\n[sensor]\npreset = "stereo-dic-5mp"\n')
    path = folder / "study.toml"
    path.write_text(f"""scene = "bar.toml"
backend = "numpy"
samples = {cameras}
repeats = {repeats}
[[parameter]]
key = "camera.side.focal_mm"
uniform = [28.0, 32.0]
[[parameter]]
key = "{YOUNG}"
list = {[60.0 + 2.0 * k for k in range(10)]}
""")
    return path


def by_structure(study: Study) -> list[Sample]:
    return sorted(samples_of(study), key=lambda sample: float(sample.overrides[YOUNG]))


def batches(samples: Sequence[Sample]) -> Iterator[Sequence[Sample]]:
    for start in range(0, len(samples), MOST_TOGETHER):
        yield samples[start : start + MOST_TOGETHER]


def parts(folder: Path) -> Rows:
    """Of 1,280 samples, in batches; the first batch warms up."""
    study = batch.bare(load_study(write_study(folder, 64, 2)))
    samples, given = by_structure(study), dict[tuple[str, int], tuple[Any, Any]]()
    function, count = Stage.function, Counter[str]()

    def recorded(stage: Stage) -> Callable[..., Any]:
        """What a stage gives, files as bytes."""

        def call(argument: Any, inputs: Any, session: Any) -> Any:
            made = function(stage)(argument, inputs, session)
            if isinstance(made, StageResult):
                files = {name: content(name, one) for name, one in made.files.items()}
                made = replace(made, files=files)
            given[stage.name, inputs.record] = made, session.results.get(inputs.key)
            return made

        return call

    def content(name: str, output: Any) -> bytes:
        if callable(output):
            path = folder / Path(name).name
            output(path)
            output = path.read_bytes()
        return bytes(output)

    def repeated(stage: Stage) -> Callable[..., Any]:
        """The same again, in files that the store doesn't have."""

        def call(argument: Any, inputs: Any, session: Any) -> Any:
            made: Any
            made, result = given[stage.name, inputs.record]
            if result is not None:
                session.results[inputs.key] = result
            if stage.keeps:
                count["files"] += len(made.files)
                tag = b"%d" % count["files"]
                made = replace(made, files={name: one + tag for name, one in made.files.items()})
            return made

        return call

    with patch.object(Stage, "function", recorded):
        worker = batch.Worker(folder / "first", "numpy")
        assert worker.work_off(study, samples[:1]) == {samples[0].number: "done"}
        worker.close()
    spent: dict[str, float] = defaultdict(float)

    def timed(owner: Any, name: str, label: str) -> Any:
        work = getattr(owner, name)

        def call(*args: Any, **options: Any) -> Any:
            start = time.thread_time()
            try:
                return work(*args, **options)
            finally:
                spent[label] += time.thread_time() - start

        return patch.object(owner, name, call)

    each: list[float] = []
    with ExitStack() as stack:
        stack.enter_context(patch.object(Stage, "function", repeated))
        for owner, name, label in (
            (Sample, "scene", "scene"), (batch, "scene_stages", "stages and their keys"),
            (Graph, "add", "graph"), (Graph, "decide", "graph"), (Store, "put", "store: files"),
            (Store, "refresh", "store: others' results"), (batch._Batch, "_end", "row"),
        ):  # fmt: skip
            stack.enter_context(timed(owner, name, label))
        worker = batch.Worker(folder / "again", "numpy")
        first, *others = batches(samples)
        worker.work_off(study, first)
        spent.clear()
        count.clear()
        for some in others:
            start = time.process_time()
            assert set(worker.work_off(study, some).values()) == {"done"}
            each.append(1e3 * (time.process_time() - start) / len(some))
        worker.close()
    number = len(samples) - len(first)
    told = [(label, f"{1e3 * seconds / number:.2f} ms") for label, seconds in spent.items()]
    rest = statistics.fmean(each) - 1e3 * sum(spent.values()) / number
    return [
        *told, ("threads, order of work, and the rest", f"{rest:.2f} ms"),
        ("**all, mean of the batches**", f"**{statistics.fmean(each):.2f} ms**"),
        ("quickest, median batch", f"{min(each):.2f}, {statistics.median(each):.2f} ms"),
        ("files a sample", f"{count['files'] / number:.2f}"),
    ]  # fmt: skip


def half(path: Path, out: Path, which: int) -> None:
    """What one of two processes makes that know of no scheduler."""
    study = batch.bare(load_study(path))
    samples = by_structure(study)
    worker = batch.Worker(out, study.backend)
    middle = len(samples) // 2
    for some in batches(samples[middle:] if which else samples[:middle]):
        worker.work_off(study, some)
    worker.close()


def started(*words: Any) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", *map(str, words)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def timed_processes(commands: Sequence[Sequence[Any]]) -> tuple[float, float]:
    """Wall and processor seconds of some side by side, which all end well."""
    wall, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_CHILDREN)
    assert not any([one.wait() for one in [started(*words) for words in commands]])
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - wall, processor


def made_in(out: Path) -> Counter[str]:
    """Results by stage, and rows, of a study."""
    rows = [row for row in RowReader(out).new() if "made" in row]
    made = sum((Counter(row["made"]) for row in rows), Counter[str]())
    return made | Counter(rows=len(rows))


def share(folder: Path, rounds: int) -> Rows:
    """Interleaved; processor time is that of all processes."""
    path = write_study(folder, 10, 2)
    seconds: dict[str, list[tuple[float, float]]] = {"two workers": [], "two halves": []}
    made = Counter[str]()
    for k in range(rounds):
        out = folder / f"study{k}"
        for name, commands in (
            ("two workers", [("gpusim", "study", path, "-o", out, "--workers", 2)]),
            ("two halves", [("benchmarks.study", "half", path, folder / f"half{k}-{which}", which)
                            for which in (0, 1)]),
        ):  # fmt: skip
            seconds[name].append(timed_processes(commands))
        made = made_in(out)
    again = timed_processes([("gpusim", "study", path, "-o", out, "--workers", 2)])
    new = made_in(out) - made
    told = []
    for name, pairs in seconds.items():
        walls, processors = zip(*pairs, strict=True)
        words = f"{statistics.median(walls):.1f} s, {statistics.median(processors):.1f} s"
        told.append((f"{name}: wall, processor time (median of {rounds})", words))
    ratios = [
        statistics.median(one[k] / (other[k] - report * again[k]) for one, other in zip(
            seconds["two halves"], seconds["two workers"], strict=True))
        for report in (0, 1) for k in (0, 1)
    ]  # fmt: skip
    counts = ", ".join(f"{count} {name}" for name, count in made.items())
    return [
        *told, ("**throughput beside two halves: wall, processor time**",
                f"**{ratios[2]:.2f}, {ratios[3]:.2f}**; with plan, table and report, which halves "
                f"don't make: {ratios[0]:.2f}, {ratios[1]:.2f}"),
        ("made", counts),
        ("made by a second call, in", f"{new.total()}, {again[0]:.1f} s, {again[1]:.1f} s"),
    ]  # fmt: skip


def resident(process: int) -> int:
    """Bytes in memory; 0 of a process that has ended."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * PAGE
    except OSError:
        return 0


def workers_of(process: int) -> list[int]:
    """Python processes below, those of no consequence (resource trackers) left out."""
    lists = Path(f"/proc/{process}/task").glob("*/children")
    below = [int(one) for path in lists for one in path.read_text().split()]
    return [one for one in below if resident(one) > 100e6]


def many(folder: Path, minutes: float) -> Rows:
    """Planned here, made by ``gpusim study --workers 2``."""
    path, out = write_study(folder, 100, 10, measured=False), folder / "many"
    start, study = time.process_time(), load_study(path)
    samples = samples_of(study)
    check_samples(study, samples)
    plan = study_plan(study, samples)
    planned = time.process_time() - start
    whole = started("gpusim", "study", path, "-o", out, "--workers", 2)
    reader, done, memory = RowReader(out), 0, list[tuple[int, int, int]]()
    start = time.perf_counter()
    while whole.poll() is None and time.perf_counter() - start < 60.0 * minutes:
        time.sleep(STEP_S)
        done += sum("made" in row for row in reader.new())
        below = [resident(one) for one in workers_of(whole.pid)]
        if done and below and done < len(samples):
            memory.append((done, resident(whole.pid), max(below)))
    wall = time.perf_counter() - start
    made = made_in(out)
    whole.send_signal(signal.SIGINT)
    whole.wait()
    places = [next(k for k, (count, *_) in enumerate(memory) if count >= part * memory[-1][0])
              for part in (0.1, 0.5, 1.0)]  # fmt: skip
    told = [", ".join(f"{1e-6 * memory[k][which]:.0f}" for k in places) + " MB" for which in (1, 2)]
    return [
        (f"{plan.samples:,} samples planned", f"{planned:.1f} s of a processor"),
        ("seconds forecast, on one worker", f"{plan.seconds:.0f} s"),
        ("**samples made**", f"**{made['rows']} in {wall:.0f} s of wall** (2 workers)"),
        ("made", ", ".join(f"{count} {name}" for name, count in made.items())),
        ("client at 10, 50, 100 % of them", told[0]),
        ("larger worker at 10, 50, 100 %", told[1]),
        ("store", f"{1e-6 * sum(one.stat().st_size for one in out.rglob('*') if one.is_file()):.0f}"
                  " MB of content"),
    ]  # fmt: skip


def main() -> None:
    if sys.argv[1:2] == ["half"]:
        half(Path(sys.argv[2]), Path(sys.argv[3]), int(sys.argv[4]))
        return
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", default=["parts", "share", "many"])
    parser.add_argument("--write", action="store_true", help=f"into {RESULTS.name}")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--minutes", type=float, default=6.0)
    options = parser.parse_args()
    titles = {
        "parts": "A sample, beside its work", "share": "200 samples, 10 structures",
        "many": "10,000 samples",
    }  # fmt: skip
    text = "# What studies add\n\nPictures of 64 x 48 px; `python -m benchmarks.study`.\n"
    with TemporaryDirectory() as scratch:
        for part in options.parts:
            folder = Path(scratch, part)
            if part == "parts":
                rows = parts(folder)
            elif part == "share":
                rows = share(folder, options.rounds)
            else:
                rows = many(folder, options.minutes)
            text += f"\n## {titles[part]}\n\n| | |\n|---|---|\n"
            text += "".join(f"| {name} | {value} |\n" for name, value in rows)
    print(text)
    if options.write:
        RESULTS.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
