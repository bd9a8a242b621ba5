"""Displacements and strains measured in pictures of one camera or of a pair, with their truth.

What is measured comes from pictures and calibrations alone (`correlating`).
"""

from __future__ import annotations

from gpusim.errors import InputError
from gpusim.pipeline.measurements.dic.camera_pair import CameraPair
from gpusim.pipeline.measurements.dic.correlating import advice_on, points_within, with_advice
from gpusim.pipeline.measurements.dic.one_camera import OneCamera
from gpusim.pipeline.measurements.dic.result import FullFieldResult
from gpusim.pipeline.measurements.dic.true_field import TrueField
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.region_of_interest import region_of_interest
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m

RIM = 3
"""Pixels at an edge that aren't used: what lies behind disturbs the interpolation there."""
COARSE = 8
"""Pixels of which one is looked at before there are pictures."""


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
    factors = scene.analysis.load_factors
    frames = spec.measured(len(factors))
    advice = None
    if spec.settings is not None:
        still = next((frame for frame in frames if factors[frame] == factors[0]), None)
        advice = advice_on(what, sources, camera, roi.mask, still)
        spec = with_advice(spec, advice)
    points = points_within(what, roi.mask, spec)
    field = TrueField.of(motion, camera, roi, points)
    kind = OneCamera if spec.cameras is None else CameraPair
    result = kind(what, spec, scene, sources, field, frames).result()
    return result if advice is None else result.with_advice(advice)


def _checks(spec: m.DicTable, scene: Scene, unloaded: Unloaded) -> list[str]:
    """There is something to measure; raises InputError if not."""
    what, camera = f"measure {spec.name!r}", spec.views[0]
    if not unloaded.strict:
        return []
    for name in spec.views:
        if name in unloaded.blind:
            raise InputError(f"{what}: {unloaded.blind[name]}")
    motion = TrueMotion(SceneObjects(scene, (), unloaded.bodies), unloaded.surfaces)
    try:
        region_of_interest(what, spec.roi, motion, camera, stride=COARSE)
    except InputError:  # it may be smaller than that
        region_of_interest(what, spec.roi, motion, camera)
    return []


register(Kind(m.DicTable, FullFieldResult, measure_dic, _checks))
