"""Displacements and strains measured in pictures of one camera or of a pair, with their truth.

What is measured comes from pictures and calibrations alone (`correlating`).
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.pipeline.measurements.dic.camera_pair import CameraPair
from gpusim.pipeline.measurements.dic.correlating import advice_on, points_within
from gpusim.pipeline.measurements.dic.field_measurement import span_a_surface
from gpusim.pipeline.measurements.dic.one_camera import OneCamera
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.rig import rig_of_file
from gpusim.pipeline.measurements.dic.true_field import TrueField
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.region_of_interest import (
    RIM,
    region_in_picture,
    region_of_interest,
)
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.description.measures import ADVISED
from gpusim.validation import require

COARSE = 8
"""Pixels of which one is looked at before there are pictures."""
FEW_POINTS = 16
"""With room for less, it is seen before whether there are enough."""

LITTLE = 0.5
"""Share of a region in a picture, below which one is told."""


def measure_dic(
    spec: m.DicTable, scene: Scene, objects: SceneObjects, sources: Sources
) -> FullFieldResult:
    """Displacements and strains of what ``spec`` asks for, in every frame against the first one.

    Raises
    ------
    InputError
        A region without pixels or without room for a subset, no usable calibration.
    GpusimError
        A camera can't be calibrated, or too few points are found to lay them on the structure.
    """
    what, motion = f"measure {spec.name!r}", TrueMotion(objects)
    camera = spec.views[0]
    roi = region_of_interest(what, spec.roi, motion, camera).shrunk(RIM)
    advice = None
    if spec.settings is not None:
        advice = advice_on(what, sources, camera, roi.mask, _still(spec, motion))
        chosen = zip(ADVISED, advice.settings.values(), strict=True)
        spec = spec.model_copy(update=dict(chosen))
    points = points_within(what, roi.mask, spec)
    field = TrueField.of(motion, camera, roi, points)
    result = measured_at(field, spec, scene, sources)
    return result if advice is None else result.with_advice(advice)


def _check_points(spec: m.DicTable, points: Float) -> None:
    """A pair is laid on the structure by its points (M, 2) px, and strains are taken from them."""
    require(
        (spec.cameras is None and spec.strain == "none") or span_a_surface(points),
        f"measure {spec.name!r}: points", f"{len(points)} on one line",
        "three or more that span a surface: a larger region, or smaller steps",
    )  # fmt: skip


def _still(spec: m.DicTable, motion: TrueMotion) -> int | None:
    """A measured frame whose picture is that of frame 0 but for its noise, if there is one. What
    moves before or after it is seen while a shutter is open."""
    count = len(motion.objects.frames)
    (shutter,) = (one.shutter for one in motion.scene.cameras if one.name == spec.views[0])
    near = (0,) if shutter is None else (-1, 0, 1)
    for frame in spec.measured(count):
        asked = {one + step for one in (0, frame) for step in near} & {*range(count)}
        if all(motion.unmoved(one) for one in sorted(asked)):
            return frame
    return None


def measured_at(
    field: TrueField, spec: m.DicTable, scene: Scene, sources: Sources
) -> FullFieldResult:
    """The same at the points of a ``field``."""
    _check_points(spec, field.points)
    frames = spec.measured(len(scene.analysis.frame_values))
    kind = OneCamera if spec.cameras is None else CameraPair
    return kind(f"measure {spec.name!r}", spec, scene, sources, field, frames).result()


def unloaded_motion(
    spec: m.CorrelationTable, scene: Scene, unloaded: Unloaded
) -> TrueMotion | None:
    """What cameras see before there are pictures; None if the first picture may show another thing.
    Raises InputError if one of them sees nothing, or for a calibration that doesn't fit."""
    if spec.calibration not in (None, "true"):
        rig_of_file(spec, scene)
    for name in spec.views if unloaded.strict else ():
        if name in unloaded.blind:
            raise InputError(f"measure {spec.name!r}: {unloaded.blind[name]}")
    objects = SceneObjects(scene, (), unloaded.bodies)
    return TrueMotion(objects, unloaded.surfaces) if unloaded.strict else None


def _checks(spec: m.DicTable, scene: Scene, unloaded: Unloaded) -> list[str]:
    """There is something to measure, with a calibration that fits; raises InputError if not."""
    what, camera = f"measure {spec.name!r}", spec.views[0]
    motion = unloaded_motion(spec, scene, unloaded)
    if motion is None:
        return []
    try:
        roi = region_of_interest(what, spec.roi, motion, camera, stride=COARSE)
        pixels = COARSE**2 * int(np.count_nonzero(roi.mask))
    except InputError:  # it may be smaller than that
        pixels = 0
    if pixels < FEW_POINTS * (spec.subset_px + spec.step_px) ** 2:
        roi = region_of_interest(what, spec.roi, motion, camera).shrunk(RIM)
        if spec.settings is None:
            _check_points(spec, points_within(what, roi.mask, spec))
    if spec.roi is not None and (spec.roi.polygon_px or spec.roi.polygon_mm):
        return []  # drawn for these pictures
    shares = {name: region_in_picture(spec.roi, motion, name) for name in spec.views}
    return [
        f"{what}: {share:.0%} of its region lies in the picture of camera {name!r}: take a shorter "
        "focal_mm, or move the camera farther away"
        for name, share in shares.items() if share < LITTLE
    ]  # fmt: skip


register(Kind(m.DicTable, FullFieldResult, measure_dic, _checks))
