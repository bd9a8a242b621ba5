"""Pictures of frames and of calibration targets: radiance, the exposure chosen for it, the picture.

Radiance stays in memory. A sensor takes it again, with other noise, without anything being drawn.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.export.images import keep, save_image
from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import Output, StageResult
from gpusim.optics.change_detection import same_surfaces
from gpusim.optics.frame import Frame
from gpusim.optics.lens.exposure import photograph
from gpusim.optics.lens.shutter import Shutter, SurfacesAt
from gpusim.optics.sensor.sensor import Sensor
from gpusim.pipeline.notes import Notes
from gpusim.pipeline.pictures.exposure import chosen_exposure, level_warnings
from gpusim.pipeline.pictures.file_names import corners_name, image_name
from gpusim.pipeline.pictures.image_window import Window, window_of
from gpusim.pipeline.scene_objects.cameras import (
    build_camera,
    build_lens,
    build_sensor,
    build_shutter,
    opening,
    unsteady,
)
from gpusim.pipeline.scene_objects.lights import build_lights
from gpusim.pipeline.scene_objects.moving_bodies import scene_objects
from gpusim.pipeline.scene_objects.surfaces import posed
from gpusim.scene import Scene
from gpusim.scene.frames import Placed
from gpusim.surface import Surface
from gpusim.surface.color import color

SERIES = 10_000
"""Frames that a scene may have: series of the same sensor share none of their noise."""


@dataclass(frozen=True, eq=False)
class Radiance:
    """A frame's radiance; of a target only the ``window`` that isn't background (None: all)."""

    frame: Frame
    window: Window | None = None


def radiance(scene: Scene, inputs: Inputs, session: Session) -> Radiance:
    """A camera's frame, drawn; the last one of the camera where that shows the same."""
    (camera,) = scene.cameras
    frames, now, between, board, late, at = inputs.row[:6]
    objects = scene_objects(scene, inputs, frames, board)
    viewer, shutter = build_camera(camera, scene.input), build_shutter(camera)
    later = camera.unsteady and inputs.row[6] > 0
    viewer = unsteady(camera, viewer) if later else viewer
    opens = shutter is not None or late
    in_time = objects.around(range(len(frames)), now, between) if opens else None
    surfaces = in_time or objects.surfaces(now)
    name = f"radiance/{camera.name}"
    # other variants have cameras of this name, too
    seen_by = camera, later, scene.lights, scene.render, at
    last: tuple[Any, Sequence[Surface], Frame] | None = session.kept.pop(name, None)
    alike = last is not None and last[0] == seen_by and session.options.skip
    if last is not None and alike and not callable(surfaces):
        _, shown, drawn = last
        if same_surfaces(shown, surfaces):
            session.kept[name] = seen_by, surfaces, drawn
            return Radiance(drawn)
    del last  # its memory may be needed
    frame = _photograph(scene, session, surfaces, viewer, shutter, late, at)
    if not callable(surfaces):
        session.kept[name] = seen_by, surfaces, frame
    return Radiance(frame)


def target(scene: Scene, inputs: Inputs, session: Session) -> Radiance:
    """A camera's view of the calibration target in a pose, held still, props beside it."""
    (camera,) = scene.cameras
    board, beside, pose = inputs.row
    surfaces = [
        posed(surface, prop, Placed(*pose) if prop.name == board else None)
        for prop, surface in zip(scene.props, inputs["props"], strict=True)
        if prop.name == board or prop.name in beside
    ]
    viewer, window = build_camera(camera, scene.input), None
    if session.options.skip and color(scene.render.background) == 0.0 and camera.lens is None:
        # but for a blurred border, noise, or a black level
        if not build_sensor(scene.sensor_of(camera.name), camera, 1.0).signal():
            window = window_of(surfaces, viewer)
    seen = viewer if window is None else window.camera(viewer)
    return Radiance(_photograph(scene, session, surfaces, seen, build_shutter(camera)), window)


def _photograph(
    scene: Scene,
    session: Session,
    surfaces: Sequence[Surface] | SurfacesAt,
    viewer: Any,
    shutter: Shutter | None,
    late: float = 0.0,
    at: float | None = None,
) -> Frame:
    (camera,) = scene.cameras
    return photograph(
        surfaces,
        viewer,
        build_lights(scene, at),
        lens=build_lens(camera, scene.input),
        shutter=shutter,
        time=opening(shutter, viewer) + late,
        error=scene.render.error,
        background=color(scene.render.background),
        device=session.device,
        **session.options.for_renderer(),
    )


def exposure(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """The exposure of a camera's sensor, chosen from its first frame."""
    (camera,), kind = scene.cameras, inputs.row
    drawn: Radiance = inputs[f"{'target' if kind else 'radiance'}/{camera.name}"]
    like = build_sensor(scene.sensor_of(camera.name), camera, 1.0)
    try:
        sensor = Sensor.auto_exposed(drawn.frame, like=like)
    except InputError:
        lamps = ", ".join(repr(light.name) for light in scene.lights)
        why = f"none of the lights {lamps} reaches what it sees" if lamps else (
            "what it sees has albedo 0")  # fmt: skip
        raise InputError(
            f"camera {camera.name!r}: image {kind}0000 is black, there is nothing to expose it "
            f"for: {why}, or it sees nothing"
        ) from None
    text = json.dumps({"exposure": 1.0 / sensor.full_scale}) + "\n"
    name = f"images/{camera.name}/{kind}exposure.json"
    return StageResult({name: text.encode()}, words=Path(name).name)


def picture(scene: Scene, inputs: Inputs, session: Session) -> StageResult:
    """What the sensor makes of it; of a target, what is found of its board as well."""
    (camera,), (kind, number, finds_corners) = scene.cameras, inputs.row
    drawn: Radiance = inputs[f"{'target' if kind else 'radiance'}/{camera.name}"]
    spec = scene.sensor_of(camera.name)
    sensor = build_sensor(spec, camera, _full_scale(scene, inputs, kind, number))
    common = scene.sensor
    series = common.series * SERIES + number
    image = sensor.expose(drawn.frame, common.seed, series, f"{kind}{camera.name}")
    badly = level_warnings(image, sensor)
    if drawn.window is not None:
        image = drawn.window.placed(image, build_camera(camera, scene.input))
    name, wide = image_name(scene, camera.name, number, kind), camera.sensor[0]
    density = camera.resolution[0] / wide if wide else None
    files: dict[str, Output] = {name: partial(_save, image << spec.shift, density, not kind)}
    if finds_corners:
        files[corners_name(name)] = partial(_save_corners, scene, image, drawn.window)
    what = f"image {kind}{number:04d} of {camera.name}"
    facts = {} if kind else drawn.frame.facts
    notes = Notes(
        warnings=tuple(f"{what}: {text}" for text in drawn.frame.warnings),
        facts={f"camera {camera.name}: {fact}": words for fact, words in facts.items()},
        adapter=session.adapter,
        first_warnings={f"{kind}{camera.name}": f"{what} {text}" for text in badly[:1]},
    )
    return StageResult(files, asdict(notes), Path(name).name)


def _full_scale(scene: Scene, inputs: Inputs, kind: str, number: int) -> float:
    """The scene's exposure, or the one that was chosen, with what has become of the light."""
    (camera,) = scene.cameras
    spec = scene.sensor_of(camera.name)
    given, drift = spec.exposure, 0.0 if kind or number == 0 else spec.drift or 0.0
    if given is None:
        name = f"images/{camera.name}/{kind}exposure.json"
        given = chosen_exposure(inputs.read(f"{kind}exposure/{camera.name}", name))
    return 1.0 / (given * (1.0 + drift))


def _save(image: npt.NDArray[Any], density: float | None, kept: bool, path: Path) -> None:
    save_image(path, image, pixels_per_metre=density)
    if kept:  # it will be measured and shown
        keep(path, image)


def _save_corners(scene: Scene, image: npt.NDArray[Any], window: Window | None, path: Path) -> None:
    from gpusim.pipeline.measurements.sources import find_corners  # OpenCV

    with open(path, "wb") as stream:
        np.savez(stream, allow_pickle=False, **find_corners(scene, image, window))
