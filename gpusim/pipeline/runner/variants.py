"""Several states of one scene in one run: each made like a scene of its own, then compared."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from gpusim.files.atomic_files import clean_leftovers, write_text
from gpusim.files.output_folder import delete, inside
from gpusim.pipeline.measurements.kinds import kind_of
from gpusim.pipeline.measurements.results import Result
from gpusim.pipeline.runner.run_record import failure_text, write_page
from gpusim.plan.state import StateFile, variant_folder
from gpusim.report import Link, Report, Stage, write_report
from gpusim.scene import Scene

__all__ = ["run_variants"]

Progress = Callable[[str, float, str], None]
Begin = Callable[[Scene, Path, Progress], Callable[[], Report]]
"""Does what needs the device; what it returns does the rest of a scene's run but for its page."""


def run_variants(scene: Scene, out: Path, begin: Begin, progress: Progress) -> Report:
    """Run every variant of ``scene`` by ``begin`` and compare them; returns the whole report.

    A variant's own report lies in its folder. Errors end the run as in a scene without variants,
    with a report that says which variant failed.
    """
    clean_leftovers(out)
    for name in ("report.html", "report.json"):
        delete(out, name)
    write_text(inside(out, "scene.toml"), scene.to_toml())
    reports: dict[str, Report] = {}

    def tell_failure(name: str, error: Exception) -> None:
        failure = f"variant {name!r}: {failure_text(error)}"
        failed = _report(scene, out, reports, (), (), failure=failure)
        write_report(failed, out)

    def end(rest: Callable[[], Report], folder: Path, tell: Progress) -> Report:
        report = rest()
        write_page(report, folder, tell)
        return report

    # a variant is measured and its page made while the device works on the next one
    with ThreadPoolExecutor(1, thread_name_prefix="gpusim.report") as pool:
        ends: dict[str, Future[Report]] = {}

        def collect(wait: bool) -> None:
            for name in [name for name in ends if wait or ends[name].done()]:
                try:
                    reports[name] = ends.pop(name).result()
                except Exception as error:
                    tell_failure(name, error)
                    raise

        for variant in scene.variants:

            def tell(stage: str, done: float, text: str, name: str = variant.name) -> None:
                progress(f"{name}/{stage}", done, text)

            collect(wait=False)
            folder = variant_folder(out, variant.name)
            try:
                rest = begin(scene.variant(variant.name), folder, tell)
            except Exception as error:
                collect(wait=True)
                tell_failure(variant.name, error)
                raise
            ends[variant.name] = pool.submit(end, rest, folder, tell)
        collect(wait=True)
    comparisons: list[Result] = []
    stages = []
    specs = {spec.name: spec for spec in scene.measures}

    def recorded(variant: str, measure: str) -> Result:
        """What a variant's run has recorded of a measure."""
        folder = variant_folder(out, variant)
        state, result = StateFile(folder), kind_of(specs[measure]).result
        return result.read(inside(folder, "measure"), measure, lambda path: state.read(Path(path)))

    for spec in scene.measures:
        compare = kind_of(spec).compare
        if compare is None:
            continue
        started = time.perf_counter()
        progress(spec.name, 0.0, "compares the variants")
        comparison = compare(spec, scene, recorded)
        comparison.write(inside(out, "measure"))
        comparisons.append(comparison)
        seconds = time.perf_counter() - started
        stages.append(Stage(spec.name, "run", "compares the variants", seconds))
        progress(spec.name, 1.0, comparison.note)
    report = _report(scene, out, reports, tuple(comparisons), tuple(stages))
    progress("report", 0.0, "figures and page")
    write_report(report, out)
    progress("report", 1.0, "report.html, report.json")
    return report


def _report(
    scene: Scene,
    out: Path,
    reports: dict[str, Report],
    comparisons: tuple[Result, ...],
    compared: tuple[Stage, ...],
    *,
    failure: str = "",
) -> Report:
    stages = [
        Stage(f"{name}/{stage.name}", stage.state, stage.reason, stage.seconds)
        for name, report in reports.items()
        for stage in report.stages
    ]
    told = [comparison.report(scene, out) for comparison in comparisons]
    measurements = [item for one in told for item in one.measurements]
    warnings = [text for comparison in comparisons for text in comparison.warnings]
    frames = []
    for name, report in reports.items():
        measurements += [replace(item, name=f"{name}: {item.name}") for item in report.measurements]
        warnings += [f"{name}: {text}" for text in report.warnings]
        frames += [replace(pair, caption=f"{name}: {pair.caption}") for pair in report.frames]
    links = [Link("Scene as it was run", inside(out, "scene.toml"))]
    links.append(Link("Numbers of this report", inside(out, "report.json")))
    links += [
        Link(f"Report of {name}", inside(out, "variants", name, "report.html")) for name in reports
    ]
    links += [link for one in told for link in one.links]
    adapters = [r.adapter for r in reports.values() if not r.adapter.startswith("not needed")]
    last = next(reversed(reports.values())) if reports else None
    return Report(
        scene=scene.name,
        adapter="; ".join(dict.fromkeys(adapters)) or "not needed",
        status="failed" if failure else "done",
        stages=(*stages, *compared),
        solution=last.solution if last else None,
        measurements=tuple(measurements),
        warnings=tuple(warnings),
        description=scene.description,
        failure=failure,
        facts=last.facts if last else {},
        scene_text=scene.to_toml(),
        frames=tuple(frames[:1] + frames[-1:] if len(frames) > 1 else frames),
        tolerance=scene.solver.tolerance,
        series=tuple(item for one in told for item in one.series),
        figures=tuple(item for one in told for item in one.figures),
        links=tuple(links),
    )
