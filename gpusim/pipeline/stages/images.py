"""Frames of a run: rendered, exposed and written, one camera and frame at a time."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.export.images import keep, write_image
from gpusim.files.atomic_files import write_text
from gpusim.files.input_file import InputFile, Reader, read_input
from gpusim.files.output_folder import inside
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.change_detection import same_surfaces, unseen_change
from gpusim.optics.frame import Frame
from gpusim.optics.lens.exposure import photograph
from gpusim.optics.lens.shutter import SurfacesAt, rolled
from gpusim.optics.light.lights import Light
from gpusim.optics.rendering.local_origin import local_view
from gpusim.optics.sensor.sensor import Sensor
from gpusim.optics.truth import BAND
from gpusim.pipeline.build.cameras import (
    build_camera,
    build_lens,
    build_sensor,
    build_shutter,
    moving,
    opening,
)
from gpusim.pipeline.notes import Notes, StageResult
from gpusim.pipeline.stages.image_window import Window, whole_window, window_of
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.surface import Surface
from gpusim.surface.color import color

__all__ = [
    "CaptureQueue",
    "CaptureSetup",
    "CapturedImage",
    "FrameCapture",
    "image_path",
    "level_warnings",
    "read_exposure",
]

MOST_CLIPPED = 1e-3
"""Share of the pixels; a highlight has fewer."""
COLORS = ("red", "green", "blue")
LEAST_LEVEL = 0.1
"""Of full scale: rounding to whole grey values then is more than 1 % of the contrast in 8 bit."""


def level_warnings(image: npt.NDArray[Any], sensor: Sensor) -> list[str]:
    """Sentences on the grey values of a picture that ``sensor`` took; none for one that is well
    exposed."""
    full, black, most = 2**sensor.bits - 1, sensor.black_level, sensor.saturation
    channels = [image] if image.ndim == 2 else [image[..., k] for k in range(3)]
    lows = [int(channel.min()) for channel in channels]
    highs = [int(channel.max()) for channel in channels]
    high = max(highs)
    if lows == highs:
        word = "black" if high <= black else "white" if min(lows) >= most else "grey"
        if len(set(lows)) > 1:
            word = "of one colour"
        return [f"shows nothing: every pixel is {word}, {high} of {full}"]
    saturated = sensor.saturated(image)
    if saturated.any():
        shares = saturated.reshape(-1, len(channels)).mean(axis=0)
        if shares.max() > MOST_CLIPPED:
            color = " " if len(channels) == 1 else f" {COLORS[shares.argmax()]} "
            well = f" (at {most} of {full}: the full well)" if most < full else ""
            return [
                f"has {100 * shares.max():.2g} % of its{color}pixels saturated{well}: lower "
                "[sensor] exposure or the lamps' power"
            ]
    elif high - black < LEAST_LEVEL * (full - black):
        return [
            f"is too dark: grey values reach {high} of {full}; raise [sensor] exposure or the "
            "lamps' power"
        ]
    return []


SERIES = 10_000  # frames that a scene may have: series of the same sensor share none of their noise


def image_path(scene: Scene, out: Path, camera: str, frame: int, kind: str = "") -> Path:
    """Where the image of a frame lies; ``kind`` "calib-" for those of a calibration target."""
    suffix = "png" if scene.sensor.format == "png" else "tif"
    return inside(out, "images", camera, f"{kind}{frame:04d}.{suffix}")


def read_exposure(file: InputFile) -> float:
    """The exposure that an earlier run chose, as `[sensor] exposure`. Raises InputError."""
    try:
        value = float(json.loads(file.data)["exposure"])
    except (ValueError, KeyError, TypeError, RecursionError):
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise InputError(f"{file.path}: no exposure; expected exposure > 0")
    return value


@dataclass(frozen=True, eq=False)
class CapturedImage:
    """An image that was taken, and where it belongs.

    ``window``: the part of it that isn't background alone; None for all of it. ``density``: pixels
    per metre. ``beside``: files that were written with it. ``kept``: whether it will be measured
    and shown. ``notes``: what is said of it.
    """

    path: Path
    image: npt.NDArray[Any]
    window: Window | None
    density: float | None
    beside: tuple[Path, ...]
    kept: bool
    notes: Notes

    def write(self) -> list[Path]:
        """Write it; returns all of its files."""
        write_image(self.path, self.image, pixels_per_metre=self.density)
        if self.kept:
            keep(self.path, self.image)
        return [self.path, *self.beside]


@dataclass(frozen=True, eq=False)
class CaptureSetup:
    """What pictures of frames and of calibration targets have in common.

    ``read``: how files of an earlier run are read.
    """

    scene: Scene
    out: Path
    device: Device | None
    lights: Sequence[Light] | None
    options: RunOptions
    read: Reader = read_input


class FrameCapture:
    """Renders and exposes frames of one kind; keeps one exposure per camera."""

    def __init__(
        self,
        setup: CaptureSetup,
        surfaces: Callable[[int | None], list[Surface]],
        kind: str = "",
    ) -> None:
        self.scene, self.out, self.device = setup.scene, setup.out, setup.device
        self.lights, self.options, self.read = setup.lights, setup.options, setup.read
        self.surfaces, self.kind = surfaces, kind
        self._last: tuple[str, int, Frame] | None = None
        self._shown: Sequence[Surface] = ()
        self._exposure: dict[str, float] = {}
        self._badly: set[str] = set()
        self._warnings: list[str] = []

    def forget(self) -> None:
        """Let go of the latest frame."""
        self._last, self._shown = None, ()

    def frame(self, camera: m.Camera, frame: int, window: Window | None = None) -> Frame:
        """The linear image of a camera in a frame, or a part of it; the latest one is kept."""
        if self._last is not None:
            name, number, kept = self._last
            if (name, number) == (camera.name, frame):
                return kept
        viewer = build_camera(camera, self.scene.input)
        if window is not None:
            viewer = window.camera(viewer)
        shutter = build_shutter(camera)
        surfaces = self._moving(camera, frame)
        if self._last is not None:
            if name == camera.name and not self.kind and self._unchanged(surfaces, camera, viewer):
                self._last = (name, frame, kept)
                return kept
            kept.release()
        rendered = photograph(
            surfaces,
            viewer,
            self.lights,
            lens=build_lens(camera, self.scene.input),
            shutter=shutter,
            time=opening(shutter, viewer),
            error=self.scene.render.error,
            background=color(self.scene.render.background),
            device=self.device,
            **self.options.for_renderer(),
        )
        self._last = (camera.name, frame, rendered)
        self._shown = () if callable(surfaces) else surfaces
        self._warnings += [f"image {self.kind}{frame:04d} of {camera.name}: {text}"
                           for text in rendered.warnings]  # fmt: skip
        return rendered

    def _unchanged(
        self, surfaces: Sequence[Surface] | SurfacesAt, camera: m.Camera, viewer: Camera
    ) -> bool:
        """Whether the kept frame of this camera shows the same, to the last bit."""
        if not self.options.skip or callable(surfaces) or not self._shown:
            return False
        if same_surfaces(self._shown, surfaces):
            return True
        sharp = camera.lens is None and build_shutter(camera) is None
        return self.lights is None and sharp and unseen_change(self._shown, surfaces, viewer)

    def sight(self, camera: m.Camera, frame: int | None, bodies: int) -> tuple[Frame, Window]:
        """What a camera sees in a frame, unloaded for None, without shading: for the truth.

        Only where the first ``bodies`` surfaces may be; returns that window, too.
        """
        viewer, shutter = build_camera(camera, self.scene.input), build_shutter(camera)
        surfaces: Sequence[Surface] = self.surfaces(frame)
        if frame is not None and shutter is not None and shutter.line_time:
            now = self._moving(camera, frame)
            if callable(now):
                middle = opening(shutter, viewer) + 0.5 * shutter.exposure_time
                surfaces, viewer = rolled(now, lambda _: viewer, middle, shutter.line_time)
                return Frame(local_view(surfaces, viewer, lit=True), self.device), whole_window(
                    viewer
                )
        window = window_of(surfaces[:bodies], viewer, BAND) if self.options.skip else None
        window = window or whole_window(viewer)
        return Frame(local_view(surfaces, window.camera(viewer), lit=True), self.device), window

    def _moving(self, camera: m.Camera, frame: int) -> Sequence[Surface] | SurfacesAt:
        """Surfaces in a frame; as a function of time where they move while the shutter is open."""
        now = self.surfaces(frame)
        rate = self.scene.analysis.frame_rate
        if build_shutter(camera) is None or rate is None or self.kind:
            return now  # a calibration target is held still
        first = max(frame - 1, 0)
        last = min(frame + 1, len(self.scene.analysis.load_factors) - 1)
        if first == last:
            return now
        around = self.surfaces(first), self.surfaces(last)
        return moving(around[0], now, around[1], (last - first) / rate) or now

    def take(self, camera: m.Camera, frame: int) -> CapturedImage:
        """Render and expose one frame."""
        path = image_path(self.scene, self.out, camera.name, frame, self.kind)
        window = self._window(camera, frame)
        linear = self.frame(camera, frame, window)
        sensor = self._sensor(camera, frame, linear)
        beside = []
        if self.scene.sensor_of(camera.name).exposure is None and frame == 0:
            beside.append(self._exposure_file(camera))
        common = self.scene.sensor
        number = common.series * SERIES + frame
        image = sensor.expose(linear, common.seed, number, f"{self.kind}{camera.name}")
        self._check_levels(image, sensor, camera.name, frame)
        if window is not None:
            image = window.placed(image, build_camera(camera, self.scene.input))
        wide = camera.sensor[0]
        density = camera.resolution[0] / wide if wide else None
        notes = Notes(tuple(self._warnings), self._facts(camera, linear), self._adapter)
        self._warnings = []
        return CapturedImage(path, image, window, density, tuple(beside), not self.kind, notes)

    def _facts(self, camera: m.Camera, rendered: Frame) -> dict[str, str]:
        """What lens and shutter did."""
        if self.kind:
            return {}
        return {f"camera {camera.name}: {what}": words for what, words in rendered.facts.items()}

    @property
    def _adapter(self) -> str:
        return "none (numpy backend)" if self.device is None else self.device.name

    def _check_levels(
        self, image: npt.NDArray[Any], sensor: Sensor, camera: str, frame: int
    ) -> None:
        """Warn of the first picture of a camera whose grey values are bad."""
        texts = level_warnings(image, sensor)
        if texts and camera not in self._badly:
            self._badly.add(camera)
            self._warnings += [f"image {self.kind}{frame:04d} of {camera} {t}" for t in texts]

    def _window(self, camera: m.Camera, frame: int) -> Window | None:
        """The part of a target's image that isn't background, if nothing acts on that as well."""
        if not self.kind or not self.options.skip or color(self.scene.render.background) != 0.0:
            return None
        spec = self.scene.sensor_of(camera.name)
        if camera.lens is not None or build_sensor(spec, camera, 1.0).signal():
            return None  # a blurred border, noise, or a black level
        return window_of(self.surfaces(frame), build_camera(camera, self.scene.input))

    def _sensor(self, camera: m.Camera, frame: int, linear: Frame) -> Sensor:
        """The scene's exposure, or one chosen from the camera's first frame and kept in a file."""
        spec = self.scene.sensor_of(camera.name)
        if spec.exposure is not None:
            return build_sensor(spec, camera, 1.0 / spec.exposure)
        file = self._exposure_file(camera)
        if frame == 0:
            like = build_sensor(spec, camera, 1.0)
            try:
                sensor = Sensor.auto_exposed(linear, like=like)
            except InputError:
                lamps = ", ".join(repr(light.name) for light in self.scene.lights)
                why = f"none of the lights {lamps} reaches what it sees" if lamps else (
                    "what it sees has albedo 0")  # fmt: skip
                raise InputError(
                    f"camera {camera.name!r}: image {self.kind}{frame:04d} is black, there is "
                    f"nothing to expose it for: {why}, or it sees nothing"
                ) from None
            self._exposure[camera.name] = 1.0 / sensor.full_scale
            write_text(file, json.dumps({"exposure": self._exposure[camera.name]}) + "\n")
        elif camera.name not in self._exposure:
            self._exposure[camera.name] = read_exposure(self.read(str(file)))
        return build_sensor(spec, camera, 1.0 / self._exposure[camera.name])

    def _exposure_file(self, camera: m.Camera) -> Path:
        return inside(self.out, "images", camera.name, f"{self.kind}exposure.json")


AHEAD = 2
"""Pictures that are taken before the one that is asked for is whole."""


class CaptureQueue:
    """Photographs, in the order in which `take` will be called: ``wanted`` cameras and frames.

    ``look``: what else is found in one, and its files.
    """

    def __init__(
        self,
        capture: FrameCapture,
        wanted: Iterable[tuple[m.Camera, int]],
        look: Callable[[CapturedImage], list[Path]] | None = None,
    ) -> None:
        self.capture, self.look = capture, look
        self._wanted = deque(wanted)
        self._coming: deque[Future[StageResult]] = deque()
        self._pool = ThreadPoolExecutor(AHEAD, thread_name_prefix="gpusim.capture")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()

    def take(self) -> StageResult:
        """Take the next picture; returns its files, and what is said of it."""
        while self._wanted and len(self._coming) <= AHEAD:
            self._coming.append(self._begin())
        return self._coming.popleft().result()

    def _begin(self) -> Future[StageResult]:
        camera, frame = self._wanted.popleft()
        try:
            shot = self.capture.take(camera, frame)
        except Exception as error:  # it belongs to the picture that it happened to
            failed: Future[StageResult] = Future()
            failed.set_exception(error)
            self._wanted.clear()
            return failed
        return self._pool.submit(self._end, shot)

    def _end(self, shot: CapturedImage) -> StageResult:
        return StageResult(shot.write() + (self.look(shot) if self.look else []), shot.notes)
