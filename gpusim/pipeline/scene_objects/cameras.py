"""Cameras, lenses, shutters and sensors of a scene as the optics take them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.files.input_file import Reader, read_input
from gpusim.optics.calibration.formats import read_rig
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.lens import psf
from gpusim.optics.lens.shutter import Shutter, SurfacesAt
from gpusim.optics.lens.thin_lens import Lens, Vignetting
from gpusim.optics.light.blackbody import blackbody
from gpusim.optics.sensor.channels import Weights, check_sensitivities
from gpusim.optics.sensor.sensor import Sensor
from gpusim.pipeline.scene_objects.arguments import arguments_of
from gpusim.scene.description import model as m
from gpusim.surface import Surface
from gpusim.validation import require


def build_camera(camera: m.CameraTable, read: Reader = read_input) -> Camera:
    """The camera of a scene, in metres; ``read``: how its calibration is read.

    Raises
    ------
    InputError
        A matrix that is no rotation, a lens that folds in the image, or a calibration file that
        doesn't fit.
    """
    columns, rows = camera.resolution
    if camera.calibration:
        found = _calibrated(camera, camera.calibration, read)
        pose = _pose(camera)
        return found if pose is None else replace(found, camera_from_world=pose)
    bent = np.array(camera.distortion) if camera.distortion else None
    pose = _pose(camera)
    assert pose is not None
    if camera.intrinsics:
        fx, fy, cx, cy, skew = camera.intrinsics
        K = np.array([[fx, skew, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    else:
        px, py = columns / camera.sensor[0], rows / camera.sensor[1]
        right, down = camera.principal_point_offset
        K = np.array([
            [camera.focal * px, 0.0, 0.5 * (columns - 1) + right * px],
            [0.0, camera.focal * py, 0.5 * (rows - 1) + down * py],
            [0.0, 0.0, 1.0],
        ])  # fmt: skip
    return Camera(columns, rows, K, bent, pose, camera.name)


def _pose(camera: m.CameraTable) -> Float | None:
    """camera_from_world, or None if only the calibration file knows."""
    if camera.position is not None and camera.target is not None:
        return Camera.from_lens(
            (1.0, 1.0), 1.0, (1, 1), camera.position, camera.target, camera.up, name=camera.name
        ).camera_from_world
    if not camera.rotation:
        return None
    pose = np.eye(4)
    if len(camera.rotation) == 3:
        from scipy.spatial.transform import Rotation  # seldom: most cameras look at a target

        pose[:3, :3] = Rotation.from_rotvec(camera.rotation).as_matrix()
    else:
        given = np.array(camera.rotation).reshape(3, 3)
        u, _, v = np.linalg.svd(given)
        # rows are typed with a few digits: the nearest rotation
        fits = np.abs(u @ v - given).max() <= 1e-3 and np.linalg.det(given) > 0.0
        what = f"camera {camera.name!r} rotation_matrix"
        require(fits, what, given.tolist(), "the rows of a rotation")
        pose[:3, :3] = u @ v
    pose[:3, 3] = camera.translation
    return pose


def unsteady(camera: m.CameraTable, first: Camera) -> Camera:
    """The camera as it stands after the ``first`` frame."""
    from scipy.spatial.transform import Rotation

    motion = np.eye(4)  # of the camera, along its own axes
    motion[:3, :3] = Rotation.from_rotvec(camera.turned or np.zeros(3)).as_matrix()
    motion[:3, 3] = camera.moved or np.zeros(3)
    return replace(first, camera_from_world=np.linalg.inv(motion) @ first.camera_from_world)


def _calibrated(camera: m.CameraTable, path: str, read: Reader) -> Camera:
    which = camera.calibration_camera
    where = f"camera {camera.name!r} calibration {path}"
    file = read(path)
    # read from its bytes, so that no second file beside it is: a run knows the hash of this one
    cameras, metres = read_rig(file, camera.resolution)
    names = [found.name for found in cameras]
    if isinstance(which, str):
        require(which in names, where, f"calibration_camera {which!r}", f"one of {names}")
        which = names.index(which)
    last = len(cameras) - 1
    require(which <= last, where, f"calibration_camera {which}", f"0 to {last}")
    found = cameras[which]
    fits = (found.width, found.height) == camera.resolution
    got = f"{found.width} x {found.height} px there"
    require(fits, where, got, f"resolution_px {list(camera.resolution)}")
    unit = camera.calibration_unit or metres
    pose = found.camera_from_world.copy()
    pose[:3, 3] *= unit
    return replace(found, camera_from_world=pose, name=camera.name)


def build_lens(camera: m.CameraTable, read: Reader = read_input) -> Lens | None:
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
        what, got = f"camera {camera.name!r} lens.focus_distance_mm", 1e3 * spec.focus_distance
        least = f"more than the focal length of the calibration, {1e3 * distance:.4g} mm"
        require(spec.focus_distance > distance, what, f"{got:g}", least)
        focal = distance * spec.focus_distance / (distance + spec.focus_distance)
    values = {**arguments_of(Lens, spec), "focal_length": focal}
    if spec.psf is not None:
        values["psf"] = _psf(spec.psf, camera)
    if spec.vignetting is not None:
        fall = arguments_of(Vignetting, spec.vignetting)
        if "map" in fall:
            fall["map"] = np.array(fall["map"])
        values["vignetting"] = Vignetting(**fall)
    return Lens(**values)


def _psf(spec: m.Psf, camera: m.CameraTable) -> psf.Psf:
    if spec.type == "gaussian":
        return psf.Gaussian(spec.sigma)
    if spec.type == "airy":
        return psf.Airy(spec.wavelength, spec.f_number, _pitch(camera))
    if spec.type == "disc":
        return psf.Disc(spec.radius)
    return psf.MeasuredPsf(np.array(spec.kernel), spec.samples_per_px)


def _pitch(camera: m.CameraTable) -> float:
    return camera.sensor[0] / camera.resolution[0]


def build_shutter(camera: m.CameraTable) -> Shutter | None:
    """The shutter; None for an instant."""
    spec = camera.shutter
    if spec is None or not (spec.exposure or spec.line_time):
        return None
    return Shutter(spec.exposure, spec.line_time, spec.samples)


def image_axes(camera: Camera) -> tuple[tuple[str, str], Float]:
    """The two world axes nearest to the image's right and up, as names and as rows (2, 3)."""
    R = camera.camera_from_world[:3, :3]
    names, rows = [], []
    taken = -1
    for direction in (R[0], -R[1]):
        strength = np.abs(direction)
        if taken >= 0:
            strength[taken] = -1.0
        taken = int(np.argmax(strength))
        sign = 1.0 if direction[taken] > 0 else -1.0
        row = np.zeros(3)
        row[taken] = sign
        names.append(("+" if sign > 0 else "-") + "xyz"[taken])
        rows.append(row)
    return (names[0], names[1]), np.array(rows)


def opening(shutter: Shutter | None, camera: Camera) -> float:
    """When row 0 opens, so that the middle row's exposure is centred on time 0."""
    if shutter is None:
        return 0.0
    return -0.5 * shutter.exposure_time - 0.5 * (camera.height - 1) * shutter.line_time


def build_sensor(scene_sensor: m.SensorTable, camera: m.CameraTable, full_scale: float) -> Sensor:
    """The sensor with a given exposure."""
    values: dict[str, Any] = dict(scene_sensor.values)
    if camera.shutter is not None:
        values["exposure_time"] = camera.shutter.exposure
    values |= {"bits": scene_sensor.bits, "full_scale": full_scale, "channels": camera.channels}
    if camera.white_balance_K is not None:
        values["white_balance"] = _gains_for(camera.white_balance_K, scene_sensor)
    elif camera.white_balance is not None:
        values["white_balance"] = camera.white_balance
    if scene_sensor.preset is not None:
        return Sensor.preset(scene_sensor.preset, **values)
    return Sensor(**values)


def grey_weights(scene_sensor: m.SensorTable, camera: m.CameraTable) -> Weights | None:
    """Of red, green and blue in a camera's pictures; None where these are in colour."""
    if camera.channels == "rgb":
        return None
    sensor = build_sensor(scene_sensor, camera, full_scale=1.0)
    rows = np.array(check_sensitivities(sensor.sensitivities, sensor.bayer is not None))
    return tuple(rows.sum(axis=0) / rows.sum())


def _gains_for(temperature: float, sensor: m.SensorTable) -> tuple[float, ...]:
    """Gains by which a grey surface in the light of ``temperature`` is grey; the smallest of them
    is 1: what is saturated stays white."""
    seen = np.array(blackbody(temperature))
    if sensor.sensitivities is not None:
        seen = np.array(sensor.sensitivities) @ seen
    if sensor.bayer is not None:
        seen *= sensor.bayer_response
    return tuple((seen.max() / seen).tolist())


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
