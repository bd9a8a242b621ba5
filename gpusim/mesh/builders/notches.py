"""Notches: slots of given position, width and depth, cut from a mesh along its cell borders.

Node coordinates along an axis are exact at every break, fine where asked, growing in between.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int
from gpusim.errors import InputError
from gpusim.mesh.boundary import boundary_faces
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.selection import extents
from gpusim.validation import count_of, require, require_one_of

_GROWTH = 0.25  # the size grows by a quarter of the distance: neighbours differ by about 1.28
_SAMPLES = 4000


def stepped_axis(breaks: Sequence[float], size: float, fixed: Mapping[int, int]) -> Float:
    """Coordinates (K,) that meet every break exactly; about ``size`` apart in each piece, or with
    the count of steps that ``fixed`` gives for the piece's number."""
    parts: list[Float] = []
    for number, (start, end) in enumerate(pairwise(breaks)):
        count = fixed.get(number) or max(1, round((end - start) / size))
        # start + i*step keeps neighbouring elements congruent; the end comes from the next piece
        parts.append(start + (end - start) * np.arange(count) / count)
    return np.concatenate([*parts, [breaks[-1]]])


def graded_axis(breaks: Sequence[float], sizes: Sequence[float], size: float) -> Float:
    """Coordinates (K,) that meet every break exactly, fine near the breaks with a small size.

    Parameters
    ----------
    breaks
        Growing coordinates, both ends included.
    sizes
        The wanted step at each break, any number up to infinity; steps grow from there by 28 % a
        step up to ``size``.
    """
    wanted = np.minimum(np.asarray(sizes, dtype=np.float64), size)
    parts: list[Float] = []
    for (start, end), (first, last) in zip(pairwise(breaks), pairwise(wanted), strict=True):
        length = end - start
        place = np.linspace(0.0, 1.0, _SAMPLES + 1)
        step = np.minimum(first + _GROWTH * length * place, last + _GROWTH * length * place[::-1])
        rate = length / np.minimum(step, size)  # steps per unit of place
        total = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]))]) / _SAMPLES
        # a rounding above a whole number must not cost another step
        count = max(1, int(np.ceil(total[-1] - 1e-9)))
        steps = np.arange(count) / count
        if min(first, last) < size:
            steps = np.interp(steps * total[-1], total, place)
        parts.append(start + length * steps)
    return np.concatenate([*parts, [breaks[-1]]])


@dataclass(frozen=True)
class Notch:
    """A slot across ``axis`` (any length unit).

    ``position`` is the coordinate of its middle on ``axis`` ("x", "y", "z"), ``width`` its extent
    along it, ``depth`` how far it reaches into the body from ``side`` ("+x" … "-z", another axis);
    along the third axis it goes through the whole body. ``cells`` is the number of elements over
    the width, which sets their size around the notch in a graded mesh.

    Examples
    --------
    >>> notch = gs.mesh.Notch(position=0.5, width=0.02, depth=0.03, side="-y")
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(10, 4, 1), notches=[notch])
    >>> bar.face_sets["notch_1"].shape
    (8, 2)
    """

    position: float
    width: float
    depth: float
    axis: str = "x"
    side: str = "-y"
    cells: int = 2

    def __post_init__(self) -> None:
        require(self.axis in ("x", "y", "z"), "Notch.axis", repr(self.axis), "'x', 'y' or 'z'")
        sides = [sign + axis for axis in "xyz" if axis != self.axis for sign in "-+"]
        require_one_of("Notch.side", self.side, sides)
        require(np.isfinite(self.position), "Notch.position", self.position, "a coordinate")
        for name in ("width", "depth"):
            value = getattr(self, name)
            require(np.isfinite(value) and value > 0.0, f"Notch.{name}", value, "a length > 0")
        count_of("Notch.cells", self.cells)

    def bounds(self, body: Float) -> Float:
        """(2,3) corners of the slot in a body of bounds (2,3); the open side is at infinity."""
        inside = np.array([[-np.inf] * 3, [np.inf] * 3])
        along, across = "xyz".index(self.axis), "xyz".index(self.side[1])
        inside[:, along] = [self.position - 0.5 * self.width, self.position + 0.5 * self.width]
        if self.side[0] == "+":
            inside[0, across] = body[1, across] - self.depth
        else:
            inside[1, across] = body[0, across] + self.depth
        return inside


def notch_axes(body: Float, sizes: Sequence[float], notches: Sequence[Notch]) -> list[Float]:
    """Three arrays of coordinates for a grid in ``body`` (2,3), graded towards the notches.

    ``sizes`` is the element size along each axis away from them. Raises InputError for a notch
    that leaves the body, cuts it in two, or overlaps another along the same axis.
    """
    breaks: list[dict[float, float]] = [
        {float(body[0, k]): np.inf, float(body[1, k]): np.inf} for k in range(3)
    ]
    taken: list[tuple[Notch, float, float]] = []
    for number, notch in enumerate(notches, start=1):
        inside = notch.bounds(body)
        along, across = "xyz".index(notch.axis), "xyz".index(notch.side[1])
        low, high = float(inside[0, along]), float(inside[1, along])
        extent = f"{notch.axis} {low:.6g} … {high:.6g}"
        fits = body[0, along] < low and high < body[1, along]
        expected = f"inside {body[0, along]:.6g} … {body[1, along]:.6g}"
        require(fits, f"notch {number}: leaves the body", extent, expected)
        room = float(body[1, across] - body[0, across])
        fits = notch.depth < room
        expected = f"less than {room:.6g}"
        require(fits, f"notch {number}: cuts the body in two", f"depth {notch.depth:.6g}", expected)
        for other, start, end in taken:
            beside = other.axis == notch.axis and low <= end and start <= high
            opposite = other.side[1] == notch.side[1] and other.side != notch.side
            through = opposite and not other.depth + notch.depth < room
            apart = not (beside and (other.side == notch.side or through))
            got = f"{extent} beside {start:.6g} … {end:.6g}"
            require(apart, f"notch {number}: meets an earlier one", got, "notches apart")
        taken.append((notch, low, high))
        fine = notch.width / notch.cells
        tip = float(inside[0 if notch.side[0] == "+" else 1, across])
        for k, value in ((along, low), (along, high), (across, tip)):
            breaks[k][value] = min(fine, breaks[k].get(value, np.inf))
    axes = []
    for k in range(3):
        _refuse_slivers("xyz"[k], sorted(breaks[k]))
        axes.append(
            graded_axis(sorted(breaks[k]), [breaks[k][v] for v in sorted(breaks[k])], sizes[k])
        )
    return axes


def _refuse_slivers(axis: str, values: Sequence[float]) -> None:
    """Borders a rounding apart would make flat elements."""
    extent = values[-1] - values[0]
    for a, b in pairwise(values):
        expected = "equal or clearly different coordinates"
        got = f"{axis} {a:.12g} and {b:.12g}"
        require(b - a > 1e-7 * extent, "notches: two borders almost coincide", got, expected)


def notched(mesh: Mesh, notches: Sequence[Notch]) -> Mesh:
    """The mesh without the cells inside the notches. Cell borders must lie on theirs.

    The faces of notch k become the face set "notch_k" (counting from 1); other sets lose what was
    cut away; nodes that no cell needs any more are left out.

    Raises
    ------
    InputError
        A cell lies partly inside a notch, or nothing lies inside, or all of it.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(4, 2, 1))
    >>> gs.mesh.notched(bar, [gs.mesh.Notch(position=0.375, width=0.25, depth=0.5)])
    Mesh(30 nodes, 7 hex8, 7 named sets)
    """
    if not notches:
        return mesh
    body = mesh.bounds
    length = 1e-9 * float((body[1] - body[0]).max())
    gone = np.zeros(mesh.cell_count, dtype=bool)
    for number, notch in enumerate(notches, start=1):
        inside = _cells_inside(mesh, notch.bounds(body), length, f"notch {number}")
        expected = f"a slot in the body, {extents(body)}"
        require(inside.any(), f"notch {number}: no cell lies inside", notch, expected)
        gone |= inside
    if gone.all():
        raise InputError("notched: the notches cut everything away; expected some cells left")
    kept, old_faces = _without(mesh, gone), boundary_faces(mesh)
    faces = boundary_faces(kept)
    # a face of the cut was no boundary face before; told apart by (old cell number, local face)
    before = np.flatnonzero(~gone)[faces.cell].astype(np.int64) * 16 + faces.local
    fresh = ~np.isin(before, old_faces.cell.astype(np.int64) * 16 + old_faces.local)
    middle = faces.centroids
    sets = {}
    for number, notch in enumerate(notches, start=1):
        low, high = notch.bounds(body)
        beside = ((middle >= low - length) & (middle <= high + length)).all(axis=1)
        sets[f"notch_{number}"] = faces[fresh & beside].pairs()
    return kept.with_sets(face_sets=sets)


def _cells_inside(mesh: Mesh, inside: Float, length: float, what: str) -> Bool:
    found: list[Bool] = []
    for kind, first, block in mesh.blocks():
        low, high = _extent(mesh.points, block[:, : CELL_TYPES[kind].corners])
        full = ((low >= inside[0] - length) & (high <= inside[1] + length)).all(axis=1)
        touched = ((low < inside[1] - length) & (high > inside[0] + length)).all(axis=1)
        partly = np.flatnonzero(touched & ~full)
        if partly.size:
            cell = int(partly[0])
            raise InputError(
                f"{what}: {partly.size} cells lie partly inside; got cell {first + cell} from "
                f"({low[cell, 0]:.6g}, {low[cell, 1]:.6g}, {low[cell, 2]:.6g}) to "
                f"({high[cell, 0]:.6g}, {high[cell, 1]:.6g}, {high[cell, 2]:.6g}); expected cell "
                "borders on the notch's borders"
            )
        found.append(full)
    return np.concatenate(found)


def _extent(points: Float, corners: Int) -> tuple[Float, Float]:
    """Least and greatest coordinates (M,3) of each cell; corner by corner, which numpy is quick
    at, instead of over a short axis."""
    low = points[corners[:, 0]]
    high = low.copy()
    for column in range(1, corners.shape[1]):
        place = points[corners[:, column]]
        np.minimum(low, place, out=low)
        np.maximum(high, place, out=high)
    return low, high


def _without(mesh: Mesh, gone: Bool) -> Mesh:
    """The mesh less some cells and the nodes that only they had."""
    blocks = {
        kind: block[~gone[first : first + len(block)]] for kind, first, block in mesh.blocks()
    }
    used = np.zeros(mesh.node_count, dtype=bool)
    for block in blocks.values():
        used[block.ravel()] = True
    used[mesh.dangling_nodes] = True  # they were there before, for a reason of their own
    node = np.cumsum(used) - 1
    cell = np.cumsum(~gone) - 1
    return Mesh(
        mesh.points[used],
        {kind: node[block] for kind, block in blocks.items()},
        {name: node[numbers[used[numbers]]] for name, numbers in mesh.node_sets.items()},
        {
            name: np.stack([cell[pairs[:, 0]], pairs[:, 1]], axis=1)[~gone[pairs[:, 0]]]
            for name, pairs in mesh.face_sets.items()
        },
        {name: cell[numbers[~gone[numbers]]] for name, numbers in mesh.cell_sets.items()},
    )
