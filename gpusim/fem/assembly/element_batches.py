"""Elements with their matrices, before assembly: equal ones share a matrix.

Where hardly any two are equal, as in a mesh of tetrahedra, matrices aren't stored: those of a
hundred thousand quadratic tetrahedra take a gigabyte, and each is wanted once or twice.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import congruence_classes, mix, unique_rows
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.elements.straight_tetrahedra import StraightTets, is_straight
from gpusim.fem.lattice.lattice import Lattice
from gpusim.fem.model.model import Model
from gpusim.parallel.threads import shared

# spacings of a lattice that differ by less than this, relative, are one
_SAME_SPACING = 2.0**-36
# elements that one processor takes at a time: they should stay in its cache
_PORTION = 512
# matrices are stored where they repeat at least this often on average
REPEATS = 4
# elements that are compared for a first look, per square root of their number
_LOOK = 8


class Group:
    """Elements of one cell type ``name``: ``cells`` (M,k) node numbers, ``matrix_of`` (M,) int64
    number of each element's matrix in ``matrices`` (C,3k,3k) float64, symmetric; ``form`` gives
    these again; ``numbers`` (M,) of the mesh's cells, where they are its."""

    def __init__(
        self,
        name: str,
        cells: Int,
        matrix_of: Long,
        matrices: Float,
        form: Callable[[], Float] | None = None,
        numbers: Long | None = None,
    ) -> None:
        self.name, self.cells, self.matrix_of, self.numbers = name, cells, matrix_of, numbers
        self.distinct, self._form = len(matrices), form
        self._matrices: Float | None = matrices

    @property
    def matrices(self) -> Float:
        self.remember()
        assert self._matrices is not None
        return self._matrices

    def forget(self) -> None:
        """The matrices won't be wanted soon: they are formed anew then."""
        if self._form is not None:
            self._matrices = None

    def remember(self) -> None:
        """Form them now, on all processors; not to be left to work that is shared out itself."""
        if self._matrices is None:
            assert self._form is not None
            self._matrices = self._form()

    def at(self, which: Long) -> Float:
        """(m,3k,3k) matrices of the elements ``which``."""
        return np.asarray(self.matrices[self.matrix_of[which]])

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        """Blocks (P,m,9) of the pairs a < b of nodes, and the diagonal ones (k,m,9) if wanted."""
        return pair_blocks(self.at(which), diagonal)


@dataclass(frozen=True, eq=False)
class DistinctGroup:
    """Elements no two of which are taken to be equal: ``cells`` (M,k), ``source`` of as many;
    ``numbers`` (M,) of the mesh's cells, where they are its."""

    name: str
    cells: Int
    source: StraightTets | Integrated
    numbers: Long | None = None

    @property
    def distinct(self) -> int:
        return len(self.cells)

    def at(self, which: Long) -> Float:
        """(m,3k,3k) matrices of the elements ``which``."""
        return self.source.at(which)

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        """As a ``Group``."""
        return self.source.blocks(which, diagonal)


class Elements(Protocol):
    """Elements of one cell type as assembly takes them."""

    @property
    def name(self) -> str: ...

    @property
    def cells(self) -> Int: ...

    @property
    def distinct(self) -> int:
        """How many matrices there are."""

    def at(self, which: Long) -> Float: ...

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]: ...


def portions(count: int) -> list[Long]:
    """Numbers of ``count`` elements, as many at a time as one processor takes."""
    every = np.arange(count)
    return [every[first : first + _PORTION] for first in range(0, count, _PORTION)]


def pair_blocks(matrices: Float, diagonal: bool) -> tuple[Float, Float | None]:
    """Blocks of element matrices (m,3k,3k) by pair of nodes; see ``Group.blocks``."""
    width = matrices.shape[1] // 3
    order = np.arange(9 * width * width).reshape(width, 3, width, 3).transpose(0, 2, 1, 3)
    place = order.reshape(width, width, 9)
    flat = matrices.reshape(len(matrices), -1)

    def chosen(where: npt.NDArray[np.intp]) -> Float:
        picked = np.take(flat, where.ravel(), axis=1).reshape(len(flat), -1, 9)
        return np.ascontiguousarray(picked.transpose(1, 0, 2))

    pairs = chosen(place[np.triu_indices(width, 1)])
    return pairs, chosen(place[np.arange(width), np.arange(width)]) if diagonal else None


class Integrated:
    """Element matrices by quadrature."""

    def __init__(
        self, name: str, points: Float, cells: Int, elasticity: Float, material: Int, rule: str
    ) -> None:
        self.name, self.points, self.cells = name, points, cells
        self.elasticity, self.material, self.rule = elasticity, material, rule

    def __len__(self) -> int:
        return len(self.cells)

    def at(self, which: Long) -> Float:
        nodes = self.points[self.cells[which]]
        materials = self.material[which]
        moduli = self.elasticity[materials if (materials != materials[:1]).any() else materials[0]]
        return element_stiffness(self.name, nodes, moduli, self.rule)

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        return pair_blocks(self.at(which), diagonal)


def model_groups(
    model: Model, formulation: Mapping[str, str], chosen: Bool | None = None
) -> list[Group | DistinctGroup]:
    """The elements of a model, one group or two per cell type; of its ``chosen`` (M,) cells."""
    elasticity = _elasticity(model)
    points = model.mesh.points
    assert model.material_of_cell is not None
    groups: list[Group | DistinctGroup] = []
    for name, first, cells in model.mesh.blocks():
        numbers = np.arange(first, first + len(cells))
        if chosen is not None:
            numbers = numbers[chosen[numbers]]
            cells = cells[numbers - first]
        if len(cells) == 0:
            continue
        material = model.material_of_cell[numbers]
        classes = _shared(points, cells, material)
        if classes is not None:
            representative, kind = classes
            rule = formulation[name]
            nodes, materials = points[cells[representative]], material[representative]
            form = partial(_matrices, name, nodes, elasticity, materials, rule)
            groups.append(Group(name, cells, kind, form(), form, numbers))
            continue
        parts = _distinct_groups(name, points, cells, elasticity, material, formulation[name])
        groups += [replace(part, numbers=numbers[part.numbers]) for part in parts]
    return groups


def repeating(model: Model) -> bool:
    """Whether elements of some type share their matrices."""
    mesh, of_cell = model.mesh, model.material_of_cell
    assert of_cell is not None
    return any(
        _shared(mesh.points, cells, of_cell[first : first + len(cells)]) is not None
        for _, first, cells in mesh.blocks()
        if len(cells)
    )


def _shared(points: Float, cells: Int, material: Int) -> tuple[Long, Long] | None:
    """Classes of equal elements (see ``congruence_classes``), where these are few."""
    if not _may_repeat(points, cells, material):
        return None
    representative, kind = congruence_classes(points[cells], material)
    return (representative, kind) if len(representative) * REPEATS <= len(cells) else None


def _may_repeat(points: Float, cells: Int, material: Int) -> bool:
    """Whether elements may repeat: where they do, some of a few are equal too."""
    few = int(_LOOK * np.sqrt(len(cells)))
    if few >= len(cells):
        return True
    chosen = np.unique(mix(np.arange(few), 17) % np.uint64(len(cells))).astype(np.int64)
    representative, _ = congruence_classes(points[cells[chosen]], material[chosen])
    return len(representative) < len(chosen)


def _distinct_groups(
    name: str, points: Float, cells: Int, elasticity: Float, material: Int, rule: str
) -> Iterator[DistinctGroup]:
    # in the order of the nodes: what is added up together then lies together
    order = np.argsort(cells.min(axis=1), kind="stable")
    cells, material = cells[order], material[order]
    straight = np.zeros(len(cells), dtype=bool)
    # the closed form is that of rules which integrate straight elements exactly
    if name == "tet10" and rule != "bbar":
        for start in range(0, len(cells), _PORTION):
            part = slice(start, start + _PORTION)
            straight[part] = is_straight(points[cells[part]])
    if straight.any():
        corners = cells[straight, :4]
        source = StraightTets(points, corners, elasticity, material[straight])
        yield DistinctGroup(name, cells[straight], source, order[straight])
    if not straight.all():
        curved, materials = cells[~straight], material[~straight]
        integrated = Integrated(name, points, curved, elasticity, materials, rule)
        yield DistinctGroup(name, curved, integrated, order[~straight])


def _matrices(name: str, nodes: Float, elasticity: Float, material: Int, formulation: str) -> Float:
    """Matrices of elements with ``nodes`` (C,k,3), shared out to the processors."""
    width = 3 * nodes.shape[1]
    result = np.empty((len(nodes), width, width))

    def fill(first: int) -> None:
        part = slice(first, first + _PORTION)
        result[part] = element_stiffness(name, nodes[part], elasticity[material[part]], formulation)

    shared(fill, range(0, len(nodes), _PORTION))
    return result


def lattice_group(model: Model, lattice: Lattice, formulation: Mapping[str, str]) -> Group:
    """The hex8 elements of a lattice, nodes in lattice order: compared by spacings alone."""
    assert model.material_of_cell is not None
    at, nodes = lattice.corner_nodes()
    cell = lattice.cell.ravel()[at].astype(np.int64)
    material = model.material_of_cell[cell]
    number = np.zeros(lattice.cell.shape, dtype=np.int64)
    for axis in range(3):
        spacing = _distinct(np.diff(lattice.planes[axis]))
        number *= int(spacing.max()) + 1
        number += np.expand_dims(spacing, [other for other in range(3) if other != axis])
    columns = [material.astype(np.int64), np.take(number.ravel(), at)]
    representative, kind = unique_rows(np.stack(columns, axis=1))
    matrices = element_stiffness(
        "hex8",
        model.mesh.points[nodes[representative]],
        _elasticity(model)[material[representative]],
        formulation["hex8"],
    )
    return Group("hex8", nodes, kind, matrices, numbers=cell)


def only_group(groups: Sequence[Elements]) -> Group:
    """The one group that a lattice's elements are."""
    (group,) = groups
    assert isinstance(group, Group)
    return group


def _distinct(spacing: Float) -> Long:
    """Number of each spacing among the distinct ones, from small to large."""
    value, inverse = np.unique(spacing, return_inverse=True)
    number = np.zeros(len(value), dtype=np.int64)
    first, count = float(value[0]), 0
    for k, one in enumerate(value.tolist()):
        # compared with its own size: a thin layer's spacings differ by little beside a thick one's
        if one - first > _SAME_SPACING * first:
            first, count = one, count + 1
        number[k] = count
    return np.asarray(number[inverse])


def _elasticity(model: Model) -> Float:
    return np.stack([material.stiffness() for material in model.materials])


def held_matrices(group: Group, free: Bool) -> tuple[Long, Float]:
    """Elements with fixed unknowns get matrices of their own, with those rows and columns zero.

    ``free`` (N,3). Returns (kind of each element, the additional matrices); additional ones are
    numbered after ``group.matrices``.
    """
    # column by column: several times as fast as along the second axis
    held_node: Bool = np.asarray(~(free[:, 0] & free[:, 1] & free[:, 2]))
    touching = np.zeros(len(group.cells), dtype=bool)
    for corner in group.cells.T:
        touching |= held_node[corner]
    touched = np.flatnonzero(touching)
    held = ~free[group.cells[touched]].reshape(len(touched), 3 * group.cells.shape[1])
    width = held.shape[1]
    bits = np.zeros((len(touched), -(-width // 62)), dtype=np.int64)
    for column in range(width):
        bits[:, column // 62] |= held[:, column].astype(np.int64) << (column % 62)
    key = np.concatenate([group.matrix_of[touched, None], bits], axis=1)
    representative, number = unique_rows(key)
    keep = ~held[representative]
    extra = group.matrices[group.matrix_of[touched[representative]]]
    extra = extra * keep[:, :, None] * keep[:, None, :]
    kind = group.matrix_of.copy()
    kind[touched] = len(group.matrices) + number
    return kind, extra


def masked(group: Group, free: Bool) -> Group:
    """The group with rows and columns of fixed unknowns set to zero; see ``held_matrices``."""
    kind, extra = held_matrices(group, free)
    if len(extra) == 0:
        return group
    return Group(group.name, group.cells, kind, np.concatenate([group.matrices, extra]))
