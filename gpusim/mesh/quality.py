"""Jacobians of the map from a reference cell, and what they say of a cell's quality.

Where a Jacobian isn't positive, a cell is inverted. Also aspect ratio, distortion, and the cells
that are bad, by number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.field_summary import field_summary
from gpusim.mesh.boundary import boundary_faces
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.quadrature import FULL_POINTS, cell_rule
from gpusim.mesh.shape_functions import reference_nodes, shape_gradients

if TYPE_CHECKING:
    from gpusim.mesh.mesh import Mesh

# Cells looked at together: their temporaries stay in the cache.
CELLS_IN_CACHE = 8192


def least_jacobian(kind: str, points: Float, cells: Int) -> Float:
    """(M,) least Jacobian of each cell, <= 0 if it can't be used.

    Of a linear cell the least one at its corners, of the three edges there (not at a pyramid's
    apex; one of a tetrahedron stands for all); of a quadratic one the least determinant at the
    points of its full quadrature rule, where the stiffness is integrated.
    """
    least = np.empty(len(cells))
    for start in range(0, len(cells), CELLS_IN_CACHE):
        part = slice(start, start + CELLS_IN_CACHE)
        nodes = points[cells[part]]
        if CELL_TYPES[kind].linear == kind:
            corners = [triple_product(*edges) for edges in corner_edges(kind, nodes)]
            least[part] = np.min(corners, axis=0)
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


# Distortion from which incompatible hexahedra lose more than about a sixth of their deflection in
# bending: measured on trapezoidal cells of MacNeal & Harder's beam, cubes, bars and plates.
_DISTORTED = 1.0


@dataclass(frozen=True)
class Quality:
    """Per cell, in global cell order.

    ``scaled_jacobian`` (M,): least corner Jacobian over the product of the lengths of its three
    columns (1 for a brick; 1/sqrt(2) for a regular tetrahedron, 0.866 for a regular prism; <= 0
    inverted). Quadratic cells: of the curved map, at corners and quadrature points alike.
    ``aspect`` (M,): longest over shortest edge between corners.
    ``distortion`` (M,): of hexahedra the greatest difference of opposite edges (vectors) over their
    mean length, times the aspect: 0 for a parallelepiped, however stretched or sheared; in slender
    or flat cells a small lean of the sides counts. 0 for other types.
    ``bricks`` (M,): which cells are hex8, the type that distortion hurts most.
    ``gaps`` (K,): numbers of cells with a quadrilateral side that lies against triangles of others,
    without pyramids between: they share the corners, but come apart inside.

    Examples
    --------
    >>> quality = gs.mesh.mesh_quality(gs.mesh.box(size=(4, 1, 1), divisions=(2, 1, 1)))
    >>> quality.scaled_jacobian, quality.aspect
    (array([1., 1.]), array([2., 2.]))
    """

    scaled_jacobian: Float
    aspect: Float
    distortion: Float
    bricks: Bool
    gaps: Long
    __repr__ = field_summary

    def bad_cells(self, least_jacobian: float = 0.1, most_aspect: float = 1000.0) -> Long:
        """Numbers of the cells outside these limits, worst Jacobian first."""
        wrong = np.flatnonzero(
            ~((self.scaled_jacobian >= least_jacobian) & (self.aspect <= most_aspect))
        )
        return wrong[np.argsort(self.scaled_jacobian[wrong], kind="stable")]

    def distorted_bricks(self) -> Long:
        """Numbers of the hex8 cells that are far from a parallelepiped."""
        return np.flatnonzero(self.bricks & ~(self.distortion <= _DISTORTED))

    def describe(self) -> str:
        """One line for a report."""
        bad = self.bad_cells()
        text = (
            f"{len(self.aspect)} cells, least scaled Jacobian {self.scaled_jacobian.min():.3f}, "
            f"greatest aspect {self.aspect.max():.3g}, {len(bad)} bad"
        )
        bent = len(self.distorted_bricks())
        if bent:
            text += (
                f"; {bent} of {int(self.bricks.sum())} hex8 are strongly distorted and too stiff "
                "in bending: hex20 is the robust choice there"
            )
        if len(self.gaps):
            text += (
                f"; {len(self.gaps)} cells, such as {self.gaps[0]}, lie with a quadrilateral side "
                "against triangles and come apart there: put pyramids between"
            )
        return text


def mesh_quality(mesh: Mesh) -> Quality:
    """Scaled Jacobian, aspect ratio and distortion of every cell.

    Examples
    --------
    >>> gs.mesh.mesh_quality(gs.mesh.box(size=(4, 1, 1), divisions=(2, 1, 1))).aspect
    array([2., 2.])
    """
    jacobian = np.empty(mesh.cell_count)
    aspect = np.empty(mesh.cell_count)
    distortion = np.zeros(mesh.cell_count)
    bricks = np.zeros(mesh.cell_count, dtype=bool)
    for kind, first, block in mesh.blocks():
        bricks[first : first + len(block)] = kind == "hex8"
        for start in range(0, len(block), CELLS_IN_CACHE):
            nodes = mesh.points[block[start : start + CELLS_IN_CACHE]]
            part = slice(first + start, first + start + len(nodes))
            jacobian[part] = _scaled_jacobian(kind, nodes)
            edges = CELL_TYPES[kind].edges
            sides = nodes[:, edges[:, 1]] - nodes[:, edges[:, 0]]
            length = np.sqrt((sides**2).sum(axis=2))
            longest = length.max(axis=1)
            # two corners in one place: as bad as it gets, and no division by zero
            shortest = np.maximum(length.min(axis=1), np.finfo(float).tiny)
            aspect[part] = longest / shortest
            if CELL_TYPES[kind].linear == "hex8":
                distortion[part] = _opposite(sides) * aspect[part]
    return Quality(jacobian, aspect, distortion, bricks, _gaps(mesh))


def _gaps(mesh: Mesh) -> Long:
    """Cells with a boundary quadrilateral that has three corners with a boundary triangle."""
    if len({CELL_TYPES[kind].linear for kind, _, _ in mesh.blocks()}) == 1:
        return np.zeros(0, dtype=np.int64)
    faces = boundary_faces(mesh)
    corners = np.sort(faces.nodes[:, :4].astype(np.int64), axis=1)  # -1 of a triangle comes first
    triangles = corners[faces.is_triangle, 1:]
    sides, cell = corners[~faces.is_triangle], faces.cell[~faces.is_triangle]
    parts = np.concatenate([np.delete(sides, k, axis=1) for k in range(4)])
    _, number = np.unique(np.concatenate([triangles, parts]), axis=0, return_inverse=True)
    number = number.reshape(-1)
    against = np.isin(number[len(triangles) :], number[: len(triangles)])
    return np.unique(np.tile(cell, 4)[against]).astype(np.int64)


# Edges of a hexahedron that are parallel in a parallelepiped, and the signs that align them.
_PARALLEL = np.array([[0, 2, 4, 6], [1, 3, 5, 7], [8, 9, 10, 11]])
_ALIGN = np.array([[1, -1, 1, -1], [1, -1, 1, -1], [1, 1, 1, 1]])


def _opposite(sides: Float) -> Float:
    """(M,) greatest difference of parallel edges over their mean length; (M,12,3) edges."""
    worst = np.zeros(len(sides))
    for group, signs in zip(_PARALLEL, _ALIGN, strict=True):
        edges = np.ascontiguousarray((sides[:, group] * signs[:, None]).transpose(1, 2, 0))
        mean = np.sqrt((edges.mean(axis=0) ** 2).sum(axis=0))
        for one, two in ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)):
            differ = np.sqrt(((edges[one] - edges[two]) ** 2).sum(axis=0))
            worst = np.maximum(worst, _ratio(differ, mean))
    return worst


def _scaled_jacobian(kind: str, nodes: Float) -> Float:
    """(M,) least Jacobian over the product of its columns' lengths."""
    if CELL_TYPES[kind].linear == kind:
        worst = np.full(len(nodes), np.inf)
        for edges in corner_edges(kind, nodes):
            lengths = np.prod([np.sqrt(x * x + y * y + z * z) for x, y, z in edges], axis=0)
            worst = np.minimum(worst, _ratio(triple_product(*edges), lengths))
        return worst
    corners = reference_nodes(kind)[: len(CELL_TYPES[kind].corner_neighbours)]
    if CELL_TYPES[kind].linear == "tet4":
        corners = reference_nodes(kind)[:4]
    place = np.concatenate([corners, cell_rule(kind, FULL_POINTS[kind])[0]])
    determinant, lengths = map_jacobians(kind, nodes, place)
    return np.asarray(_ratio(determinant, lengths).min(axis=1))


def _ratio(value: Float, scale: Float) -> Float:
    return np.asarray(np.divide(value, scale, out=np.zeros_like(value), where=scale > 0.0))
