"""Measurements of a run, one after the other."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.export.images import keep, read_image, recall
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.measure.targets.boards import Sighting
from gpusim.pipeline.measurements.kinds import kind_of, measured
from gpusim.pipeline.measurements.marker_tracking import MarkerCache
from gpusim.pipeline.measurements.sources import Sources, read_corners
from gpusim.pipeline.pictures.file_names import corners_name, image_name
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects, scene_objects
from gpusim.scene import Scene


def measure(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """One measurement."""
    (spec,) = scene.measures
    tracked = f"tracks/{spec.name}"
    for name in inputs.names(tracked) if inputs.has(tracked) else ():
        inputs.new_file(name).write_bytes(inputs.read(tracked, name).data)
    sources = _sources(scene, inputs)
    result = measured(spec, scene, _objects(scene, inputs), sources)
    result.write(sources.markers.folder)
    return StageResult(inputs.new_files(), words=result.note)


def tracks(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """What can be found for one while a calibration's pictures are taken; faults are met again."""
    (spec,) = scene.measures
    prepare = kind_of(spec).prepare
    if prepare is not None:
        with suppress(GpusimError):
            prepare(spec, scene, _objects(scene, inputs), _sources(scene, inputs))
    return StageResult(inputs.new_files())


def _objects(scene: Scene, inputs: Inputs) -> SceneObjects:
    return scene_objects(scene, inputs, [one.shown for one in inputs.row])


def _sources(scene: Scene, inputs: Inputs) -> Sources:
    def image(camera: str, frame: int) -> npt.NDArray[Any]:
        stage, name = f"picture/{camera}", image_name(scene, camera, frame)
        path = inputs.path(stage, name)
        known, shift = recall(path), scene.sensor_of(camera).shift
        if known is None:
            known = keep(path, read_image(inputs.read(stage, name)))
        return known >> shift if shift else known

    def corners(camera: str, pose: int) -> Sighting:
        name = corners_name(image_name(scene, camera, pose, "calib-"))
        return read_corners(scene, inputs.read(f"calib-picture/{camera}", name))

    return Sources(image, corners, MarkerCache(inputs.new_file("measure/-").parent))
