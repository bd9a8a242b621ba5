"""A kind of motion that gpusim doesn't have: bodies turn rigidly about the y axis, by the load
factor as an angle (rad)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import cos, sin
from typing import Literal

import numpy as np
import numpy.typing as npt

from gpusim.graph.runner import Inputs
from gpusim.graph.session import Session
from gpusim.graph.stage import Stage, first
from gpusim.motion import State
from gpusim.plan.stage_builder import StageBuilder
from gpusim.scene import Scene
from gpusim.scene.analyses import AnalysisKind, States, add_analysis
from gpusim.scene.description.analysis.statics import StaticTable

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Swing:
    """Of ``points`` (N, 3) m at rest."""

    points: Float

    def displacement(self, state: State) -> Float:
        (angle,) = state
        x, _, z = self.points.T
        moved = [x * cos(angle) + z * sin(angle) - x, 0.0 * x, z * cos(angle) - x * sin(angle) - z]
        return np.stack(moved, axis=1)

    def reactions(self, state: State) -> Float:
        return np.zeros((0, 3))


def motion(scene: Scene, inputs: Inputs, session: Session) -> Swing:
    """Of one body."""
    return Swing(inputs[f"mesh/{inputs.row}"].mesh.points)


def angles(scene: Scene, scaled: bool) -> Sequence[States]:
    """Of every body in every frame; None where it hangs still."""
    states = [(angle,) if angle else None for angle in scene.analysis.load_factors]
    return [states for _ in scene.bodies]


def swing_stages(build: StageBuilder) -> Iterator[Stage]:
    for name in build.bodies:
        yield build.stage(f"motion/{name}", f"{__name__}:motion", [], {f"mesh/{name}": first},
                          [name])  # fmt: skip


class SwingTable(StaticTable):
    """Bodies swing by their load factor."""

    type: Literal["swing"]  # type: ignore[assignment]
    about = "rigid"


add_analysis(
    "swing",
    AnalysisKind(SwingTable, angles, f"{__name__}:swing_stages", unsolved="bodies only swing"),
)
