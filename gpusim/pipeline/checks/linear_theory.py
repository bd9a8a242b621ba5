"""How far linear statics is off in the frames of a scene, as an estimate and in words."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.model.model import Model
from gpusim.fem.procedures.expansion import higher_orders
from gpusim.fem.recovery.linear_theory import cell_rotations, second_order, stretching
from gpusim.pipeline.scene_objects.modelling import build_model, temperature
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies
from gpusim.pipeline.scene_objects.surfaces import MeshedBody
from gpusim.scene.description import model as m

SMALL_TURN = 0.02  # rad: at most 0.08 % of the displacement, which takes no further look
TOLD = 0.005
STRETCHING = 3e-4  # three times what could make a difference of 0.2 %
LARGE = 0.1  # of a body's size
FORCES = (
    m.ForceTable,
    m.NodalForceTable,
    m.LineForceTable,
    m.PressureTable,
    m.TractionTable,
    m.GravityTable,
    m.CentrifugalTable,
)


@dataclass(frozen=True)
class LinearError:
    """Of one body, in the frame in which linear theory is off most.

    ``turn``: greatest rotation (rad); ``moved``: greatest displacement (m) by linear theory;
    ``share``: what an exact solution would have of it, about; ``longer``: the strain by which the
    linear solution is too long, over the body, about; ``reach``: how much displacements
    differ over the body, ``size`` its diagonal (m).
    """

    body: str
    frame: int
    turn: float
    moved: float
    share: float
    longer: float
    reach: float
    size: float

    @property
    def fact(self) -> str:
        """In a few words, whatever it is."""
        turn = f"turns by up to {np.degrees(self.turn):.2g} degrees in frame {self.frame}: "
        if not self.turn > SMALL_TURN and self.off < 0.001:
            return f"{turn}displacements are less than 0.1 % off unless it buckles"
        return f"{turn}{self._off} of {1e3 * self.moved:.4g} mm"

    @property
    def off(self) -> float:
        """By how much displacements are off, relative."""
        return abs(1.0 / self.share - 1.0)

    @property
    def _off(self) -> str:
        off = self.moved * (1.0 - self.share)
        way = "too large" if off > 0.0 else "too small"
        return f"displacements are about {1e3 * abs(off):.2g} mm ({100 * self.off:.2g} %) {way}"

    @property
    def doubtful(self) -> str:
        """A question where displacements by linear theory are larger than the body, else ""."""
        if self.reach <= self.size:
            return ""
        return (
            f"by linear theory displacements differ by {1e3 * self.reach:.3g} mm in frame "
            f"{self.frame}, {100 * self.reach / self.size:.3g} % of its size: are units, loads and "
            'moduli meant so? Then say [analysis] geometry = "nonlinear"'
        )

    @property
    def warning(self) -> str:
        """A sentence where it matters, else ""."""
        text = f"body {self.body!r}: "
        large = not self.reach <= LARGE * self.size
        if large:
            text += (
                f"displacements differ by {1e3 * self.reach:.3g} mm in frame {self.frame}, "
                f"{100 * self.reach / self.size:.3g} % of its size; linear statics holds for small "
                "ones only: are units, loads and moduli meant so? It "
            )
        elif not self.off > TOLD:
            return ""
        return (
            f"{text}turns by up to {np.degrees(self.turn):.3g} degrees in frame {self.frame}; by "
            f"linear statics its {self._off}, of {1e3 * self.moved:.4g} mm, and it gets about "
            f"{1e3 * self.longer * self.size:.2g} mm too long"
        )


def linear_errors(objects: MovingBodies) -> list[LinearError]:
    """One per body; all were solved for, by linear theory."""
    return [linear_error(objects, number) for number in range(len(objects.bodies))]


def linear_error(objects: MovingBodies, number: int) -> LinearError:
    """Of a body in the frame in which linear theory is off most: it turns or moves most there."""
    found = [_in_frame(objects, number, frame) for frame in _extreme_frames(objects, number)]
    return max(found, key=lambda error: error.off)


def _extreme_frames(objects: MovingBodies, number: int) -> list[int]:
    """Frames in which a body turns most, and in which its displacements differ most."""
    mesh = objects.bodies[number].mesh
    reach, turn = np.zeros((2, len(objects.frames)))
    several = any(len(shown.states[number] or ()) > 1 for shown in objects.frames)
    for frame in range(len(objects.frames)):
        u = objects.displacement(number, frame)
        reach[frame] = np.linalg.norm(np.ptp(u, axis=0))
        if several:  # else it turns most where it moves most
            turn[frame] = np.linalg.norm(cell_rotations(mesh, u), axis=1).max(initial=0.0)
    return list(dict.fromkeys([int(reach.argmax()), int((turn if several else reach).argmax())]))


def with_stretching(
    error: LinearError, u: Float, model: Model, factors: Float, formulation: str
) -> LinearError:
    """The same where a body may have to stretch as it bends, of its displacements ``u`` (N, 3) in
    the frame of the error, at ``factors`` (L,) of the load cases of its model."""
    if model.constraints or not stretching(model.mesh, u) > STRETCHING:
        return error
    moved = u + higher_orders(model, u, factors, formulation)
    change = float(np.linalg.norm(moved, axis=1).max()) / error.moved - 1.0
    return replace(error, share=1.0 + change if change > 0.0 else 1.0 / (1.0 - change))


def _in_frame(objects: MovingBodies, number: int, frame: int) -> LinearError:
    parts, u = objects.bodies[number], objects.displacement(number, frame)
    turn = float(np.linalg.norm(cell_rotations(parts.mesh, u), axis=1).max(initial=0.0))
    share, longer = 1.0, 0.0
    if turn > SMALL_TURN:
        share, longer = _second_order(parts, frame, u)
    reach = float(np.linalg.norm(np.ptp(u, axis=0)))
    size = float(np.linalg.norm(np.ptp(parts.mesh.points, axis=0)))
    moved = float(np.linalg.norm(u, axis=1).max(initial=0.0))
    return LinearError(parts.body.name, frame, turn, moved, share, longer, reach, size)


def _second_order(parts: MeshedBody, frame: int, u: Float) -> tuple[float, float]:
    body, model = parts.body, build_model(parts)
    forced = any(isinstance(load, FORCES) and load.amplitude[frame] for load in body.loads)
    change = temperature(body, frame) or None
    return second_order(model, u, body.formulation, forced=forced, temperature=change)
