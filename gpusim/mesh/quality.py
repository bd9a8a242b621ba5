"""Cell quality: corner Jacobians, aspect ratio, and the cells that are bad, by number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.mesh.cells import CELL_TYPES
from gpusim.mesh.mesh import Mesh

__all__ = ["Quality", "corner_jacobians", "mesh_quality"]

Float = npt.NDArray[np.float64]

_HEX_EDGES = np.array(
    [
        [0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6],
        [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7],
    ]
)  # fmt: skip
_TET_EDGES = np.array([[0, 1], [1, 2], [2, 0], [0, 3], [1, 3], [2, 3]])
_EDGES = {"hex8": _HEX_EDGES, "tet4": _TET_EDGES}


@dataclass(frozen=True)
class Quality:
    """Per cell, in global cell order.

    ``scaled_jacobian`` (M,): least corner Jacobian over the product of its three edge lengths
    (hex8: 1 for a brick, <= 0 inverted; tet4: 1/sqrt(2) for a regular one).
    ``aspect`` (M,): longest edge over shortest edge.
    """

    scaled_jacobian: Float
    aspect: Float

    def bad_cells(
        self, least_jacobian: float = 0.1, most_aspect: float = 1000.0
    ) -> npt.NDArray[np.int64]:
        """Numbers of the cells outside these limits, worst Jacobian first."""
        wrong = np.flatnonzero(
            ~((self.scaled_jacobian >= least_jacobian) & (self.aspect <= most_aspect))
        )
        return wrong[np.argsort(self.scaled_jacobian[wrong], kind="stable")]

    def describe(self) -> str:
        """One line for a report."""
        bad = self.bad_cells()
        return (
            f"{len(self.aspect)} cells, least scaled Jacobian {self.scaled_jacobian.min():.3f}, "
            f"greatest aspect {self.aspect.max():.3g}, {len(bad)} bad"
        )


def corner_jacobians(kind: str, nodes: Float) -> Float:
    """Triple product of the three edges at each corner: (M,8) for hex8, (M,1) for tet4.

    ``nodes`` is (M,k,3). All positive means that the cell isn't inverted at a corner.
    """
    neighbours = CELL_TYPES[kind].corner_neighbours
    corners = np.arange(len(neighbours))
    edges = nodes[:, neighbours, :] - nodes[:, corners, None, :]
    cross = np.cross(edges[:, :, 0], edges[:, :, 1])
    return np.asarray(np.einsum("mci,mci->mc", cross, edges[:, :, 2]))


def mesh_quality(mesh: Mesh) -> Quality:
    """Scaled Jacobian and aspect ratio of every cell."""
    jacobians: list[Float] = []
    aspects: list[Float] = []
    for kind, _, block in mesh.blocks():
        nodes = mesh.points[block]
        neighbours = CELL_TYPES[kind].corner_neighbours
        corners = np.arange(len(neighbours))
        edges = nodes[:, neighbours, :] - nodes[:, corners, None, :]
        lengths = np.linalg.norm(edges, axis=3).prod(axis=2)
        jacobians.append((corner_jacobians(kind, nodes) / lengths).min(axis=1))
        pairs = _EDGES[kind]
        sides = np.linalg.norm(nodes[:, pairs[:, 1]] - nodes[:, pairs[:, 0]], axis=2)
        aspects.append(sides.max(axis=1) / sides.min(axis=1))
    return Quality(np.concatenate(jacobians), np.concatenate(aspects))
