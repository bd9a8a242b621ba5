"""Pictures that a run has taken, from its results."""

from __future__ import annotations

from typing import Any

import numpy.typing as npt

from gpusim.export.images import keep, read_image, recall
from gpusim.graph.runner import Inputs
from gpusim.pipeline.pictures.file_names import image_name
from gpusim.scene import Scene


def stored_picture(scene: Scene, inputs: Inputs, camera: str, frame: int) -> npt.NDArray[Any]:
    """The picture of a frame, (H, W) or (H, W, 3), in the sensor's numbers; from memory if it is
    still there."""
    stage, name = f"picture/{camera}", image_name(scene, camera, frame)
    path, shift = inputs.path(stage, name), scene.sensor_of(camera).shift
    picture = recall(path)
    if picture is None:
        picture = keep(path, read_image(inputs.read(stage, name)))
    return picture >> shift if shift else picture
