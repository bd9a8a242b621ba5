"""How far bodies turn and move by linear theory, which holds for small rotations, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.fem.recovery.linear_theory import cell_rotations
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies

TOLD = 0.1  # rad: of a cantilever under a force displacements are 0.4 % off
LARGE = 0.1  # of a body's size


@dataclass(frozen=True)
class LinearMotion:
    """Of one body by linear theory, in the frame in which it turns most.

    ``turn``: greatest rotation (rad); ``reach``: how much displacements differ over the body,
    ``size`` its diagonal (m).
    """

    body: str
    frame: int
    turn: float
    reach: float
    size: float

    @property
    def fact(self) -> str:
        """In a few words."""
        turn = f"turns by up to {np.degrees(self.turn):.3g} degrees in frame {self.frame}"
        return f"{turn} (buckling isn't looked for)"

    def _question(self, limit: float) -> str:
        """Where displacements are larger than this share of the body, else ""."""
        if self.reach <= limit * self.size:
            return ""
        return (
            f"by linear theory displacements differ by {1e3 * self.reach:.3g} mm in frame "
            f"{self.frame}, {100 * self.reach / self.size:.3g} % of its size: are units, loads and "
            "moduli meant so? "
        )

    @property
    def doubtful(self) -> str:
        """A question where displacements are larger than the body, else ""."""
        question = self._question(1.0)
        return question and f'{question}Then say [analysis] geometry = "nonlinear"'

    @property
    def warning(self) -> str:
        """A sentence where it matters, else ""."""
        question = self._question(LARGE)
        if not (question or self.turn > TOLD):
            return ""
        why = "linear statics is off by about the square of that"
        way = '[analysis] geometry = "auto" finds how it really bends'
        return f"body {self.body!r}: {question}it {self.fact}, and {why}; {way}"


def linear_motion(objects: MovingBodies, number: int) -> LinearMotion:
    """Of a body that was solved by linear theory."""
    mesh = objects.bodies[number].mesh
    frames = _extreme_frames(objects, number)
    turn, frame = max((_turn(objects, number, frame), frame) for frame in frames)
    reach = float(np.linalg.norm(np.ptp(objects.displacement(number, frame), axis=0)))
    size = float(np.linalg.norm(np.ptp(mesh.points, axis=0)))
    return LinearMotion(objects.bodies[number].body.name, frame, turn, reach, size)


def stretched_shapes(objects: MovingBodies, frames: Sequence[int]) -> list[str]:
    """A sentence on each body that vibrates, or is shown buckled, where it turns far in some of
    ``frames``."""
    told = []
    for number, parts in enumerate(objects.bodies if frames else ()):
        turn, frame = max((_turn(objects, number, frame), frame) for frame in frames)
        if turn > TOLD:
            told.append(
                f"body {parts.body.name!r}: it turns by up to {np.degrees(turn):.3g} degrees in "
                f"frame {frame}, where linear theory makes it {50.0 * turn**2:.2g} % longer; "
                "a smaller amplitude keeps its length"
            )
    return told


def _turn(objects: MovingBodies, number: int, frame: int) -> float:
    turns = cell_rotations(objects.bodies[number].mesh, objects.displacement(number, frame))
    return float(np.linalg.norm(turns, axis=1).max(initial=0.0))


def _extreme_frames(objects: MovingBodies, number: int) -> list[int]:
    """The frames of a body in one of which it turns most: with one group of loads that is where
    its displacements differ most."""
    frames = range(len(objects.frames))
    if any(len(shown.states[number] or ()) > 1 for shown in objects.frames):
        return list(frames)
    reach = [np.linalg.norm(np.ptp(objects.displacement(number, k), axis=0)) for k in frames]
    return [int(np.argmax(reach))]
