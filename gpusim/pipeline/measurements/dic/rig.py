"""A pair of cameras as it was calibrated, by pictures or in a file, and as it really is."""

from __future__ import annotations

from collections.abc import Sequence

from gpusim import measure
from gpusim.export.calibrated_cameras import calibrated_cameras, cameras_in_file
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.sources import Sources, calibrated
from gpusim.scene import Scene
from gpusim.scene.description import model as m

Rig = tuple[measure.CalibratedCamera, measure.CalibratedCamera]


def rig_of(cameras: Sequence[Camera]) -> Rig:
    """Two cameras (lengths in m) as a calibration has them, in mm."""
    left, right = calibrated_cameras(cameras)
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
    left, right = cameras_in_file(what, scene.input(spec.calibration), sizes, names=spec.views)
    return left, right
