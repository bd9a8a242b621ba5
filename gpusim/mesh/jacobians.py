"""Jacobians of the map from a reference cell: where one isn't positive, a cell is inverted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.quadrature import FULL_POINTS, cell_rule
from gpusim.mesh.shape_functions import shape_gradients

__all__ = [
    "CELLS_IN_CACHE", "corner_edges", "corner_jacobians", "least_jacobian", "map_jacobians",
    "triple_product",
]  # fmt: skip

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]

# Cells looked at together: their temporaries stay in the cache.
CELLS_IN_CACHE = 8192


def corner_jacobians(kind: str, nodes: Float) -> Float:
    """Triple product of the three edges at each corner of the straight cell, (M,C).

    ``nodes`` is (M,k,3). All positive means that the cell isn't inverted at a corner. C = 8 for
    hexahedra, 6 wedges, 4 pyramids (the base), 1 tetrahedra.
    """
    return np.stack([triple_product(*edges) for edges in corner_edges(kind, nodes)], axis=1)


def least_jacobian(kind: str, points: Float, cells: Int) -> Float:
    """(M,) least Jacobian of each cell, <= 0 if it can't be used.

    Of a linear cell the least one at its corners; of a quadratic one the least determinant at the
    points of its full quadrature rule, where the stiffness is integrated.
    """
    least = np.empty(len(cells))
    for start in range(0, len(cells), CELLS_IN_CACHE):
        part = slice(start, start + CELLS_IN_CACHE)
        nodes = points[cells[part]]
        if CELL_TYPES[kind].linear == kind:
            least[part] = corner_jacobians(kind, nodes).min(axis=1)
        else:
            place, _ = cell_rule(kind, FULL_POINTS[kind])
            determinant, _ = map_jacobians(kind, nodes, place)
            least[part] = determinant.min(axis=1)
    return least


def corner_edges(kind: str, nodes: Float) -> list[list[tuple[Float, Float, Float]]]:
    """Per corner its three edges, each as components (M,): contiguous, and no np.cross."""
    neighbours = CELL_TYPES[kind].corner_neighbours
    place = np.ascontiguousarray(nodes[:, : CELL_TYPES[kind].corners].transpose(1, 2, 0))
    corners = []
    for corner, others in enumerate(neighbours.tolist()):
        edges = [place[other] - place[corner] for other in others]
        corners.append([(edge[0], edge[1], edge[2]) for edge in edges])
    return corners


def triple_product(
    a: tuple[Float, Float, Float], b: tuple[Float, Float, Float], c: tuple[Float, Float, Float]
) -> Float:
    """(a x b) . c by components."""
    return (
        (a[1] * b[2] - a[2] * b[1]) * c[0]
        + (a[2] * b[0] - a[0] * b[2]) * c[1]
        + (a[0] * b[1] - a[1] * b[0]) * c[2]
    )


def map_jacobians(kind: str, nodes: Float, place: Float) -> tuple[Float, Float]:
    """(M,Q) determinants of d x / d xi at reference points, and the product of column lengths."""
    table = shape_gradients(kind, place)
    points, width = table.shape[:2]
    local = nodes - nodes[:, :1]
    flat = local.transpose(0, 2, 1).reshape(-1, width)
    columns = (flat @ table.transpose(1, 0, 2).reshape(width, -1)).reshape(-1, 3, points, 3)
    a, b, c = ((columns[:, 0, :, j], columns[:, 1, :, j], columns[:, 2, :, j]) for j in range(3))
    lengths = np.prod([np.sqrt(x * x + y * y + z * z) for x, y, z in (a, b, c)], axis=0)
    return triple_product(a, b, c), lengths
