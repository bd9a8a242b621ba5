"""Several states of one scene in one run, compared; and a run that failed, told."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

from gpusim.files.output_folder import inside
from gpusim.pipeline.checks.warnings import with_known_warnings
from gpusim.pipeline.measurements.kinds import kind_of
from gpusim.pipeline.measurements.results import Result
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.runner.execution import Execution, RunFailed
from gpusim.pipeline.runner.scene_report import failure_text, read_results
from gpusim.report import Link, Report, Stage, write_report


def compare_variants(execution: Execution) -> Report:
    """Compare the variants that were made; returns the whole report, which it writes."""
    scene, decision = execution.scene, execution.decision
    comparisons: list[Result] = []
    stages = []

    def recorded(variant: str, measure: str) -> Result:
        """What a variant's run has recorded of a measure."""
        (found,) = read_results(decision, f"variants/{variant}", measure)
        return found

    for spec in scene.measures:
        compare = kind_of(spec).compare
        if compare is None:
            continue
        started = time.perf_counter()
        execution.log.tell(spec.name, 0.0, "compares the variants")
        comparison = compare(spec, scene, recorded)
        comparison.write_tables(inside(execution.out, "measure"))
        comparisons.append(comparison)
        seconds = time.perf_counter() - started
        stages.append(Stage(spec.name, "run", "compares the variants", seconds))
        execution.log.tell(spec.name, 1.0, comparison.note)
    execution.log.tell("report", 0.0, "figures and page")
    report = _report(execution, comparisons, stages)
    write_report(report, execution.out)
    execution.log.tell("report", 1.0, "report.html, report.json")
    return report


def work_off(execution: Execution) -> None:
    """Do the work; if it fails, write a report of that and raise what it failed of."""
    try:
        execution.run()
    except RunFailed as failed:
        assert isinstance(failed.__cause__, Exception)
        raise _told(execution, failed, failed.__cause__) from failed.__cause__


def _told(execution: Execution, failed: RunFailed, cause: Exception) -> Exception:
    """Write the report of a run that failed; returns the error to be raised."""
    known = [
        text
        for key in execution.decision.graph.records[failed.place].get("geometry", ())
        for record in (execution.store.find(key),) if record is not None
        for text in Notes.of(record.notes).warnings
    ]  # fmt: skip
    error = with_known_warnings(cause, known)
    report = execution.failed_report(failed, failure_text(error))
    if failed.place:
        name = failed.place.removeprefix("variants/")
        whole = _report(execution, [], [], failure=f"variant {name!r}: {failure_text(error)}")
        write_report(whole, execution.out)
    write_report(report, execution.decision.folders[failed.place].path)
    return error


def _report(
    execution: Execution,
    comparisons: Sequence[Result],
    compared: Sequence[Stage],
    failure: str = "",
) -> Report:
    scene, out = execution.scene, execution.out
    reports = {
        place.removeprefix("variants/"): execution.reports[place]
        for place in execution.decision.scenes if place in execution.reports
    }  # fmt: skip
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
