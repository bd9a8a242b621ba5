"""What stands in front of the cameras, and where it is in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.graph.runner import Inputs
from gpusim.motion import Motion, State, Vibration
from gpusim.optics.lens.shutter import SurfacesAt
from gpusim.pipeline.scene_objects.cameras import moving
from gpusim.pipeline.scene_objects.surfaces import BodyParts, MeshedBody, posed
from gpusim.scene import Scene
from gpusim.scene.frames import Shown
from gpusim.surface import Surface

_MOMENTS = 9
"""Of an exposure: enough for three periods of a vibration in it, and who is blurred by more isn't
measured."""


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

    def vibrations(self, frame: int) -> dict[int, tuple[Vibration, State]]:
        """Of the bodies that are known at any instant around a frame, by number: their motion, and
        its state in the frame."""
        states = self.frames[frame].states
        return {
            body: (motion, state)
            for body, (motion, state) in enumerate(zip(self.motions, states, strict=False))
            if isinstance(motion, Vibration) and state is not None
        }

    def drift(self, body: int, frame: int, exposure: float) -> Float:
        """(N, 3) m by which the mean of nodes over an ``exposure`` (s) around a frame lies off
        where they are in its middle; 0 of a body that isn't known at any instant."""
        middle = self.displacement(body, frame)
        motion, state = self.vibrations(frame).get(body, (None, ()))
        if motion is None:
            return np.zeros_like(middle)
        places, weights = np.polynomial.legendre.leggauss(_MOMENTS)
        moments = zip(places.tolist(), weights.tolist(), strict=True)
        mean = sum(
            0.5 * weight * motion.displacement(motion.later(state, 0.5 * exposure * place))
            for place, weight in moments
        )
        return np.asarray(mean - middle)


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

    def around(self, near: Sequence[int], frame: int, between: float) -> SurfacesAt | None:
        """Surfaces as a function of the time (s) since a frame; None if nothing moves.

        Bodies that vibrate are where they are then; what else moves goes on as frames ``near`` it
        tell, the first and the last of them ``between`` s apart.
        """
        now, vibrations = self.surfaces(frame), self.vibrations(frame)
        slow = None
        if len(near) > 1 and between:
            slow = moving(self.surfaces(near[0]), now, self.surfaces(near[-1]), between)
        if not vibrations:
            return slow

        def at(time: float) -> list[Surface]:
            surfaces = [*(now if slow is None else slow(time))]
            for number, (motion, state) in vibrations.items():
                parts, u = self.bodies[number], motion.displacement(motion.later(state, time))
                surfaces[number] = parts.skin.moved(parts.surface, u)
            return surfaces

        return at


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
