"""The stages of a scene, and what each depends on: the graph of its run.

Frames depend on what stands where in them, and on the motions that say so. Radiance is apart from
exposure and noise: another seed exposes the same radiance again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from gpusim.graph.stage import Stage, every, first, same
from gpusim.plan.motion_stages import stillness
from gpusim.plan.stage_builder import Needs, StageBuilder
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.analyses import kind_of
from gpusim.scene.description import model as m
from gpusim.scene.description.video import filming
from gpusim.scene.frames import FrameTable
from gpusim.scene.shared_tables import SharedTables

PUBLIC = (
    "mesh", "model", "solve", "surface", "render", "truth", "measure", "stress", "export",
)  # fmt: skip
"""Kinds of stages that plans and reports show, in their order; a report ends them."""
TARGET = "calib-"
"""How numbers of a calibration target's pictures begin."""
_NONE = "not asked for"
_MOST_PICTURED = 20
"""Modes that are shown in the colours of their displacement."""
_SEEN = ("camera", "light", "prop", "body", "analysis", "measure", "calibration", "sensor.response")


@dataclass(frozen=True)
class SceneStages:
    """The ``stages`` of a scene, needs first; of the public ones that it does without, why:
    ``skipped``; its ``frames``."""

    stages: Sequence[Stage]
    skipped: dict[str, str]
    frames: FrameTable


def scene_stages(
    scene: Scene, options: RunOptions, known: SharedTables | None = None
) -> SceneStages:
    """All stages of a scene without variants, one of those whose tables are ``known``."""
    build = StageBuilder(scene, options, known)
    moving = list(kind_of(scene).make_stages(build))
    motions: Needs = {one.name: first for one in moving if one.name.startswith("motion/")}
    stages = list(moving)
    for camera in scene.cameras:
        stages += _pictures(build, camera.name, motions)
    for camera_name in scene.calibration.cameras if scene.calibration else ():
        stages += _targets(build, camera_name)
    stages += _results(build, motions, [one.name for one in moving])
    if any(one.keeps for one in stages):  # there is something to report of
        stages = [*_looks(build), *stages, *_linear_theory(build, [one.name for one in moving])]
    stages = [*_things(build), *stages]
    return SceneStages(tuple(stages), _skipped(build, stages), build.frames)


def _things(build: StageBuilder) -> Iterator[Stage]:
    """Bodies and props as they stand."""
    for name in build.bodies:
        yield build.stage(f"mesh/{name}", "bodies:mesh", [f"body.{name}.mesh"], public="mesh")
        yield build.stage(f"surface/{name}", "bodies:surface", [f"body.{name}.paint"],
                          {f"mesh/{name}": first}, public="surface")  # fmt: skip
    if build.scene.props:
        yield build.stage("props", "bodies:props", ["prop.still"], public="surface")


def _looks(build: StageBuilder) -> Iterator[Stage]:
    """What is known of them before any work."""
    if build.bodies:
        yield build.stage("meshes", "bodies:mesh_notes", ["body.*.mesh"], build.of_bodies("mesh"),
                          keeps=True)  # fmt: skip
    yield build.stage("geometry", "checks:geometry", _SEEN, build.surfaces(),
                      [build.frames[:1]], keeps=True, early=True)  # fmt: skip


def _linear_theory(build: StageBuilder, moving: Sequence[str]) -> Iterator[Stage]:
    if "solution" in moving and "equilibria" not in moving:
        needs = build.of_bodies("mesh") | build.of_bodies("motion")
        yield build.stage("linear theory", "checks:linear_theory", ["body.*.mechanics"], needs,
                          [list(build.frames)], keeps=True)  # fmt: skip


def _pictures(build: StageBuilder, camera: str, motions: Needs) -> Iterator[Stage]:
    """A camera's frames."""
    scene, frames = build.scene, build.frames
    (spec,) = (one for one in scene.cameras if one.name == camera)
    rate = scene.analysis.frame_rate
    board = scene.calibration.board if scene.calibration else ""
    # neighbours tell how things move while the shutter is open, but for what is known at any time
    told = scene.analysis.vibrates and not any(prop.poses for prop in scene.props)
    wide = spec.shutter is not None and rate is not None and not told
    flickers = any(light.flicker is not None for light in scene.lights)
    rows, moved = [], []
    for number, instant in enumerate(frames):
        near = frames.near(number, wide)
        shown = [frames.shown(one) for one in near]
        between = (near[-1] - near[0]) / (rate or 1.0)
        when = spec.late(number), instant.time if flickers else None
        row = [shown, near.index(number), between, board, *when]
        alike = build.options.skip and not spec.unsteady  # equal frames are one
        rows.append(row if alike else [*row, number])
        moved.append(not all(one.unloaded for one in shown))
    needs = {name: lambda k: (0,) if moved[k] else () for name in motions}
    sections = [f"camera.{camera}", "light", "render", "prop.still", "body.*.name"]
    yield build.stage(f"radiance/{camera}", "images:radiance", sections,
                      build.surfaces() | needs, rows, f"render/{camera}/{{:04d}}",
                      on_device=True)  # fmt: skip
    yield from _exposed(build, camera, f"radiance/{camera}", len(rows))


def _targets(build: StageBuilder, camera: str) -> Iterator[Stage]:
    """A camera's pictures of the calibration target."""
    calibration = build.scene.calibration
    assert calibration is not None
    rows = [
        [calibration.board, calibration.show, [pose.position, pose.rotation]]
        for pose in calibration.poses
    ]
    sections = [f"camera.{camera}", "light", "render", "prop.still", "sensor.response"]
    yield build.stage(f"target/{camera}", "images:target", sections, {"props": first}, rows,
                      f"render/{camera}/{TARGET}{{:04d}}", on_device=True)  # fmt: skip
    yield from _exposed(build, camera, f"target/{camera}", len(rows), TARGET)


def _exposed(
    build: StageBuilder, camera: str, radiance: str, count: int, kind: str = ""
) -> Iterator[Stage]:
    """Pictures of a camera's ``radiance``; of a target, and the board's corners in them."""
    needs: Needs = {radiance: same}
    if build.scene.sensor_of(camera).exposure is None:
        name = f"{kind}exposure/{camera}"
        yield build.stage(name, "images:exposure", [f"camera.{camera}", "light", "sensor.response"],
                          {radiance: first}, [kind], f"render/{camera}/{kind}0000",
                          on_device=True, keeps=True)  # fmt: skip
        needs[name] = first
    sections, corners = [f"camera.{camera}", "sensor"], bool(kind) and build.scene.measures_space
    if corners:
        sections += ["calibration", "prop.still"]
    yield build.stage(f"{kind}picture/{camera}", "images:picture", sections, needs,
                      [[kind, k, corners] for k in range(count)], f"render/{camera}/{kind}{{:04d}}",
                      on_device=True, keeps=True)  # fmt: skip


def _results(build: StageBuilder, motions: Needs, moving: Sequence[str]) -> Iterator[Stage]:
    """What is written and measured beside the pictures."""
    scene, output, table = build.scene, build.scene.output, [list(build.frames)]
    whole = build.surfaces() | motions
    steps: Needs = (
        dict.fromkeys(("equilibria", "solution"), first) if "equilibria" in moving else {}
    )
    if output.truth and scene.cameras:
        yield from _truth(build, motions)
    if output.labels and scene.cameras:
        board = scene.calibration.board if scene.calibration else ""
        sections = ["camera", "analysis", "body.*.paint", "prop.still"]
        yield build.stage("labels", "labels:labels", sections, whole, [[board, *table]], "export",
                          keeps=True)  # fmt: skip
    yield from _films(build)  # which are there even where nothing can be measured in them
    for spec in scene.measures:
        yield from _measured(build, spec, whole, table)
    stresses = output.stress and "solve" in moving
    if stresses:
        needs = build.of_bodies("mesh") | build.of_bodies("model") | motions | steps
        yield build.stage("stress", "mechanics:stress", ["body.*.mechanics"], needs, table,
                          "stress", keeps=True)  # fmt: skip
    if output.fields and motions and any(not one.shown.unloaded for one in build.frames):
        needs = build.of_bodies("mesh") | motions | steps
        needs |= build.of_bodies("model") if "solve" in moving else {}
        shown = scene.analysis.shown_motions(_MOST_PICTURED)
        pictured = [[*motion.items()] for motion in shown]
        row = [*table, output.stress, scene.analysis.word, pictured]
        sections = ["body.*.mechanics", *(f"camera.{one.name}" for one in scene.cameras[:1])]
        yield build.stage("fields", "fields:fields", sections, needs, [row], on_device=True,
                          keeps=True)  # fmt: skip
    if output.calibration:
        yield build.stage("calibration files", "camera_files:calibrations",
                          ["camera", "output.calibration"], public="export", keeps=True,
                          early=True)  # fmt: skip
    if output.vtu or output.stl:
        needs = whole | ({"stress": first} if stresses else {})
        sections = ["output.meshes", "body.*.name", "analysis"]
        yield build.stage("export", "mesh_files:meshes", sections, needs, table, "export",
                          keeps=True)  # fmt: skip


def _films(build: StageBuilder) -> Iterator[Stage]:
    """The pictures of cameras one after the other."""
    video, analysis = build.scene.video, build.scene.analysis
    if video is None:
        return
    rate = analysis.frame_rate or video.frame_rate
    assert rate is not None  # of the scene's faults
    times = [number / rate for number in range(len(build.frames))]
    for camera in filming(video, build.scene.cameras):
        sections = ["video", f"camera.{camera}", "sensor"]
        yield build.stage(f"film/{camera}", "films:film", sections, {f"picture/{camera}": every},
                          [[rate, times]], "export", keeps=True)  # fmt: skip


def _truth(build: StageBuilder, motions: Needs) -> Iterator[Stage]:
    """What each camera sees, all together where who else sees it is asked for; and their file."""
    scene, frames = build.scene, list(build.frames)
    names, together = [camera.name for camera in scene.cameras], "cameras" in scene.output.truth
    board = scene.calibration.board if scene.calibration else ""
    made: dict[str, list[str]] = {}
    for group in [names] if together else [[name] for name in names]:
        stage = f"truth/{'+'.join(group)}"
        sections = ["camera" if together else f"camera.{group[0]}", "analysis", "output.truth",
                    "body.*.name", "prop.still"]  # fmt: skip
        yield build.stage(stage, "truth:seen", sections, build.surfaces() | motions,
                          [[board, frames]], stage, on_device=True, keeps=True)  # fmt: skip
        made[stage] = group
    needs = build.of_bodies("surface") | motions | dict.fromkeys(made, first)
    yield build.stage("truth", "truth:truth", ["name", "analysis", "body.*.name"], needs,
                      [[made, frames]], "truth", keeps=True)  # fmt: skip


def _measured(
    build: StageBuilder, spec: m.MeasureTable, whole: Needs, table: list[Any]
) -> Iterator[Stage]:
    """One measurement."""
    sections = [f"measure.{spec.name}", "camera", "sensor", "prop", "body", "calibration",
                "analysis"]  # fmt: skip
    frames: dict[str, list[int]] = {}
    for camera, frame in spec.pictures(len(build.frames)):
        frames.setdefault(f"picture/{camera}", []).append(frame)
    needs = whole | {stage: partial(_these, numbers) for stage, numbers in frames.items()}
    if spec.uses_calibration:
        needs = needs | {f"{TARGET}picture/{camera}": None for camera in spec.views}
    yield build.stage(f"measure/{spec.name}", "measuring:measure", sections, needs, table,
                      "measure", on_device=spec.correlates, keeps=True)  # fmt: skip


def _these(numbers: Sequence[int], record: int) -> Sequence[int]:
    return numbers


def _skipped(build: StageBuilder, stages: Sequence[Stage]) -> dict[str, str]:
    """Public stages that aren't there, and why."""
    scene, output = build.scene, build.scene.output
    unsolved = kind_of(scene).unsolved
    still = unsolved or stillness(scene, build.frames)
    reasons = {
        "mesh": "no [[body]]",
        "model": unsolved or ("nothing that runs needs it" if scene.bodies else "no [[body]]"),
        "solve": still,
        "surface": "nothing that runs needs it",
        "render": "no [[camera]]",
        "truth": "no [[camera]]" if output.truth else f"{_NONE}: [output] truth is empty",
        "measure": f"{_NONE}: no [[measure]]",
        "stress": still if output.stress else f"{_NONE}: [output] stress is false",
        "export": f"{_NONE}: neither vtu, stl, labels nor calibration in [output], no [video]",
    }
    there = {stage.public(0).split("/")[0] for stage in stages if len(stage.rows)}
    return {kind: reasons[kind] for kind in PUBLIC if kind not in there}
