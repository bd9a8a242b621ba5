"""Forces, energy and stress of the last loaded frame, for the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.pipeline.solved import Solved
from gpusim.report import BodyForce, Mechanics, MeshSummary, StressPeak
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory

__all__ = ["large_displacements", "make_mechanics"]

_LARGE = 0.1
"""Share of a body's size; a cantilever bent that far is 1 % off, and errors grow as its square."""


def make_mechanics(
    scene: Scene, solved: Solved, history: LoadHistory, stresses: Sequence[StressPeak]
) -> Mechanics:
    """Of the last frame in which something has moved; linear, so load groups add up."""
    moving = [frame for frame in range(history.frames) if not history.still(frame)]
    last = moving[-1] if moving else history.frames - 1
    reactions, loads = [], []
    rows = zip(scene.bodies, solved.reactions, solved.applied, history.weights(last), strict=True)
    for body, held, applied, weights in rows:
        forces = np.tensordot(np.array(weights), held, axes=1)
        for support, (x, y, z) in zip(body.supports, forces.tolist(), strict=False):
            reactions.append(BodyForce(body.name, support.name, (x, y, z)))
        x, y, z = (np.array(weights) @ applied).tolist()
        loads.append(BodyForce(body.name, "loads", (x, y, z)))
    return Mechanics(last, solved.energy_balance, tuple(reactions), tuple(loads), tuple(stresses))


def large_displacements(
    solved: Solved, history: LoadHistory, meshes: Sequence[MeshSummary]
) -> list[str]:
    """One warning per solved body that moves, within itself, too far for linear statics."""
    warnings = []
    for i, (mesh, u) in enumerate(zip(meshes, solved.u, strict=True)):
        size = mesh.extent
        reach = [
            float(np.linalg.norm(np.ptp(np.tensordot(weights[i], u, axes=1), axis=0)))
            for weights in (history.weights(frame) for frame in range(history.frames))
        ]
        frame = int(np.argmax(reach))
        if not reach[frame] <= _LARGE * size:
            warnings.append(
                f"body {mesh.body!r}: displacements differ by {1e3 * reach[frame]:.3g} mm "
                f"in frame {frame}, {100 * reach[frame] / size:.3g} % of its size; linear statics "
                "holds for small ones only: are units, loads and moduli meant so?"
            )
    return warnings
