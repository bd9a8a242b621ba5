"""Lens, shutter and sensor of a scene as the optics take them, and motion around a frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gpusim.errors import InputError
from gpusim.files.input_file import Reader, read_input
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.lens import psf
from gpusim.optics.lens.shutter import Shutter, SurfacesAt
from gpusim.optics.lens.thin_lens import Lens
from gpusim.optics.lens.thin_lens import Vignetting
from gpusim.optics.sensor.sensor import Sensor
from gpusim.pipeline.build.cameras import build_camera
from gpusim.scene.description import model as m
from gpusim.surface import Surface

__all__ = ["build_lens", "build_sensor", "build_shutter", "moving", "opening"]


def build_lens(camera: m.Camera, read: Reader = read_input) -> Lens | None:
    """The lens; the camera's focal length is its image distance v, so that f = v s / (s + v).

    Raises
    ------
    InputError
        The calibration file's focal length isn't less than the distance of focus.
    """
    spec = camera.lens
    if spec is None:
        return None
    focal = spec.focal
    if spec.focus_distance is not None and focal is None:
        distance = camera.focal or build_camera(camera, read).K[0, 0] * _pitch(camera)
        if not spec.focus_distance > distance:
            raise InputError(
                f"camera {camera.name!r} lens.focus_distance_mm; got "
                f"{1e3 * spec.focus_distance:g}; expected more than the focal length of the "
                f"calibration, {1e3 * distance:.4g} mm"
            )
        focal = distance * spec.focus_distance / (distance + spec.focus_distance)
    fall = spec.vignetting
    return Lens(
        psf=None if spec.psf is None else _psf(spec.psf, camera),
        fill_factor=spec.fill_factor,
        f_number=spec.f_number,
        focal_length=focal,
        focus_distance=spec.focus_distance,
        blades=spec.blades,
        positions=spec.positions,
        vignetting=None
        if fall is None
        else Vignetting(
            fall.cos4, fall.polynomial, None if fall.map is None else np.array(fall.map)
        ),
    )


def _psf(spec: m.Psf, camera: m.Camera) -> psf.Psf:
    if spec.type == "gaussian":
        return psf.Gaussian(spec.size)
    if spec.type == "airy":
        return psf.Airy(spec.wavelength, spec.size, _pitch(camera))
    if spec.type == "disc":
        return psf.Disc(spec.size)
    return psf.MeasuredPsf(np.array(spec.kernel), spec.size)


def _pitch(camera: m.Camera) -> float:
    return camera.sensor[0] / camera.resolution[0]


def build_shutter(camera: m.Camera) -> Shutter | None:
    """The shutter; None for an instant."""
    spec = camera.shutter
    if spec is None or not (spec.exposure or spec.line_time):
        return None
    return Shutter(spec.exposure, spec.line_time, spec.samples)


def opening(shutter: Shutter | None, camera: Camera) -> float:
    """When row 0 opens, so that the middle row's exposure is centred on time 0."""
    if shutter is None:
        return 0.0
    return -0.5 * shutter.exposure_time - 0.5 * (camera.height - 1) * shutter.line_time


def build_sensor(scene_sensor: m.Sensor, camera: m.Camera, full_scale: float) -> Sensor:
    """The sensor with a given exposure."""
    values: dict[str, Any] = dict(scene_sensor.values)
    if camera.shutter is not None:
        values["exposure_time"] = camera.shutter.exposure
    values |= {"bits": scene_sensor.bits, "full_scale": full_scale}
    if scene_sensor.preset is not None:
        return Sensor.preset(scene_sensor.preset, **values)
    return Sensor(**values)


def moving(
    before: Sequence[Surface], now: Sequence[Surface], after: Sequence[Surface], between: float
) -> SurfacesAt | None:
    """Surfaces as a function of the time since ``now``; None if nothing moves.

    Their velocity is the difference between the neighbouring frames, ``between`` s apart.
    """
    velocities = [(b.points - a.points) / between for a, b in zip(before, after, strict=True)]
    if not any(velocity.any() for velocity in velocities):
        return None

    def at(time: float) -> list[Surface]:
        return [
            surface.moved(surface.points + time * velocity) if velocity.any() else surface
            for surface, velocity in zip(now, velocities, strict=True)
        ]

    return at
