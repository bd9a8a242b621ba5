"""The report of a run, from what its stages found."""

from __future__ import annotations

import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.files.output_folder import inside
from gpusim.pipeline.build.scene_objects import frame_word
from gpusim.pipeline.build.solution_store import SceneSolution
from gpusim.pipeline.measurements.deflection import DeflectionResult
from gpusim.pipeline.measurements.measurements import Result
from gpusim.pipeline.measurements.stereo_report import (
    stereo_figures,
    stereo_measurements,
    stereo_overlays,
)
from gpusim.pipeline.measurements.stereo_result import StereoResult
from gpusim.pipeline.stages.images import image_path
from gpusim.report import (
    Drawing,
    FramePair,
    Link,
    Measurement,
    Mechanics,
    MeshSummary,
    Overlay,
    Published,
    Report,
    Series,
    SolutionSummary,
    Stage,
    write_report,
)
from gpusim.scene import Scene
from gpusim.scene.cost import effects
from gpusim.scene.description import model as m

__all__ = ["Findings", "failure_text", "make_report", "write_page"]

Array = npt.NDArray[np.float64]
GOAL = 1e-3
"""Relative error up to which a measured deflection counts as good."""


@dataclass(frozen=True, eq=False)
class Findings:
    """What a run knows when it writes its report; ``files`` are those of its stages' results."""

    adapter: str
    stages: tuple[Stage, ...]
    summary: SolutionSummary | None
    solved: SceneSolution | None
    mechanics: Mechanics | None
    meshes: tuple[MeshSummary, ...]
    results: tuple[Result, ...]
    warnings: tuple[str, ...]
    failure: str
    files: frozenset[Path]
    facts: dict[str, str]


def make_report(scene: Scene, out: Path, found: Findings) -> Report:
    """The report of a run, finished or failed."""
    facts = {"Python": platform.python_version()}
    if found.solved is not None:
        facts |= found.solved.facts
    for camera in scene.cameras:
        facts[f"camera {camera.name}"] = effects(scene, camera)
    facts |= found.facts
    measurements: list[Measurement] = []
    series: list[Series] = []
    overlays: list[Overlay] = []
    figures: list[Drawing] = []
    for result in found.results:
        if isinstance(result, StereoResult):
            measurements += stereo_measurements(result)
            overlays += stereo_overlays(result, scene, out)
            figures += stereo_figures(result, inside(out, "figures"))
            continue
        measurements += _measurements(result)
        series += _series(result)
        overlays.append(
            Overlay(
                f"{result.name}: tracked markers",
                image_path(scene, out, result.camera, 0),
                np.where(np.isfinite(result.points_px), result.points_px, 0.0),
                result.displacement_px,
                result.mm_per_px,
            )
        )
    return Report(
        scene=scene.name,
        adapter=found.adapter,
        status="failed" if found.failure else "done",
        stages=found.stages,
        solution=found.summary,
        mechanics=found.mechanics,
        meshes=found.meshes,
        measurements=tuple(measurements),
        published=_published(scene, measurements),
        warnings=found.warnings,
        description=scene.description,
        failure=found.failure,
        facts=facts,
        scene_text=scene.to_toml(),
        frames=_pairs(scene, out, found.results),
        series=tuple(series),
        overlays=tuple(overlays),
        residuals=found.solved.residuals if found.solved is not None else (),
        tolerance=scene.solver.tolerance,
        figures=tuple(figures),
        links=_links(out, found.files),
    )


def write_page(report: Report, out: Path, progress: Callable[[str, float, str], None]) -> None:
    """Write a run's report into its folder."""
    progress("report", 0.0, "figures and page")
    write_report(report, out)
    progress("report", 1.0, "report.html, report.json")


def _published(scene: Scene, measurements: Sequence[Measurement]) -> tuple[Published, ...]:
    """The main number of each measure beside what somebody else reached."""
    rows = []
    for spec in scene.measures:
        own = [item for item in measurements if item.name.startswith(f"{spec.name}: ")]
        other = None if isinstance(spec, m.Damage) else spec.published
        if other is not None and own:
            rows.append(Published(own[0].name, own[0].error_relative, other.error, other.source))
    return tuple(rows)


def _along(result: DeflectionResult) -> tuple[int, float]:
    """Which image axis the measure's direction is, and its sign against that axis."""
    for k, axis in enumerate(result.axes):
        if axis[1] == result.direction[1]:
            return k, 1.0 if axis[0] == result.direction[0] else -1.0
    return 1, 1.0


def _measurements(result: DeflectionResult) -> list[Measurement]:
    k, sign = _along(result)
    measured = sign * result.measured_mm[:, k] + 0.0  # 0, not -0
    truth = sign * result.true_mm[:, k] + 0.0
    tip = len(measured) - 1
    name = f"{result.name}: {result.marker[tip]}, {result.direction}"
    rows = [
        Measurement.compare(name, "mm", float(measured[tip]), float(truth[tip]),
                            tolerance_relative=GOAL)
    ]  # fmt: skip
    length = np.linalg.norm(result.true_mm, axis=1)
    most = int(np.argmax(length))
    if most != tip:
        rows.append(
            Measurement.compare(
                f"{result.name}: {result.marker[most]}, total", "mm",
                float(np.linalg.norm(result.measured_mm[most])), float(length[most]),
                tolerance_relative=GOAL,
            )
        )  # fmt: skip
    rows.append(
        Measurement.compare(
            f"{result.name}: scale coefficient", "mm/px", result.mm_per_px, result.mm_per_px_true,
            tolerance_relative=GOAL,
        )
    )  # fmt: skip
    error = result.measured_mm - result.true_mm
    fine = np.isfinite(error).all(axis=1)
    if fine.any():
        rms = float(np.sqrt(np.mean(np.sum(error[fine] ** 2, axis=1))))
        rows.append(
            Measurement(f"{result.name}: RMS error of all markers", "mm", rms, 0.0, rms, np.nan)
        )
    still = result.static_px[np.isfinite(result.static_px).all(axis=1)]
    if len(still):
        drift = float(np.linalg.norm(still, axis=1).max())
        rows.append(
            Measurement(f"{result.name}: largest motion of a static marker", "px", drift, 0.0,
                        drift, np.nan)
        )  # fmt: skip
    return rows


def _series(result: DeflectionResult) -> list[Series]:
    lines = []
    groups = np.array(result.group)
    for group, curve in result.curves.items():
        rows = np.flatnonzero(groups == group)
        own = result.position_mm[rows]
        # across the member: the image axis along which the markers spread least
        spread = [np.ptp(own @ _unit(axis)) for axis in result.axes]
        across = int(np.argmin(spread))
        axis = result.axes[across]
        sign = -1.0 if axis[1] == result.direction[1] and axis != result.direction else 1.0
        shown = ("-" if axis[0] == "+" else "+") + axis[1] if sign < 0 else axis
        lines.append(
            Series(
                name=f"{group}: deflection along {shown}",
                x=np.linalg.norm(own - own[0], axis=1),
                y_measured=sign * result.measured_mm[rows, across],
                y_truth=sign * result.true_mm[rows, across],
                x_label=f"distance along the {group} from {result.marker[rows[0]]} (mm)",
                y_label=f"deflection along {shown}",
                y_unit="mm",
                units_per_px=result.mm_per_px,
                truth_x=curve[0],
                truth_y=sign * curve[1 + across],
            )
        )
    return lines


def _unit(axis: str) -> Array:
    vector = np.zeros(3)
    vector["xyz".index(axis[1])] = 1.0
    return vector


def _pairs(scene: Scene, out: Path, results: Sequence[Result]) -> tuple[FramePair, ...]:
    factors = scene.analysis.load_factors
    last = len(factors) - 1
    objects = [thing for body in scene.bodies for thing in (*body.loads, *body.supports)]
    own = any(thing.amplitude != factors for thing in objects)  # the factors don't tell all then
    word = frame_word(scene).replace("_", " ")
    when = f"frames 0 and {last}" if own else f"{word} {factors[0]:g} and {factors[last]:g}"
    pairs = []
    for camera in scene.cameras:
        paths = [image_path(scene, out, camera.name, k) for k in (0, last)]
        if last == 0 or not all(path.is_file() for path in paths):
            continue
        crops = [crop for result in results for crop in _crops(result, camera.name)]
        columns, rows = camera.resolution
        caption = f"Camera {camera.name}, {columns} x {rows} px; {when}."
        bits = scene.sensor_of(camera.name).bits
        pairs.append(FramePair(camera.name, paths[0], paths[1], caption, tuple(crops[:4]), bits))
    return tuple(pairs)


def _crops(result: Result, camera: str) -> list[tuple[str, float, float, float, float]]:
    """The first, the middle and the last marker that were followed in a camera."""
    if isinstance(result, StereoResult):
        names = [c.name for c in result.cameras]
        if camera not in names:
            return []
        points = result.points_px[names.index(camera)]
        moved = result.moved_px[names.index(camera)]
    elif result.camera == camera:
        points, moved = result.points_px, result.displacement_px
    else:
        return []
    ok = np.flatnonzero(np.isfinite(points + moved).all(axis=1))
    if not len(ok):
        return []
    shown = ok[np.unique(np.linspace(0, len(ok) - 1, 3).astype(int))]
    ends = points + moved
    return [
        (result.marker[i], *(float(v) for v in points[i]), *(float(v) for v in ends[i]))
        for i in shown
    ]


def _links(out: Path, files: frozenset[Path]) -> tuple[Link, ...]:
    """Links to this run's files; what an earlier scene left in the folder is not among them."""
    links = [Link("Ground truth (HDF5)", file) for file in files if file.name == "truth.h5"]
    links.append(Link("Scene as it was run", inside(out, "scene.toml")))
    links.append(Link("Numbers of this report", inside(out, "report.json")))
    for label, suffix in (("Solution for ParaView", ".pvd"), ("Measured points", ".csv")):
        links += [Link(label, file) for file in sorted(files) if file.suffix == suffix]
    return tuple(links)


def failure_text(error: Exception) -> str:
    """The message, with the error's type where it isn't one of gpusim's own."""
    return str(error) if isinstance(error, GpusimError) else f"{type(error).__name__}: {error}"
