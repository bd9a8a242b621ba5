"""A painted block, a plate beside it and two cameras, with motions in closed form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.pipeline.scene_objects.surfaces import build_body, build_prop
from gpusim.scene import Scene
from gpusim.scene.frames import frame_table
from tests.support.small_scene import small_scene

CAMERA = {"sensor_mm": [15.85, 9.5], "resolution_px": [317, 190], "focal_mm": 25.0}
CHANGES: dict[str, Any] = {
    "body": [{
        "name": "block", "material": "steel",
        "mesh": {"builder": "box", "size_mm": [60.0, 8.0, 40.0], "divisions": [6, 1, 4]},
        "support": [{"name": "clamp", "where": {"set": "x_min"}, "fix": ["x", "y", "z"]}],
        "load": [{"name": "pull", "type": "force", "where": {"set": "x_max"},
                  "force_N": [9.0, 0.0, 0.0]}],
        "paint": [{"name": "grey", "type": "plain", "albedo": 0.4},
                  {"name": "speckle", "type": "speckle", "albedo": 0.8, "diameter_mm": 1.5,
                   "coverage": 0.5, "where": {"normal": "-y", "x_min_mm": 20.0}}],
    }],
    "prop": [{"name": "wall", "center_mm": [30.0, 60.0, 20.0], "normal": [0.0, -1.0, 0.0],
              "size_mm": [300.0, 200.0], "paint": [{"name": "white", "type": "plain",
                                                    "albedo": 0.9}],
              "poses": [{"position_mm": [30.0, 60.0, 20.0]},
                        {"position_mm": [31.5, 60.0, 20.0], "rotation_deg": [0.0, 4.0, 0.0]}]}],
    "camera": [
        {"name": "front", **CAMERA, "position_mm": [33.0, -180.0, 27.0],
         "target_mm": [31.0, 0.0, 19.0], "distortion": [-0.08, 0.02, 0.0, 0.0, 0.0]},
        {"name": "side", **CAMERA, "position_mm": [160.0, -120.0, 40.0],
         "target_mm": [31.0, 0.0, 19.0]},
    ],
    "measure": [], "output": {}, "analysis": {"load_factors": [0.0, 1.0]},
}  # fmt: skip


@dataclass(frozen=True)
class Mapped:
    """A motion that moves every node by a function of its place."""

    points: Float
    by: Callable[[Float], Float]

    def displacement(self, state: tuple[float, ...]) -> Float:
        return self.by(self.points)

    def reactions(self, state: tuple[float, ...]) -> Float:
        return np.zeros((0, 3))


def moved_block(by: Callable[[Float], Float], **changes: Any) -> tuple[Scene, TrueMotion]:
    """The scene, and the truth of its frame 1, in which the block's nodes at X (m) have moved
    ``by(X)``."""
    scene = small_scene(**{**CHANGES, **changes})
    bodies = [build_body(body, scene.input) for body in scene.bodies]
    props = [build_prop(prop, scene.input) for prop in scene.props]
    motions = [Mapped(parts.mesh.points, by) for parts in bodies]
    frames = [one.shown for one in frame_table(scene)]
    return scene, TrueMotion(SceneObjects(scene, frames, bodies, motions, props))
