"""Several states of one scene in one run: each made like a scene of its own, then compared."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from gpusim.errors import GpusimError
from gpusim.files.atomic_files import clean_leftovers, write_text
from gpusim.files.output_folder import delete, inside
from gpusim.pipeline.measurements.damage import DamageLine, DamageResult, compare_states
from gpusim.pipeline.measurements.deflection import DeflectionResult
from gpusim.pipeline.runner.run_report import write_page
from gpusim.plan.state import StateFile, variant_folder
from gpusim.report import Drawing, Link, Measurement, Report, Stage, write_report
from gpusim.report.damage_figures import StateCurve, draw_deflections, draw_differences
from gpusim.scene import Scene
from gpusim.scene.description import model as m

__all__ = ["run_variants"]

Progress = Callable[[str, float, str], None]
Begin = Callable[[Scene, Path, Progress], Callable[[], Report]]
"""Does what needs the device; what it returns does the rest of a scene's run but for its page."""
CURVE_POINTS = 400


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
        text = str(error) if isinstance(error, GpusimError) else f"{type(error).__name__}: {error}"
        failed = _report(scene, out, reports, (), (), failure=f"variant {name!r}: {text}")
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
    comparisons, stages = [], []
    for spec in scene.measures:
        if not isinstance(spec, m.Damage):
            continue
        started = time.perf_counter()
        progress(spec.name, 0.0, "differences of the deflection lines")
        line = next(d for d in scene.measures if d.name == spec.of)
        assert isinstance(line, m.Deflection)
        results = {v.name: [_line(variant_folder(out, v.name), line)] for v in scene.variants}
        comparison = compare_states(spec, scene, results)
        comparison.write(inside(out, "measure"))
        comparisons.append(comparison)
        seconds = time.perf_counter() - started
        count = sum(len(one.found.position) for one in comparison.lines if one.found)
        stages.append(Stage(spec.name, "run", "compares the variants", seconds))
        progress(spec.name, 1.0, f"{count} changes of slope")
    report = _report(scene, out, reports, tuple(comparisons), tuple(stages))
    progress("report", 0.0, "figures and page")
    write_report(report, out)
    progress("report", 1.0, "report.html, report.json")
    return report


def _line(folder: Path, spec: m.Deflection) -> DeflectionResult:
    """What the run of a variant has recorded."""
    state = StateFile(folder)
    measured = inside(folder, "measure")
    return DeflectionResult.read(measured, spec, lambda path: state.read(Path(path)))


def _report(
    scene: Scene,
    out: Path,
    reports: dict[str, Report],
    comparisons: tuple[DamageResult, ...],
    compared: tuple[Stage, ...],
    *,
    failure: str = "",
) -> Report:
    stages = [
        Stage(f"{name}/{stage.name}", stage.state, stage.reason, stage.seconds)
        for name, report in reports.items()
        for stage in report.stages
    ]
    measurements, figures, warnings = [], [], []
    for comparison in comparisons:
        measurements += _measurements(comparison)
        figures += _figures(comparison, inside(out, "figures"))
        warnings += _missing(comparison)
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
    for comparison in comparisons:
        links += [
            Link(
                "Deflection and difference curves", inside(out, "measure", f"{comparison.name}.csv")
            ),
            Link("Changes of slope", inside(out, "measure", f"{comparison.name}-breaks.csv")),
        ]
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
        figures=tuple(figures),
        links=tuple(links),
    )


def _measurements(comparison: DamageResult) -> list[Measurement]:
    """Each notch beside the slope change nearest to it, what of it the structure does, and what
    the images do; then the noise of each difference."""
    rows = []
    changed = [line for line in comparison.lines if line.state != comparison.reference]
    for line in changed:
        for number, place in enumerate(line.notches_mm, start=1):
            name = f"{line.state}: notch {number} of {line.group}"
            limit = comparison.tolerance_mm / abs(place) if place else None
            found, true = line.nearest(place)
            rows += [
                Measurement.compare(
                    f"{name}, by the change of slope", "mm", found, place, tolerance_relative=limit
                ),
                Measurement(
                    f"{name}, of it the structure", "mm", true, place, true - place, np.nan
                ),
                Measurement(f"{name}, of it the images", "mm", found, true, found - true, np.nan),
            ]
    for line in changed:
        noise = line.noise_px
        name = f"{line.state}: RMS error of the difference, {line.group}"
        rows.append(Measurement(name, "px", noise, 0.0, noise, np.nan))
    return rows


def _missing(comparison: DamageResult) -> list[str]:
    texts = []
    for line in comparison.lines:
        count = 0 if line.found is None else len(line.found.position)
        if line.state != comparison.reference and count != len(line.notches_mm):
            texts.append(
                f"measure {comparison.name!r}: {line.state}, {line.group}: {count} changes of "
                f"slope found for {len(line.notches_mm)} notches"
            )
    return texts


def _figures(comparison: DamageResult, folder: Path) -> list[Drawing]:
    figures: list[Drawing] = []
    for group in comparison.groups:
        lines = comparison.of(group)
        along = f"position along the {group}, {lines[0].axis} (mm)"
        across = f"deflection along {lines[0].across} (mm)"
        stem = f"{comparison.name}-{group}"
        whole = [_curve(line, line.deflection_mm, line.true_mm) for line in lines]
        path = inside(folder, f"{stem}-lines.png")
        figures.append(partial(draw_deflections, whole, (along, across), path))
        changed = [
            _curve(line, line.difference_mm, line.true_difference_mm)
            for line in lines
            if line.state != comparison.reference
        ]
        if changed:
            labels = along, f"difference along {lines[0].across} (mm)"
            path = inside(folder, f"{stem}-differences.png")
            scale = lines[0].mm_per_px
            figures.append(partial(draw_differences, changed, labels, scale, path))
    return figures


def _curve(line: DamageLine, measured: np.ndarray, true: np.ndarray) -> StateCurve:
    none, found = np.zeros(0), line.found
    x = np.linspace(line.position_mm.min(), line.position_mm.max(), CURVE_POINTS)
    return StateCurve(
        name=line.state,
        x=line.position_mm,
        measured=measured,
        true=true,
        breaks=none if found is None else found.position,
        sigma=none if found is None else found.sigma,
        damage=np.array(line.notches_mm),
        fitted_x=none if found is None else x,
        fitted_y=none if found is None else found.at(x),
    )
