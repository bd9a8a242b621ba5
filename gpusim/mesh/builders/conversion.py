"""Meshes of other cell types from a mesh: midside nodes added, linear cells split."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.ragged import expand
from gpusim.errors import InputError
from gpusim.mesh.boundary import boundary_faces
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.mesh import Mesh
from gpusim.validation import require

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


def _mask(numbers: Int, count: int) -> Bool:
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


_WEDGES = np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]])
# Children of one cell: pyramids and wedges give fewer tets than hexahedra.
_TETS = {"hex8": 6, "wedge6": 3, "pyramid5": 2, "tet4": 1}


def split(mesh: Mesh, kind: str = "tet4") -> Mesh:
    """The same body in smaller cells: ``kind`` "tet4" or "wedge6"; nodes stay as they are.

    "tet4": a quadrilateral face is cut from its node of least number, so that neighbours of any
    linear type agree: six tets of a hex8, three of a wedge6, two of a pyramid5. "wedge6": two of
    each hex8, cut through its first two faces (the bottom and top of the builders' cells).

    Node sets stay; faces and cells of sets are replaced by their parts. Children of a cell are
    numbered next to each other, in the order of their parents.

    Raises
    ------
    InputError
        A quadratic cell (split first, then `quadratic`); a type that can't be split so; wedges
        whose cuts don't meet; cells so warped that a part of them has no volume.

    Examples
    --------
    >>> gs.mesh.split(gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1)), "tet4")
    Mesh(8 nodes, 6 tet4, 6 named sets)
    """
    require(kind in ("tet4", "wedge6"), "split: kind", repr(kind), "'tet4' or 'wedge6'")
    possible = _TETS if kind == "tet4" else {"hex8": 2}
    parts: list[Int] = []
    locals_: list[tuple[str, int, Int]] = []
    counts: list[Int] = []
    for name, first, block in mesh.blocks():
        if not len(block):
            continue
        if name not in possible:
            raise InputError(
                f"split: {len(block)} cells are {name}; expected cells among "
                f"{', '.join(possible)} to make {kind} of"
            )
        numbers = _tets(name, block) if kind == "tet4" else _WEDGES[None].repeat(len(block), axis=0)
        parts.append(
            block[np.arange(len(block))[:, None, None], numbers].reshape(-1, numbers.shape[2])
        )
        locals_.append((name, first, numbers.astype(np.int32)))
        counts.append(np.full(len(block), numbers.shape[1], dtype=np.int32))
    start = np.concatenate([[0], np.cumsum(np.concatenate(counts))])
    faces = {
        name: _child_faces(kind, locals_, pairs, start) for name, pairs in mesh.face_sets.items()
    }
    cells = {name: _children(numbers, start) for name, numbers in mesh.cell_sets.items()}
    result = Mesh(mesh.points, {kind: np.concatenate(parts)}, mesh.node_sets, faces, cells)
    if kind == "wedge6":
        _check_wedges(mesh, result)
    return result


def _children(numbers: Int, start: Long) -> Int:
    """All children of these cells, which are ``start[n]`` up to ``start[n + 1]``."""
    parent, child = expand(start[numbers + 1] - start[numbers])
    return (start[numbers][parent] + child).astype(np.int32)


def _tets(name: str, block: Int) -> Long:
    """(M, children, 4) local node numbers of the tets of each cell.

    Each joins the cell's node of least number, the apex, with half a face that doesn't have it.
    """
    faces = CELL_TYPES[name].faces
    children = np.empty((len(block), _TETS[name], 4), dtype=np.int64)
    least = block.argmin(axis=1)
    for apex in range(block.shape[1]):
        cells = np.flatnonzero(least == apex)
        child = 0
        for face in faces.tolist():
            ring = np.array([node for node in face if node >= 0])
            if apex in ring:
                continue
            turn = block[cells[:, None], ring].argmin(axis=1)
            turned = ring[(turn[:, None] + np.arange(len(ring))) % len(ring)]
            for second in range(1, len(ring) - 1):
                # a face runs counter-clockwise seen from outside; a tet's base, seen from its apex
                children[cells, child, 0] = turned[:, 0]
                children[cells, child, 1] = turned[:, second + 1]
                children[cells, child, 2] = turned[:, second]
                children[cells, child, 3] = apex
                child += 1
    return children


def _child_faces(kind: str, locals_: list[tuple[str, int, Int]], pairs: Int, start: Long) -> Int:
    """The faces of children that make up the given faces of their parents."""
    sides = CELL_TYPES[kind].faces
    found: list[Long] = [np.zeros((0, 2), dtype=np.int64)]
    for name, first, numbers in locals_:
        chosen = pairs[(pairs[:, 0] >= first) & (pairs[:, 0] < first + len(numbers))]
        parents = CELL_TYPES[name].faces
        mask = np.where(parents < 0, 0, 1 << np.maximum(parents, 0)).sum(axis=1)
        bits = 1 << numbers[chosen[:, 0] - first].astype(np.int64)  # (K, children, nodes)
        child = np.where(sides < 0, 0, bits[:, :, np.maximum(sides, 0)]).sum(axis=3)
        row, number, side = np.nonzero((child & ~mask[chosen[:, 1]][:, None, None]) == 0)
        found.append(np.stack([start[chosen[row, 0]] + number, side], axis=1))
    return np.concatenate(found).astype(np.int32)


def _check_wedges(mesh: Mesh, result: Mesh) -> None:
    """Cuts of neighbours that cross leave both halves of a face without a partner."""
    before, after = boundary_faces(mesh), boundary_faces(result)
    cut = int((before.local < 2).sum())
    if len(after) != len(before) + cut:
        raise InputError(
            f"split: the cuts of neighbouring wedges don't meet; got {len(after)} boundary faces; "
            f"expected {len(before) + cut}: a mesh whose hexahedra all stand on the same layer"
        )
