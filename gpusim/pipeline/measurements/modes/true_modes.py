"""The modes of a body that moves in time, or how it vibrates steadily, and their shapes in a
picture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.motion import Oscillation, Transient
from gpusim.pipeline.measurements.material_points import MaterialPoints, TrueMotion

STEP_PX = 1e-3
"""About so far a shape moves what is seen, where its direction in the picture is found."""


@dataclass(frozen=True, eq=False)
class TrueModes:
    """``frequency_Hz`` and ``damping`` (n,), shares of critical damping, and ``shapes`` (n, P, 2)
    in the picture, of no particular size; none where nobody knows modes. Of what is steady nobody
    knows the damping: NaN."""

    frequency_Hz: Float
    damping: Float
    shapes: Float


def true_modes(motion: TrueMotion, camera: str, points: MaterialPoints) -> TrueModes:
    """Of the body that most ``points`` are on."""
    bodies = motion.body(points)
    number = int(np.bincount(bodies[bodies >= 0]).argmax()) if (bodies >= 0).any() else -1
    of_body = motion.objects.motions[number] if number >= 0 else None
    frequency = damping = np.zeros(0)
    if isinstance(of_body, Oscillation):
        frequency, damping = of_body.frequencies, np.full(len(of_body.frequencies), np.nan)
        # nodes needn't be in phase: where they are farthest
        lag = 0.5 * np.angle((of_body.amplitudes**2).sum(axis=(1, 2)))
        fields = (of_body.amplitudes * np.exp(-1j * lag)[:, None, None]).real
    elif isinstance(of_body, Transient) and of_body.natural is not None:
        (frequency, damping), fields = of_body.natural, of_body.shapes
    parts, surfaces = motion.objects.bodies[number], list(motion.surfaces(None))
    lens, rest = motion.camera(camera), motion.position(points, None)
    place = motion.position(points, 0)
    depth = float(np.median(lens.to_camera(place)[:, 2]))
    shapes = np.zeros((len(frequency), len(points), 2))
    for k, shape in enumerate(fields[: len(frequency)]):
        step = STEP_PX * depth / lens.K[0, 0] / np.linalg.norm(shape, axis=1).max()
        surfaces[number] = parts.skin.moved(parts.surface, step * shape)
        vertices = np.concatenate([one.points for one in surfaces])
        moved = points.at(vertices) - rest
        shapes[k] = (lens.project(place + moved) - lens.project(place - moved)) / (2.0 * step)
    return TrueModes(frequency, damping, shapes)
