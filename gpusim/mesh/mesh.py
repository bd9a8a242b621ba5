"""The mesh: points, cells by type, and named sets."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int
from gpusim.display import notebook_html, plotted
from gpusim.errors import InputError
from gpusim.mesh.boundary import boundary_faces, check_range
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.mesh.quality import least_jacobian
from gpusim.validation import require, require_one_of, unmasked

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@unmasked()
@dataclass(frozen=True, eq=False)
class Mesh:
    """A volume mesh in one consistent length unit.

    Parameters
    ----------
    points : (N,3) float64, node coordinates in the body's frame.
    cells : cell type -> (M,k) integer node numbers, VTK/Abaqus order ("hex8", "tet10", see
        ``CELL_TYPES``). A cell's global number counts through the types in the order of this dict.
    node_sets : name -> (K,) node numbers.
    face_sets : name -> (K,2) pairs (global cell number, local face number).
    cell_sets : name -> (K,) global cell numbers.

    Arrays are copied, checked and made read-only. Nodes used by no cell are legal and listed
    in ``dangling_nodes``.

    Raises
    ------
    InputError
        Unknown cell type, wrong shape, node number out of range or repeated inside a cell,
        a coordinate that isn't finite, cells that are flat or inverted (linear: at a corner;
        quadratic: at a quadrature point; the first five named by number), cells with the same
        corners as another, neighbours of
        quadratic cells that share the corners of a face but not its midside nodes.

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    >>> gs.Mesh(points, {"tet4": [[0, 1, 2, 3]]})
    Mesh(4 nodes, 1 tet4)
    """

    points: Float
    cells: Mapping[str, Int]
    node_sets: Mapping[str, Int] = field(default_factory=dict)
    face_sets: Mapping[str, Int] = field(default_factory=dict)
    cell_sets: Mapping[str, Int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        points = _points(self.points)
        count = len(points)
        if not isinstance(self.cells, Mapping) or not self.cells:
            raise InputError(
                f"Mesh.cells: need a mapping from cell type to an array; got {self.cells!r}; "
                f"expected keys among {', '.join(CELL_TYPES)}"
            )
        cells = {name: _cells(name, value, count) for name, value in self.cells.items()}
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "cells", MappingProxyType(cells))
        total = sum(len(block) for block in cells.values())
        require(total > 0, "Mesh.cells: no cells", "empty arrays", "at least one cell")
        _refuse_inverted(self)
        _refuse_duplicate_cells(self)
        if any(CELL_TYPES[kind].linear != kind for kind in cells):
            boundary_faces(self)  # which refuses midside nodes of one side only
        self._keep_sets(self.node_sets, self.face_sets, self.cell_sets)

    def _keep_sets(
        self, nodes: Mapping[str, Any], faces: Mapping[str, Any], cells: Mapping[str, Any]
    ) -> None:
        checked = {
            "node_sets": _sets("node_sets", nodes, self.node_count, 1),
            "face_sets": _sets("face_sets", faces, self.cell_count, 2),
            "cell_sets": _sets("cell_sets", cells, self.cell_count, 1),
        }
        for name, pairs in checked["face_sets"].items():
            _check_local_faces(name, pairs, self)
        for field_name, sets in checked.items():
            object.__setattr__(self, field_name, MappingProxyType(sets))

    def __repr__(self) -> str:
        """Counts, not arrays: a mesh is named in many a message."""
        cells = ", ".join(f"{len(block)} {kind}" for kind, block in self.cells.items())
        sets = sum(map(len, (self.node_sets, self.face_sets, self.cell_sets)))
        return f"Mesh({self.node_count} nodes, {cells}{f', {sets} named sets' if sets else ''})"

    def _repr_html_(self) -> str | None:
        return notebook_html("mesh", self)

    def plot(self, ax: Axes | None = None, *, unit: str = "m", **style: Any) -> Axes:
        """Draw the skin with the edges of its cells, in matplotlib's axes of three dimensions.

        ``unit`` is what labels call the mesh's unit of length; ``style`` goes to matplotlib's
        ``Poly3DCollection`` (``color``, ``edgecolor``, ``alpha``). Returns the axes, new ones
        unless given.
        """
        return plotted("mesh", self, ax, unit=unit, **style)

    @property
    def node_count(self) -> int:
        return len(self.points)

    @property
    def cell_count(self) -> int:
        return sum(len(block) for block in self.cells.values())

    @cached_property
    def bounds(self) -> Float:
        """(2,3) float64: least and greatest coordinate."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @cached_property
    def dangling_nodes(self) -> Int:
        """(K,) int32: numbers of the nodes that belong to no cell."""
        used = np.zeros(self.node_count, dtype=bool)
        for block in self.cells.values():
            used[block.ravel()] = True
        return np.flatnonzero(~used).astype(np.int32)

    def blocks(self) -> Iterator[tuple[str, int, Int]]:
        """Yield (cell type, global number of its first cell, (M,k) cells)."""
        first = 0
        for name, block in self.cells.items():
            yield name, first, block
            first += len(block)

    @classmethod
    def trusted(cls, points: Float, cells: Mapping[str, Int]) -> Mesh:
        """A mesh of what has been checked already, without named sets; arrays aren't copied."""
        points.setflags(write=False)
        for block in cells.values():
            block.setflags(write=False)
        mesh = object.__new__(cls)
        names = "node_sets", "face_sets", "cell_sets"
        mesh.__dict__.update(dict.fromkeys(names, MappingProxyType({})))  # past the frozen class
        mesh.__dict__.update(points=points, cells=MappingProxyType(dict(cells)))
        return mesh

    def moved(self, displacement: npt.ArrayLike) -> Mesh:
        """The same mesh with ``displacement`` (N,3) added to its points."""
        shift = np.asarray(displacement, dtype=np.float64)
        expected = str(self.points.shape)
        require(shift.shape == self.points.shape, "Mesh.moved: wrong shape", shift.shape, expected)
        return Mesh(self.points + shift, self.cells, self.node_sets, self.face_sets, self.cell_sets)

    def with_sets(
        self,
        node_sets: Mapping[str, Int] | None = None,
        face_sets: Mapping[str, Int] | None = None,
        cell_sets: Mapping[str, Int] | None = None,
    ) -> Mesh:
        """The same mesh with named sets added (or replaced)."""
        # points and cells are immutable and were checked: only the sets are new
        mesh = copy(self)
        mesh._keep_sets(
            {**self.node_sets, **(node_sets or {})},
            {**self.face_sets, **(face_sets or {})},
            {**self.cell_sets, **(cell_sets or {})},
        )
        return mesh


def _points(value: Any) -> Float:
    try:
        if np.iscomplexobj(value):
            raise TypeError("complex")
        points = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"Mesh.points: not numbers ({error}); expected (N,3) float64") from None
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise InputError(f"Mesh.points: wrong shape; got {points.shape}; expected (N,3), N > 0")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    what = f"Mesh.points: {bad.size} nodes have a coordinate that isn't finite"
    require(not bad.size, what, f"nodes {_first(bad)}", "finite numbers")
    points.setflags(write=False)
    return points


def _cells(name: str, value: Any, count: int) -> Int:
    require_one_of("Mesh.cells: unknown cell type", name, CELL_TYPES)
    width = CELL_TYPES[name].nodes
    try:
        block = np.asarray(value)
    except ValueError:
        raise InputError(
            f"Mesh.cells[{name!r}]: rows of unequal length; expected (M,{width})"
        ) from None
    fits = block.ndim == 2 and block.shape[1] == width
    require(fits, f"Mesh.cells[{name!r}]: wrong shape", block.shape, f"(M,{width})")
    expected = "integer node numbers"
    require(block.dtype.kind in "iu", f"Mesh.cells[{name!r}]: wrong type", block.dtype, expected)
    bad = np.flatnonzero(((block < 0) | (block >= count)).any(axis=1))
    if bad.size:
        raise InputError(
            f"Mesh.cells[{name!r}]: node number out of range in {bad.size} cells; "
            f"got cell {bad[0]} = {block[bad[0]].tolist()}; expected 0 … {count - 1}"
        )
    ordered = np.sort(block, axis=1)
    twice = np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1))
    if twice.size:
        raise InputError(
            f"Mesh.cells[{name!r}]: {twice.size} cells name a node twice; "
            f"got cell {twice[0]} = {block[twice[0]].tolist()}; expected {width} different nodes"
        )
    copy = np.array(block, dtype=np.int32)
    copy.setflags(write=False)
    return copy


def _sets(what: str, sets: Mapping[str, Any], limit: int, dimensions: int) -> dict[str, Int]:
    return {
        name: _index_set(f"{what}[{name!r}]", value, limit, dimensions)
        for name, value in sets.items()
    }


def _index_set(where: str, value: Any, limit: int, dimensions: int) -> Int:
    numbers = np.asarray(value)
    if numbers.dtype.kind not in "iu" and numbers.size:
        raise InputError(f"Mesh.{where}: wrong type; got {numbers.dtype}; expected integers")
    if numbers.ndim != dimensions or (dimensions == 2 and numbers.shape[1] != 2):
        shape = "(K,)" if dimensions == 1 else "(K,2)"
        raise InputError(f"Mesh.{where}: wrong shape; got {numbers.shape}; expected {shape}")
    first = numbers if dimensions == 1 else numbers[:, 0]
    check_range(f"Mesh.{where}: number", first, limit)
    copy = np.array(numbers, dtype=np.int32)
    copy.setflags(write=False)
    return copy


def _check_local_faces(name: str, pairs: Int, mesh: Mesh) -> None:
    for kind, first, block in mesh.blocks():
        inside = (pairs[:, 0] >= first) & (pairs[:, 0] < first + len(block))
        where = f"Mesh.face_sets[{name!r}]: local face number of {kind}"
        check_range(where, pairs[inside, 1], len(CELL_TYPES[kind].faces))


def _refuse_inverted(mesh: Mesh) -> None:
    bad: list[int] = []
    worst = np.inf
    for kind, first, block in mesh.blocks():
        smallest = least_jacobian(kind, mesh.points, block)
        wrong = np.flatnonzero(~(smallest > 0.0))
        if wrong.size:
            bad.extend((wrong + first).tolist())
            worst = min(worst, float(smallest[wrong].min()))
    expected = "right-handed cells with positive volume"
    got = f"cells {_first(bad)} (least Jacobian {worst:.3g})"
    require(not bad, f"Mesh.cells: {len(bad)} inverted or zero-volume cells", got, expected)


def _refuse_duplicate_cells(mesh: Mesh) -> None:
    """Two cells with the same corners fill one place twice: twice as stiff, twice as heavy."""
    # a sum of random numbers of the corners, whatever their order, is the same only for twins
    random = np.random.default_rng(0).integers(2**63, size=mesh.node_count, dtype=np.uint64)
    sums = np.zeros(mesh.cell_count, dtype=np.uint64)
    for kind, first, block in mesh.blocks():
        for corner in range(CELL_TYPES[kind].corners):
            sums[first : first + len(block)] += random[block[:, corner]]
    order = np.argsort(sums, kind="stable")
    same = np.flatnonzero(sums[order[1:]] == sums[order[:-1]])
    if same.size:
        one, other = order[same[0]], order[same[0] + 1]
        raise InputError(
            f"Mesh.cells: {same.size} cells have the corners of another; got cells {one} and "
            f"{other}; expected each place to be filled once"
        )


def _first(numbers: Any, shown: int = 5) -> str:
    text = ", ".join(str(int(number)) for number in numbers[:shown])
    return text + (", …" if len(numbers) > shown else "")
