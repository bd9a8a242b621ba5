"""A camera's pictures as a film, in the order of frames, and a small one for the report."""

from __future__ import annotations

from pathlib import Path

from gpusim.export.video import VideoSink
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import StageResult
from gpusim.pipeline.pictures.file_names import film_names
from gpusim.pipeline.pictures.stored_picture import stored_picture
from gpusim.pipeline.scene_objects.cameras import build_shutter
from gpusim.report.html import fitting, reduced
from gpusim.scene import Scene

WIDEST = 960  # px of a preview


def film(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """Both, one picture held at a time; each is read back and compared where nothing is lost."""
    (camera,), (rate, times) = scene.cameras, inputs.row
    sensor, shutter = scene.sensor_of(camera.name), build_shutter(camera)
    line_time = 0.0 if shutter is None else shutter.line_time
    first_row = -0.5 * (camera.resolution[1] - 1) * line_time  # frames are where the middle one is
    name, shown = film_names(scene, camera.name)
    with (
        VideoSink(inputs.new_file(name), rate, bits=sensor.bits, line_time=line_time) as whole,
        VideoSink(inputs.new_file(shown), rate) as preview,
    ):
        for number, time in enumerate(times):
            inputs.progress(number / len(times), f"film of {camera.name}, frame {number}")
            picture = stored_picture(scene, inputs, camera.name, number)
            whole.append(picture, time + first_row)
            size = fitting(picture.shape, WIDEST)
            preview.append(reduced(picture, size, sensor.bits), time)
    return StageResult(inputs.new_files(), words=f"{Path(name).name}, {len(times)} frames")
