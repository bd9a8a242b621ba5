"""What scenes are solved as."""

from __future__ import annotations

import gpusim as gs
from gpusim.pipeline.scene_objects.modelling import build_model
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.scene.amplitudes import load_groups


def scene_model(scene: gs.Scene) -> gs.Model:
    """Of the first body, by linear theory."""
    body = scene.bodies[0]
    groups = load_groups(body, scene.analysis.load_factors)
    return build_model(build_body(body, scene.input), groups).model
