"""The stages that find a scene's motion, for each kind of analysis; ``motion/<body>`` ends them."""

from __future__ import annotations

from collections.abc import Iterator

from gpusim.graph.stage import Stage, first
from gpusim.plan.stage_builder import Needs, StageBuilder
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups
from gpusim.scene.description.model import StaticTable
from gpusim.scene.frames import FrameTable, Shown


def stillness(scene: Scene, frames: FrameTable) -> str:
    """Why nothing moves, or "" if something does."""
    if not scene.bodies:
        return "no [[body]]"
    if any(not instant.shown.unloaded for instant in frames):
        return ""
    moved = any(any(support.displacement) for body in scene.bodies for support in body.supports)
    if not moved and not any(body.loads for body in scene.bodies):
        return "no load and no prescribed displacement"
    return "every load factor is 0"


def static_stages(build: StageBuilder) -> Iterator[Stage]:
    """Statics: a model a body, one linear solve of all, and its load cases superposed; equilibria
    at large displacements for the bodies that need them."""
    scene, options, table = build.scene, build.options, build.scene.analysis
    assert isinstance(table, StaticTable)
    if not scene.bodies or (options.skip and stillness(scene, build.frames)):
        return
    for body in scene.bodies:
        groups = load_groups(body, scene.analysis.load_factors, options.skip)
        cases = [[group.loads, group.supports] for group in groups]
        yield build.stage(f"model/{body.name}", "mechanics:model", [f"body.{body.name}.solid"],
                          {f"mesh/{body.name}": first}, [[cases, False]], "model")  # fmt: skip
    yield build.stage("solve", "mechanics:solve_scene", ["solver", "body.*.formulation"],
                      build.of_bodies("model"), [None], "solve", keeps=True,
                      on_device=True)  # fmt: skip
    yield build.stage("solution", "mechanics:solution", needs={"solve": first})
    found: Needs = {"solution": first}
    if table.geometry != "linear":
        yield _equilibria(build, table.geometry)
        found["equilibria"] = first
    for number, name in enumerate(build.bodies):
        yield build.stage(f"motion/{name}", "mechanics:motion", needs=found, rows=[[number, name]])


def _equilibria(build: StageBuilder, geometry: str) -> Stage:
    """Which depend on all frames: each begins at the one before, and any of them may be the one
    that linear theory is too far off for."""
    needs: Needs = build.of_bodies("mesh") | build.of_bodies("model") | {"solution": first}
    loads = [one._replace(time=None, shown=Shown(one.shown.states)) for one in build.frames]
    # stress that will be looked at: of each frame, or in the picture of the last one
    moved = [one.number for one in build.frames if not one.shown.unloaded]
    stressed = moved if build.scene.output.stress else moved[-1:]
    row = [geometry, loads, stressed]
    return build.stage("equilibria", "equilibria:equilibria", ["solver", "body.*.mechanics"],
                       needs, [row], "solve", keeps=True, on_device=True)  # fmt: skip


def field_stages(build: StageBuilder) -> Iterator[Stage]:
    """Displacements that are given."""
    for name in build.bodies:
        yield build.stage(f"motion/{name}", "mechanics:given", ["analysis"],
                          {f"mesh/{name}": first}, [name])  # fmt: skip
