"""What one scale for the whole image does to displacements that are measured with it.

A single camera gives a displacement in its image; one scale coefficient (mm per px) turns it into
millimetres. That is right for a plane that is parallel to the sensor, moves within itself and is
seen without distortion. Where it is not, the error is known beforehand, from the true motion and
the camera: it is computed here, in parts that add up. These have the scale that faultless centres
would give; what the measured scale is off by is a part of its own.
"""

from __future__ import annotations

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Bool, Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.camera_readings import camera_readings, steps

PARTS = {
    "axis": "motion along the camera's axis changes the scale",
    "plane": "the markers' plane is seen in perspective, at an angle or at several depths",
    "lens": "the lens distorts, and the measure doesn't undo it",
    "scale": "the scale is wrong, by the centres that were found in the first image",
}


def projection_error(
    camera: Camera,
    position: Float,
    moved: Float,
    plane: Float,
    *,
    scale: measure.Scale,
    used: Bool,
) -> dict[str, Float]:
    """The error of displacements that are read off the image with one scale: measured less true
    displacement (M, 2) in mm that each of `PARTS` makes; they add up.

    Parameters
    ----------
    position, moved : (M, 3) m, world; markers at rest, and their true displacements.
    plane : (2, 3) the world axes nearest to the image's right and up, in which one measures.
    scale : what turns pixels into millimetres along these axes, as it was measured.
    used : (M,) the markers that it was measured with.

    A marker that gets out of the camera's sight has NaN.
    """
    forward = camera.camera_from_world[2, :3]
    within = moved - np.outer(moved @ forward, forward)

    def exact(lens: Camera) -> measure.Scale:
        centres = lens.project(position)
        known = used & np.isfinite(centres).all(axis=1)
        if np.count_nonzero(known) < 2:
            return scale
        return measure.scale_coefficient(centres[known], 1e3 * position[known] @ plane.T)

    def read(lens: Camera, motion: Float, by: measure.Scale | None = None) -> Float:
        seen = lens.project(position + motion) - lens.project(position)
        return (by or exact(lens)).vectors(seen)

    sideways, whole, bent = camera_readings(camera, within, moved, read)
    readings = {
        "truth": 1e3 * moved @ plane.T, "plane": sideways, "axis": whole, "lens": bent,
        "scale": read(camera, moved, scale),
    }  # fmt: skip
    errors = steps(readings)
    return {part: errors[part] for part in PARTS}
