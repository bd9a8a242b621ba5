"""What a scene describes, as objects, without a folder: its surfaces by frame, its solution."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.gpu import chosen_backend
from gpusim.mesh import Mesh
from gpusim.motion import State, Vibration
from gpusim.pipeline.runner.part import part_runner
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.scene import Scene
from gpusim.surface import Surface
from gpusim.validation import is_number, require


class SceneContents(SceneObjects):
    """Bodies and props with their motions."""

    def surfaces(self, frame: int | None) -> list[Surface]:
        """As `SceneObjects` has them. Raises InputError for a frame that isn't there."""
        return super().surfaces(None if frame is None else self.checked(frame))

    def body_solutions(self) -> dict[str, BodySolution]:
        """Of each body, by name."""
        return {
            body.name: BodySolution(parts.mesh, len(self.frames), self, number)
            for number, (body, parts) in enumerate(zip(self.scene.bodies, self.bodies, strict=True))
        }

    def checked(self, frame: int) -> int:
        """The frame, if it is there. Raises InputError."""
        what, count = f"scene {self.scene.name!r}: frame", len(self.frames)
        fits = is_number(frame) and frame in range(count)
        require(fits, what, repr(frame), f"a whole number from 0 to {count - 1}")
        return int(frame)


@dataclass(frozen=True, eq=False)
class BodySolution:
    """The motion of one body of a scene, frame by frame.

    Attributes
    ----------
    mesh : undeformed, m.
    frames : how many there are.

    Examples
    --------
    >>> bar = gs.load_scene("bar.toml").solution()["bar"]
    >>> bar.frames, bar.displacement(0).shape == bar.mesh.points.shape, bar.reactions(1).shape
    (2, True, (1, 3))
    """

    mesh: Mesh
    frames: int
    _contents: SceneContents
    _number: int

    def __repr__(self) -> str:
        return f"BodySolution({self.mesh}, {self.frames} frames)"

    def displacement(self, frame: int, after: float = 0.0) -> Float:
        """(N, 3) m of the nodes, so many s ``after`` a frame (before it: less than 0). Raises
        InputError for a frame that isn't there, and for a body that is known in frames alone."""
        if not after:
            return self._contents.displacement(self._number, self._contents.checked(frame))
        motion, state = self._vibration(frame)
        return motion.displacement(motion.later(state, after))

    def velocity(self, frame: int, after: float = 0.0) -> Float:
        """(N, 3) m/s, likewise."""
        motion, state = self._vibration(frame)
        return motion.velocity(motion.later(state, after))

    def _vibration(self, frame: int) -> tuple[Vibration, State]:
        found = self._contents.vibrations(self._contents.checked(frame)).get(self._number)
        if found is None:
            what = f"scene {self._contents.scene.name!r}: motion between frames"
            kind = self._contents.scene.analysis.type
            raise InputError(f"{what}; got a body that doesn't vibrate in frame {frame} of an "
                             f"analysis of type {kind!r}; expected one that does")  # fmt: skip
        return found

    def reactions(self, frame: int) -> Float:
        """(S, 3) N of the supports, as the scene lists them; a field and a body that vibrates have
        none."""
        state = self._contents.frames[self._contents.checked(frame)].states[self._number]
        motion = self._contents.motions[self._number]
        if motion is None or state is None:
            return np.zeros((len(self._contents.scene.bodies[self._number].supports), 3))
        return motion.reactions(state)


_PARTS = ("surface", "props", "motion")
"""Kinds of stages whose values are asked for."""


def scene_contents(scene: Scene) -> SceneContents:
    """Bodies, props and motions of a scene, made as a run makes them.

    Raises
    ------
    InputError
        A scene with variants: its objects are those of one of them; and what a run raises.
    """
    names = ", ".join(f"scene.variant({one.name!r})" for one in scene.variants)
    require(not names, f"scene {scene.name!r}", "variants", f"one of {names}")
    options = RunOptions(chosen_backend("scene", "auto"))
    made = scene_stages(scene, options)
    asked = [stage.name for stage in made.stages if stage.name.split("/")[0] in _PARTS]
    needed, kept = set(asked), []
    for stage in reversed(made.stages):  # who needs something comes after it
        if stage.name in needed:
            needed.update(stage.needs)
            kept += [stage.name] * stage.keeps
    with (
        TemporaryDirectory() as folder,
        part_runner(scene, Path(folder), options, kept, lambda *_: None) as runner,
    ):
        runner.work(lambda place: None)
        keys = runner.graph.records[""]
        values = {name: runner.value(keys[name][0]) for name in asked}
    motions = [values.get(f"motion/{body.name}") for body in scene.bodies]
    bodies = [values[f"surface/{body.name}"] for body in scene.bodies]
    board = scene.calibration.board if scene.calibration else ""
    shown = [one.shown for one in made.frames]
    return SceneContents(scene, shown, bodies, motions, values.get("props") or (), board)
