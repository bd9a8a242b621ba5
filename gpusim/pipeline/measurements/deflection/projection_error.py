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

PARTS = {
    "axis": "motion along the camera's axis changes the scale",
    "plane": "the markers' plane is seen in perspective, at an angle or at several depths",
    "lens": "the lens distorts, and the measure doesn't undo it",
    "start": "the first image shows the structure as it is displaced then, and the scale takes it "
    "for unloaded",
    "scale": "the scale is wrong, by the centres that were found in the first image",
    "exposure": "the shutter is open while it moves",
}


def projection_error(
    camera: Camera,
    position: Float,
    moved: Float,
    plane: Float,
    *,
    scale: measure.Scale,
    used: Bool,
    start: Float | float = 0.0,
) -> dict[str, Float]:
    """The error of displacements that are read off the image with one scale: measured less true
    displacement (M, 2) in mm that each of `PARTS` makes; they add up.

    Parameters
    ----------
    position, moved : (M, 3) m, world; markers at rest, and their true displacements after the
        first image.
    plane : (2, 3) the world axes nearest to the image's right and up, in which one measures.
    scale : what turns pixels into millimetres along these axes, as it was measured.
    used : (M,) the markers that it was measured with.
    start : (M, 3) m, true displacements in the first image, which the scale doesn't know of.

    A marker that gets out of the camera's sight has NaN.
    """
    forward = camera.camera_from_world[2, :3]
    at, along = position + start, moved @ forward
    within = moved - along[:, None] * forward

    def seen(lens: Camera, displacement: Float) -> Float:
        return lens.project(at + displacement) - lens.project(at)

    def exact(lens: Camera, taken: Float) -> measure.Scale:
        """Of faultless centres whose places are ``taken`` for these."""
        centres = lens.project(at)
        known = used & np.isfinite(centres).all(axis=1)
        if np.count_nonzero(known) < 2:
            return scale
        return measure.scale_coefficient(centres[known], 1e3 * taken[known] @ plane.T)

    ideal = camera.without_distortion()
    pinhole = exact(ideal, at)
    sideways, whole = (pinhole.vectors(seen(ideal, motion)) for motion in (within, moved))
    bent, read = (exact(camera, taken).vectors(seen(camera, moved)) for taken in (at, position))
    truth = 1e3 * moved @ plane.T
    return {
        "axis": whole - sideways,
        "plane": sideways - truth,
        "lens": bent - whole,
        "start": read - bent,
        "scale": scale.vectors(seen(camera, moved)) - read,
    }
