"""A pair of cameras as it was calibrated, by pictures or in a file, and as it really is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim import measure
from gpusim.optics.calibration.formats import read_calibration
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.results import MM
from gpusim.pipeline.measurements.sources import Sources, calibrated
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.validation import require

Rig = tuple[measure.CalibratedCamera, measure.CalibratedCamera]


def rig_of(cameras: Sequence[Camera]) -> Rig:
    """Two cameras (lengths in m) as a calibration has them, in mm."""
    first = np.linalg.inv(cameras[0].camera_from_world)
    left, right = (
        measure.rig_camera((camera.width, camera.height), camera.K, camera.distortion,
                           pose[:3, :3], MM * pose[:3, 3], camera.name)
        for camera in cameras for pose in (camera.camera_from_world @ first,)
    )  # fmt: skip
    return left, right


def calibrated_rig(
    spec: m.DicTable, scene: Scene, sources: Sources, cameras: Sequence[Camera]
) -> tuple[Rig, float]:
    """The pair that ``spec`` measures with, and the RMS error (px) of its calibration, NaN if
    nothing is known of that; ``cameras``: as they are. Raises as `rig_of_file`, and GpusimError for
    a camera whose pictures of the target don't calibrate it."""
    if spec.calibration is None:
        _, found = calibrated(spec, scene, sources.corners)
        return (found.cameras[0], found.cameras[1]), found.rms
    return rig_of(cameras) if spec.calibration == "true" else rig_of_file(spec, scene), float("nan")


def rig_of_file(spec: m.CorrelationTable, scene: Scene) -> Rig:
    """What the calibration file of ``spec`` has, cameras by their names or else in its order.
    Raises InputError for a file without two cameras of such pictures."""
    assert spec.calibration is not None
    what = f"measure {spec.name!r} calibration {spec.calibration}"
    by_name = {camera.name: camera.resolution for camera in scene.cameras}
    sizes = [by_name[name] for name in spec.views]
    given = read_calibration(scene.input(spec.calibration), sizes[0])
    named = {camera.name: camera for camera in given}
    if set(spec.views) <= set(named):
        given = [named[name] for name in spec.views]
    require(len(given) >= 2, what, f"{len(given)} cameras", "two")
    got = [(camera.width, camera.height) for camera in given[:2]]
    require(got == sizes, what, f"pictures of {got} px", f"{sizes}")
    return rig_of(given[:2])
