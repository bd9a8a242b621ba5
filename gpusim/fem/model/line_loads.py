"""Forces along lines of cell edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.fem.model.loads import vector
from gpusim.mesh import CELL_TYPES, Mesh
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import unmasked

__all__ = ["line_force", "node_line"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]

# Gauss points on [-1, 1]; the nodes of an edge are at -1, 1 and, if it has a midside node, 0
_PLACE = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_WEIGHT = np.array([5.0, 8.0, 5.0]) / 9.0
_SHAPE = {
    2: np.stack([0.5 * (1.0 - _PLACE), 0.5 * (1.0 + _PLACE)], axis=1),
    3: np.stack([0.5 * _PLACE * (_PLACE - 1), 0.5 * _PLACE * (_PLACE + 1), 1 - _PLACE**2], axis=1),
}
_SLOPE = {
    2: np.full((3, 2), [-0.5, 0.5]),
    3: np.stack([_PLACE - 0.5, _PLACE + 0.5, -2.0 * _PLACE], axis=1),
}


@unmasked()
@one_blas_thread()
def line_force(mesh: Mesh, nodes: npt.ArrayLike, total: npt.ArrayLike) -> Float:
    """``total`` (3,) spread uniformly over the length of the line through ``nodes``: (N,3).

    nodes : (K,) node numbers in any order. The line is made of the cell edges whose nodes are all
        among them; it may have several pieces but no branches, and each node must lie on it.
        Corners of a straight edge get 1/2 of its share; with a midside node 1/6, 1/6 and 2/3.

    Raises InputError if the nodes don't form a line.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> edge = gs.mesh.select_nodes(bar, bounds={"x_min": 2.0, "z_min": 1.0})
    >>> gs.fem.line_force(bar, edge, total=(0, 0, -10)).sum(axis=0)
    array([  0.,   0., -10.])
    """
    force = vector("line_force: total", total)
    edges = node_line(mesh, nodes)
    nodal = np.zeros(mesh.node_count)
    for width in (2, 3):
        own = edges[(edges[:, 2] >= 0) == (width == 3)][:, :width]
        points = mesh.points[own]
        points = points - points[:, :1]
        length = np.linalg.norm(np.einsum("eki,qk->eqi", points, _SLOPE[width]), axis=2) * _WEIGHT
        share = length @ _SHAPE[width]
        nodal += np.bincount(own.ravel(), share.ravel(), minlength=mesh.node_count)
    return np.asarray(nodal[:, None] * (force / nodal.sum()))


def node_line(mesh: Mesh, nodes: npt.ArrayLike) -> Int:
    """(E,3) edges (end, end, midside or -1) of the line through ``nodes``; see `line_force`."""
    given = np.asarray(nodes)
    if given.ndim != 1 or given.dtype.kind not in "iu" or not given.size:
        raise InputError(
            f"line_force: nodes; got shape {given.shape}, {given.dtype}; expected (K,) integer "
            "node numbers"
        )
    if given.min() < 0 or given.max() >= mesh.node_count:
        raise InputError(
            f"line_force: nodes; got {given.min()} … {given.max()}; "
            f"expected 0 … {mesh.node_count - 1}"
        )
    chosen = np.zeros(mesh.node_count, dtype=bool)
    chosen[given] = True
    edges = np.unique(_edges_between(mesh, chosen), axis=0)
    ends = np.bincount(edges[:, :2].ravel(), minlength=mesh.node_count)
    covered = np.zeros(mesh.node_count, dtype=bool)
    covered[edges[edges >= 0]] = True
    alone = np.flatnonzero(chosen & ~covered)
    if alone.size:
        raise InputError(
            f"line_force: {alone.size} nodes aren't joined to the others by a cell edge; got node "
            f"{alone[0]} at {mesh.points[alone[0]].tolist()}; expected the nodes of a line of edges"
        )
    branches = np.flatnonzero(ends > 2)
    if branches.size:
        raise InputError(
            f"line_force: the nodes form an area or branches, not a line; got {ends.max()} edges "
            f"at node {int(np.argmax(ends))}; expected at most two"
        )
    return edges


def _edges_between(mesh: Mesh, chosen: npt.NDArray[np.bool_]) -> Int:
    """(E,3) cell edges with all of their nodes chosen, ends ascending, midside or -1."""
    found = [np.zeros((0, 3), dtype=np.int32)]
    for kind, _, block in mesh.blocks():
        cell = CELL_TYPES[kind]
        middle = {frozenset(p): cell.corners + k for k, p in enumerate(cell.parents)}
        for a, b in cell.edges.tolist():
            between = middle.get(frozenset((a, b)))
            ends = np.sort(block[:, [a, b]], axis=1)
            keep = chosen[ends].all(axis=1)
            last = np.full(len(block), -1, dtype=np.int32)
            if between is not None:
                last = block[:, between]
                keep &= chosen[last]
            found.append(np.column_stack([ends, last])[keep])
    return np.concatenate(found)
