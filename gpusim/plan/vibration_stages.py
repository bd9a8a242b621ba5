"""The stages that find modes, steady vibrations and motions in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gpusim.graph.stage import Stage, first
from gpusim.plan.stage_builder import StageBuilder
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadGroup, load_groups, load_history
from gpusim.scene.description.model import (
    CameraTable,
    OscillationTable,
    TransientTable,
)


def oscillation_stages(build: StageBuilder) -> Iterator[Stage]:
    """Modes, critical load factors or steady vibrations of each body, whichever of them are
    shown."""
    table = build.scene.analysis
    assert isinstance(table, OscillationTable)
    groups = [load_groups(body, (1.0,)) for body in build.scene.bodies]
    yield from _solved(build, f"vibrations:{table.type}", table.solved_for, groups)


def transient_stages(build: StageBuilder) -> Iterator[Stage]:
    """Motion in time: modes or time steps, then the instants at which cameras look."""
    table, around = build.scene.analysis, opening(build.scene)
    assert isinstance(table, TransientTable)
    times = table.frame_values
    histories = [load_history(body, table, times[-1] + around) for body in build.scene.bodies]
    told = [[one.times, [group.amplitude for group in one.groups], one.start] for one in histories]
    asked = table.solved_for | {"frames": times, "around": around, "histories": told}
    groups = [one.groups for one in histories]
    yield from _solved(build, "transients:transient", asked, groups, "analysis.base_motion")


def _solved(
    build: StageBuilder,
    work: str,
    asked: Mapping[str, Any],
    groups: Sequence[Sequence[LoadGroup]],
    *sections: str,
) -> Iterator[Stage]:
    """Models of the bodies, a load case for each of their ``groups``; the ``work`` that finds what
    is ``asked`` of those that move; their motions."""
    for body, cases in zip(build.scene.bodies, groups, strict=True):
        shares = [[group.loads, group.supports] for group in cases]
        yield build.stage(f"model/{body.name}", "mechanics:model", [f"body.{body.name}.solid"],
                          {f"mesh/{body.name}": first}, [[shares, True]], "model")  # fmt: skip
    states = zip(*(one.shown.states for one in build.frames), strict=True)
    moved = [any(of_body) for of_body in states]
    if build.bodies:
        yield build.stage("solve", work, ["solver", "body.*.formulation", *sections],
                          build.of_bodies("model"), [[moved, asked]], "solve", keeps=True,
                          on_device=True)  # fmt: skip
    for number, name in enumerate(build.bodies):
        yield build.stage(f"motion/{name}", "vibrations:vibration", ["analysis"],
                          {"solve": first}, [[number, name]])  # fmt: skip


def opening(scene: Scene) -> float:
    """s before and after a frame at which some camera may look."""
    return max(map(_opening_of, scene.cameras), default=0.0)


def _opening_of(camera: CameraTable) -> float:
    """s before and after a frame at which a camera may look, points beside its picture included."""
    late = 0.0 if camera.trigger is None else camera.trigger.latest
    if camera.shutter is None:
        return late
    rows = 2.2 * camera.resolution[1] * abs(camera.shutter.line_time)
    return float(0.5 * camera.shutter.exposure + rows + late)
