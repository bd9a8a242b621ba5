"""Where cameras stand that see a side of a body whole."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera

_WEAK = 1e-6
"""What the fallback counts beside axes that meet: those at 1 degree count 150 times as much."""


@dataclass(frozen=True, eq=False)
class Side:
    """A side of a body, as a camera has it that looks squarely at it.

    ``axes`` (3, 3): right, down and forward of its picture in the world, one a row. ``box`` (2, 3)
    m: the least and the most that the body has along them.

    Examples
    --------
    >>> from gpusim.optics.camera.standpoint import Side
    >>> block = gs.mesh.box(size=(0.4, 0.2, 0.1), divisions=(2, 2, 1))
    >>> top = Side.of([block.points], np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    >>> top.size.round(6), top.middle.round(6)
    (array([0.4, 0.2, 0.1]), array([0.2 , 0.1 , 0.05]))
    """

    axes: Float
    box: Float

    @classmethod
    def of(cls, shown: Iterable[Float], normal: Float, up: Float) -> Side:
        """That which faces along a ``normal`` (3,) of all that is ``shown``, points (n, 3) m, with
        ``up`` (3,) upwards in the picture."""
        right = np.cross(up, normal)
        right /= np.linalg.norm(right)
        axes = np.stack([right, np.cross(right, normal), -normal])
        along = (points @ axes.T for points in shown)
        spans = np.array([(points.min(axis=0), points.max(axis=0)) for points in along])
        return cls(axes, np.stack([spans[:, 0].min(axis=0), spans[:, 1].max(axis=0)]))

    @property
    def size(self) -> Float:
        """(3,) m: of the box."""
        return np.asarray(np.ptp(self.box, axis=0))

    @property
    def middle(self) -> Float:
        """(3,) m, world: of the box."""
        return np.asarray(self.box.mean(axis=0) @ self.axes)

    def pixel(self, camera: Camera, filled: float) -> float:
        """m: a pixel on a side that takes a share ``filled`` of the picture's width or height."""
        return float((self.size[:2] / (camera.width, camera.height)).max()) / filled

    def distance(self, camera: Camera, filled: float) -> float:
        """m: from such a camera to the middle, the front taking a share ``filled``."""
        return float(camera.K[0, 0] * self.pixel(camera, filled) + 0.5 * self.size[2])


def rig_before(side: Side, cameras: Sequence[Camera], filled: float) -> list[Camera]:
    """A rig moved before a side, its cameras as they stand to each other.

    The side's middle comes where the cameras' axes come nearest to each other; if they are
    parallel, or one alone, where the side takes a share ``filled`` of the first one's picture.

    Examples
    --------
    >>> from gpusim.optics.camera.standpoint import Side, rig_before
    >>> block = gs.mesh.box(size=(0.4, 0.2, 0.1), divisions=(2, 2, 1))
    >>> top = Side.of([block.points], np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0]))
    >>> lens = gs.Camera(400, 300, [[1000, 0, 199.5], [0, 1000, 149.5], [0, 0, 1]])
    >>> rig_before(top, [lens], filled=0.8)[0].eye.round(3)
    array([0.2 , 0.1 , 1.35])
    """
    forward = np.array([one.camera_from_world[2, :3] for one in cameras])
    eyes, z = np.array([one.eye for one in cameras]), forward.mean(axis=0)
    across = np.eye(3) - forward[:, :, None] * forward[:, None, :]
    alone = eyes.mean(axis=0) + side.distance(cameras[0], filled) * z
    right = (across @ eyes[:, :, None]).sum(axis=0)[:, 0] + _WEAK * alone
    point = np.linalg.solve(across.sum(axis=0) + _WEAK * np.eye(3), right)
    x = np.cross(np.sum([one.camera_from_world[1, :3] for one in cameras], axis=0), z)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    rig_from_world = np.eye(4)
    rig_from_world[:3, :3] = turn = np.stack([x, np.cross(z, x), z]).T @ side.axes
    rig_from_world[:3, 3] = point - turn @ side.middle
    return [replace(one, camera_from_world=one.camera_from_world @ rig_from_world)
            for one in cameras]  # fmt: skip
