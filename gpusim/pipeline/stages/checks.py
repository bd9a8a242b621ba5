"""What is doubtful about a scene: of its geometry before any work, of linear theory afterwards."""

from __future__ import annotations

from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.pipeline.checks.warnings import geometry_warnings
from gpusim.pipeline.notes import notes_of
from gpusim.pipeline.scene_objects.moving_bodies import moving_bodies, scene_objects
from gpusim.scene import Scene


def geometry(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Warnings. Raises InputError for a measure that can't work."""
    board = "" if scene.calibration is None else scene.calibration.board
    objects = scene_objects(scene, inputs, [one.shown for one in inputs.row], board)
    return StageResult(notes=notes_of(geometry_warnings(objects)))


def linear_theory(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """How far it is off for each body."""
    from gpusim.pipeline.checks.linear_theory import linear_motion

    objects = moving_bodies(scene, inputs, [one.shown for one in inputs.row])
    found = [linear_motion(objects, number) for number in range(len(scene.bodies))]
    warnings = [one.warning for one in found if one.warning]
    facts = {f"linear statics, {one.body}": one.fact for one in found}
    return StageResult(notes=notes_of(warnings, facts))
