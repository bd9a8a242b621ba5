"""Measurements of a run, one after the other."""

from __future__ import annotations

from functools import partial

from gpusim.gpu import Device
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.measure.targets.boards import Sighting
from gpusim.pipeline.measurements.kinds import measured
from gpusim.pipeline.measurements.sources import Sources, read_corners
from gpusim.pipeline.pictures.file_names import corners_name, image_name
from gpusim.pipeline.pictures.stored_picture import stored_picture
from gpusim.pipeline.scene_objects.moving_bodies import scene_objects
from gpusim.scene import Scene


def measure(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """One measurement."""
    (spec,) = scene.measures
    board = "" if scene.calibration is None else scene.calibration.board
    objects = scene_objects(scene, inputs, [one.shown for one in inputs.row], board)
    device = session.device if spec.correlates else None
    result = measured(spec, scene, objects, _sources(scene, inputs, device))
    if session.results is not None:
        session.results[inputs.key] = result
    files = {f"measure/{name}": content for name, content in result.contents().items()}
    return StageResult(files, words=f"{spec.name}: {result.note}")


def _sources(scene: Scene, inputs: Inputs, device: Device | None) -> Sources:
    def corners(camera: str, pose: int) -> Sighting:
        name = corners_name(image_name(scene, camera, pose, "calib-"))
        return read_corners(scene, inputs.read(f"calib-picture/{camera}", name))

    return Sources(partial(stored_picture, scene, inputs), corners, device)
