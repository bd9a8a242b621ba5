"""How far linear statics is off where a body turns: an estimate from the linear solution.

For a slender body under forces that keep their direction, the potential of an inextensible bar to
fourth order in its rotation w gives displacements that are less than the linear ones by the share
2 <w^2>, the mean of w^2 weighted by the strain energy: a quarter because the bar keeps its length,
three because the forces' arms get shorter (of a cantilever with a force F at its tip, that is
(4/35) (F L^2 / E I)^2, as for the elastica). Without forces (heat, given displacements) the arms
don't matter, and a bar of constant curvature has <w^2> / 4, weighted by volume. What stress along
the bar does beside, pressing or pulling, is of first order: the work of the stress on the
rotations over that of the forces. 1 / sqrt(1 + 2 x) goes on from the first order x as the elastica
does: within 9 % of its error up to F L^2 / E I = 3, where linear theory is 66 % too far.

A bar that turns by w is also drawn longer by w^2 / 2, which an exact solution isn't.

Bodies held at both ends also stiffen because they are stretched; that isn't in the estimate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim import fem
from gpusim.arrays.array_types import Float
from gpusim.mesh import CELL_TYPES, Mesh
from gpusim.mesh.shape_functions import reference_nodes, shape_gradients
from gpusim.pipeline.scene_objects.modelling import build_model, temperature
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies
from gpusim.pipeline.scene_objects.surfaces import MeshedBody
from gpusim.scene.description import model as m

SMALL_TURN = 0.02  # rad: at most 0.08 % of the displacement, which takes no further look
TOLD = 0.005
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
    """Of one body, in the frame in which it moves most.

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
        if not self.turn > SMALL_TURN:
            return f"{turn}displacements are less than 0.1 % off"
        return f"{turn}{self._off} of {1e3 * self.moved:.4g} mm"

    @property
    def _off(self) -> str:
        off = self.moved * (1.0 - self.share)
        way = "too large" if off > 0.0 else "too small"
        percent = 100.0 * abs(1.0 / self.share - 1.0)
        return f"displacements are about {1e3 * abs(off):.2g} mm ({percent:.2g} %) {way}"

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
        elif not abs(1.0 / self.share - 1.0) > TOLD:
            return ""
        return (
            f"{text}turns by up to {np.degrees(self.turn):.3g} degrees in frame {self.frame}; by "
            f"linear statics its {self._off}, of {1e3 * self.moved:.4g} mm, and it gets about "
            f"{1e3 * self.longer * self.size:.2g} mm too long"
        )


def linear_errors(objects: MovingBodies) -> list[LinearError]:
    """One per body; all were solved for."""
    found = []
    for i, parts in enumerate(objects.bodies):
        reach = [
            float(np.linalg.norm(np.ptp(objects.displacement(i, frame), axis=0)))
            for frame in range(len(objects.frames))
        ]
        frame = int(np.argmax(reach))
        u = objects.displacement(i, frame)
        turn = float(np.linalg.norm(cell_rotations(parts.mesh, u), axis=1).max(initial=0.0))
        share, longer = 1.0, 0.0
        if turn > SMALL_TURN:
            share, longer = _second_order(parts, frame, u)
        size = float(np.linalg.norm(np.ptp(parts.mesh.points, axis=0)))
        moved = float(np.linalg.norm(u, axis=1).max(initial=0.0))
        found.append(
            LinearError(parts.body.name, frame, turn, moved, share, longer, reach[frame], size)
        )
    return found


def _second_order(parts: MeshedBody, frame: int, u: Float) -> tuple[float, float]:
    body, model = parts.body, build_model(parts)
    forced = any(isinstance(load, FORCES) and load.amplitude[frame] for load in body.loads)
    change = temperature(body, frame) or None
    return second_order(model, u, body.formulation, forced=forced, temperature=change)


def second_order(
    model: fem.Model,
    u: Float,
    formulation: str,
    *,
    forced: bool = True,
    temperature: float | None = None,
) -> tuple[float, float]:
    """What an exact solution has of the linear displacements ``u`` (N, 3), about (above 0), and
    the mean strain by which they make the body too long.

    ``forced``: forces act, not heat or given displacements alone.
    """
    turn = cell_rotations(model.mesh, u)
    square = np.einsum("mi,mi->m", turn, turn)
    found = fem.stress(model, u, formulation, temperature=temperature)
    weight = found.energy if forced else found.volume
    total = float(weight.sum())
    if not total > 0.0:
        return 1.0, 0.0
    loss = (2.0 if forced else 0.25) * float(square @ weight) / total
    pressed = _pressed(found, turn, square) if forced else 0.0
    bent = 1.0 / np.sqrt(1.0 + 2.0 * loss)
    longer = 0.5 * bent**2 * float(square @ found.volume) / float(found.volume.sum())
    return float(bent / max(1.0 - pressed, 0.1)), float(longer)


def _pressed(found: fem.Stress, turn: Float, square: Float) -> float:
    """Share that displacements grow by, to first order, where the stress presses along the body."""
    xx, yy, zz, xy, yz, zx = found.cell.T
    x, y, z = turn.T
    own = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + yz * y * z + zx * z * x)
    work = (square * (xx + yy + zz) - own) @ found.volume
    return float(-work / (2.0 * found.energy.sum()))


def cell_rotations(mesh: Mesh, u: Float) -> Float:
    """Rotation vectors (M, 3) in rad at the middle of each cell: half the curl of ``u`` (N, 3)."""
    result = np.empty((mesh.cell_count, 3))
    for kind, first, block in mesh.blocks():
        middle = reference_nodes(CELL_TYPES[kind].linear).mean(axis=0)[None]
        slope = shape_gradients(kind, middle)[0]
        jacobian = np.einsum("mki,kj->mij", mesh.points[block], slope)
        gradient = np.einsum("mki,kj->mij", u[block], slope) @ np.linalg.inv(jacobian)
        skew = 0.5 * (gradient - gradient.transpose(0, 2, 1))
        result[first : first + len(block)] = skew[:, [2, 0, 1], [1, 2, 0]]
    return result
