"""The stages that find modes, steady vibrations and motions in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gpusim.graph.stage import Stage, first
from gpusim.plan.stage_builder import StageBuilder
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadGroup, LoadHistory, load_groups, load_history
from gpusim.scene.description.model import CameraTable


def modal_stages(build: StageBuilder) -> Iterator[Stage]:
    """Modes of each body, whichever of them are shown."""
    analysis = build.scene.analysis
    row = [analysis.mode_count, analysis.band, bool(analysis.prestress), _mass(build)]
    yield from _solved(build, "vibrations:modes", row)


def buckling_stages(build: StageBuilder) -> Iterator[Stage]:
    """Critical load factors of each body."""
    yield from _solved(build, "vibrations:buckling", [build.scene.analysis.mode_count])


def harmonic_stages(build: StageBuilder) -> Iterator[Stage]:
    """Steady vibration at each frequency, whichever phases are shown."""
    analysis = build.scene.analysis
    options = _mass(build) | {"count": analysis.mode_count}
    row = [analysis.frequencies_Hz, analysis.band, _damping(build), options]
    yield from _solved(build, "vibrations:harmonic", row)


def transient_stages(build: StageBuilder) -> Iterator[Stage]:
    """Motion in time: modes or time steps, then the instants at which cameras look."""
    analysis, frames = build.scene.analysis, build.scene.analysis.frame_values
    around = opening(build.scene)
    options: dict[str, Any] = {"method": analysis.method or "modal"} | _mass(build)
    options |= (
        {"step": analysis.time_step} if analysis.time_step else {"count": analysis.mode_count}
    )
    moved = [
        any(states) for states in zip(*(one.shown.states for one in build.frames), strict=True)
    ]
    histories = [load_history(body, analysis, frames[-1] + around) for body in build.scene.bodies]
    told = [
        [one.times, [group.amplitude for group in one.groups], one.start] if moves else None
        for one, moves in zip(histories, moved, strict=True)
    ]
    row = [frames, around, told, _damping(build), options]
    yield from _solved(build, "transients:transient", row, ("analysis.base_motion",), histories)


def _solved(
    build: StageBuilder,
    work: str,
    row: Sequence[Any],
    sections: Sequence[str] = (),
    histories: Sequence[LoadHistory] | None = None,
) -> Iterator[Stage]:
    """Models of the bodies, whatever finds their motions, and these."""
    for number, body in enumerate(build.scene.bodies):
        groups: Sequence[LoadGroup] = load_groups(body, (1.0,))
        if histories is not None:
            groups = histories[number].groups
        cases = [[group.loads, group.supports] for group in groups]
        yield build.stage(f"model/{body.name}", "mechanics:model", [f"body.{body.name}.solid"],
                          {f"mesh/{body.name}": first}, [[cases, True]], "model")  # fmt: skip
    if build.bodies:
        yield build.stage("solve", work, ["solver", "body.*.formulation", *sections],
                          build.of_bodies("model"), [row], "solve", keeps=True,
                          on_device=True)  # fmt: skip
    for number, name in enumerate(build.bodies):
        yield build.stage(f"motion/{name}", "vibrations:vibration", ["analysis"],
                          {"solve": first}, [[number, name]])  # fmt: skip


def _mass(build: StageBuilder) -> dict[str, Any]:
    return {"mass": build.scene.analysis.mass or "exact"}


def _damping(build: StageBuilder) -> Mapping[str, float]:
    table = build.scene.analysis.damping
    return {} if table is None else table.model_dump(exclude_none=True)


def opening(scene: Scene) -> float:
    """s before and after a frame at which some camera may look."""
    return max(map(_opening_of, scene.cameras), default=0.0)


def _opening_of(camera: CameraTable) -> float:
    """s before and after a frame at which a camera may look, points beside its picture included."""
    if camera.shutter is None:
        return 0.0
    rows = 2.2 * camera.resolution[1] * abs(camera.shutter.line_time)
    return float(0.5 * camera.shutter.exposure + rows)
