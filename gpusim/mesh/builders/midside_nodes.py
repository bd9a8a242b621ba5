"""From a linear mesh to a quadratic one: shared midside nodes on straight edges."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.mesh import Mesh

__all__ = ["quadratic"]

Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]
Float = npt.NDArray[np.float64]

_SERENDIPITY = {"hex8": "hex20", "tet4": "tet10", "wedge6": "wedge15", "pyramid5": "pyramid13"}
_LAGRANGE = {"hex8": "hex27", "tet4": "tet10"}


def quadratic(mesh: Mesh, serendipity: bool = True) -> Mesh:
    """The same cells with second-order shape functions; geometry unchanged.

    Parameters
    ----------
    mesh
        Linear cells only.
    serendipity
        hex8 becomes hex20, tet4 tet10, wedge6 wedge15, pyramid5 pyramid13. False makes hex27 of
        hex8 (nodes in the faces and the cell as well) and tet10 of tet4; the other two types have
        no partner for a nine-node face then.

    Old nodes keep their numbers; new ones follow: those of edges, of faces, of cells, each at the
    mean of its corners and shared by all cells around it. Cell numbers and face and cell sets stay
    as they are. A new node joins a node set if all its corners are in it.

    Raises
    ------
    InputError
        A cell that is quadratic already, or one that has no partner of that kind.

    Examples
    --------
    >>> gs.mesh.quadratic(gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1)))
    Mesh(20 nodes, 1 hex20, 6 named sets)
    """
    names = _SERENDIPITY if serendipity else _LAGRANGE
    for kind, _, block in mesh.blocks():
        if kind not in names and len(block):
            what = "is quadratic already" if CELL_TYPES[kind].linear != kind else "has no partner"
            raise InputError(
                f"quadratic: {kind}, of which there are {len(block)}, {what}; "
                f"expected cells among {', '.join(names)}"
            )
    points: list[Float] = [mesh.points]
    members = {name: [_mask(numbers, mesh.node_count)] for name, numbers in mesh.node_sets.items()}
    columns: dict[str, list[Int]] = {
        kind: [block] for kind, _, block in mesh.blocks() if len(block)
    }
    total = mesh.node_count
    for width in (2, 4, 8):  # edges, faces, cells: the order of every type's nodes
        corners, owners = _corners(columns, names, width)
        if not len(corners):
            continue
        rows, number = _distinct(corners, mesh.node_count)
        points.append(mesh.points[rows].mean(axis=1))
        for parts in members.values():
            parts.append(np.asarray(parts[0][rows].all(axis=1)))
        start = 0
        for kind, per_cell in owners:
            count = len(columns[kind][0]) * per_cell
            new = (number[start : start + count] + total).astype(np.int32)
            columns[kind].append(new.reshape(-1, per_cell))
            start += count
        total += len(rows)
    cells = {names[kind]: np.concatenate(parts, axis=1) for kind, parts in columns.items()}
    return Mesh(
        np.concatenate(points),
        cells,
        {
            name: np.flatnonzero(np.concatenate(parts)).astype(np.int32)
            for name, parts in members.items()
        },
        mesh.face_sets,
        mesh.cell_sets,
    )


def _mask(numbers: Int, count: int) -> npt.NDArray[np.bool_]:
    mask = np.zeros(count, dtype=bool)
    mask[numbers] = True
    return mask


def _corners(
    columns: dict[str, list[Int]], names: dict[str, str], width: int
) -> tuple[Int, list[tuple[str, int]]]:
    """Sorted corner numbers (K,width) of every new node with that many, and whose they are."""
    parts: list[Int] = []
    owners: list[tuple[str, int]] = []
    for kind, block in columns.items():
        wanted = [row for row in CELL_TYPES[names[kind]].parents if len(row) == width]
        if wanted:
            parts.append(block[0][:, np.array(wanted)].reshape(-1, width))
            owners.append((kind, len(wanted)))
    empty = np.zeros((0, width), dtype=np.int32)
    return (np.sort(np.concatenate(parts), axis=1) if parts else empty), owners


def _distinct(rows: Int, limit: int) -> tuple[Int, Long]:
    """Different rows, and for each given row the number of its like. Columns are folded into one
    64-bit key, a pair at a time."""
    if rows.shape[1] == 8:  # a cell has its centre to itself
        return rows, np.arange(len(rows), dtype=np.int64)
    # two corners name an edge; three, the least ones, name a face
    key = rows[:, 0].astype(np.int64) * limit + rows[:, 1]
    if rows.shape[1] == 4:
        _, short = np.unique(key, return_inverse=True)
        key = short.astype(np.int64) * limit + rows[:, 2]
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    return rows[first], number.astype(np.int64)
