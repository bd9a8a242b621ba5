"""What stands in front of the cameras, and where it is in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.graph.runner import Inputs
from gpusim.motion import Motion
from gpusim.pipeline.scene_objects.surfaces import BodyParts, MeshedBody, posed
from gpusim.scene import Scene
from gpusim.scene.frames import Shown
from gpusim.surface import Surface


@dataclass
class MovingBodies:
    """Bodies as they were meshed, and how they move. ``frames``: what stands where. ``motions``: of
    the bodies, None where there is none (yet)."""

    scene: Scene
    frames: Sequence[Shown]
    bodies: Sequence[MeshedBody] = ()
    motions: Sequence[Motion | None] = ()

    def displacement(self, body: int, frame: int | None) -> Float:
        """Nodal displacements (N, 3) m of a body in a frame; None: unloaded."""
        state = None if frame is None else self.frames[frame].states[body]
        motion = self.motions[body] if self.motions else None
        if state is None or motion is None:
            return np.zeros((self.bodies[body].mesh.node_count, 3))
        return motion.displacement(state)


@dataclass
class SceneObjects(MovingBodies):
    """Bodies and props as they were built, and where they are in each frame. ``board``: a prop
    that no frame shows."""

    bodies: Sequence[BodyParts] = ()
    props: Sequence[Surface] = ()
    board: str = ""

    def surfaces(self, frame: int | None) -> list[Surface]:
        """Every surface in a frame, bodies first; for None unloaded, and props as they stand."""
        bodies = []
        for number, parts in enumerate(self.bodies):
            moves = frame is not None and self.frames[frame].states[number] is not None
            bodies.append(
                parts.skin.moved(parts.surface, self.displacement(number, frame))
                if moves else parts.surface
            )  # fmt: skip
        places = None if frame is None else self.frames[frame].places
        props = [
            posed(surface, prop, None if places is None else places[number])
            for number, (prop, surface) in enumerate(zip(self.scene.props, self.props, strict=True))
            if prop.name != self.board
        ]
        return bodies + props


def scene_objects(
    scene: Scene, inputs: Inputs, frames: Sequence[Shown], board: str = ""
) -> SceneObjects:
    """What a stage was given of bodies, props and motions; ``scene`` names the bodies, ``board`` is
    as `SceneObjects` has it."""
    bodies = [replace(inputs[f"surface/{body.name}"], body=body) for body in scene.bodies]
    return SceneObjects(
        scene, frames, bodies, _motions(scene, inputs), inputs.get("props") or (), board
    )


def moving_bodies(scene: Scene, inputs: Inputs, frames: Sequence[Shown]) -> MovingBodies:
    """The same of bodies alone, without their surfaces."""
    bodies = [replace(inputs[f"mesh/{body.name}"], body=body) for body in scene.bodies]
    return MovingBodies(scene, frames, bodies, _motions(scene, inputs))


def _motions(scene: Scene, inputs: Inputs) -> list[Motion | None]:
    return [inputs.get(f"motion/{body.name}") for body in scene.bodies]
