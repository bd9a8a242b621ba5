"""Forces, energy and stress of the last loaded frame, for the report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gpusim.pipeline.build.solution_store import SceneSolution
from gpusim.report import BodyForce, Mechanics, StressPeak
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory

__all__ = ["make_mechanics"]


def make_mechanics(
    scene: Scene, solved: SceneSolution, history: LoadHistory, stresses: Sequence[StressPeak]
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
