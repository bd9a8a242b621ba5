"""What stands in front of the cameras: bodies and props, and where they are in each frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from gpusim.pipeline.build.build import BodyParts
from gpusim.pipeline.build.props import posed
from gpusim.pipeline.build.solution_store import SceneSolution
from gpusim.scene import Scene
from gpusim.scene.amplitudes import LoadHistory
from gpusim.surface import Surface

__all__ = ["SceneObjects", "frame_word"]


@dataclass
class SceneObjects:
    """Bodies and props as they were built; ``solved`` once there is a solution."""

    scene: Scene
    history: LoadHistory
    bodies: list[BodyParts] = field(default_factory=list)
    props: list[Surface] = field(default_factory=list)
    solved: SceneSolution | None = None

    def displacement(self, body: int, frame: int | None) -> npt.NDArray[np.float64]:
        """Nodal displacements (N, 3) of a body in a frame; linear, so load groups add up."""
        given = self.bodies[body].field
        if given is not None and frame is not None:
            return given.at(self.history.factors[frame])
        if self.solved is None:
            return np.zeros((self.bodies[body].mesh.node_count, 3))
        weights = np.array(self.history.weights(frame)[body])
        return np.asarray(np.tensordot(weights, self.solved.u[body], axes=1))

    def surfaces(self, frame: int | None) -> list[Surface]:
        """Every surface in a frame, bodies first; for None unloaded, and props as they stand."""
        bodies = [parts.surface for parts in self.bodies]
        if not self.history.unloaded(frame):
            bodies = [
                parts.skin.moved(parts.surface, self.displacement(i, frame))
                for i, parts in enumerate(self.bodies)
            ]
        calibration = self.scene.calibration
        props = [
            posed(surface, prop, prop.poses[frame] if prop.poses and frame is not None else None)
            for prop, surface in zip(self.scene.props, self.props, strict=True)
            if calibration is None or prop.name != calibration.board
        ]
        return bodies + props

    def target(self, pose: int | None) -> list[Surface]:
        """What the images of a calibration show: the board in a pose, and props beside it."""
        calibration = self.scene.calibration
        assert calibration is not None and pose is not None
        shown = {calibration.board: calibration.poses[pose]}
        return [
            posed(surface, prop, shown.get(prop.name))
            for prop, surface in zip(self.scene.props, self.props, strict=True)
            if prop.name in shown or prop.name in calibration.show
        ]


def frame_word(scene: Scene) -> str:
    """What the numbers are that a scene has one of per frame."""
    return "time" if scene.analysis.type == "field" else "load_factor"
