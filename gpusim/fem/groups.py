"""Elements with their matrices, before assembly: equal ones share a matrix."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.congruence import congruence_classes, unique_rows
from gpusim.fem.element_matrix import element_stiffness
from gpusim.fem.lattice import Lattice
from gpusim.fem.model import Model
from gpusim.fem.product import pool

__all__ = ["Group", "held_matrices", "lattice_group", "masked", "model_groups"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int32]
Long = npt.NDArray[np.int64]
Bool = npt.NDArray[np.bool_]

# spacings of a lattice that differ by less than this, relative, are one
_SAME_SPACING = 2.0**-36
# distinct elements that one processor takes at a time
_PORTION = 4096


@dataclass(frozen=True, eq=False)
class Group:
    """Elements of one cell type: ``cells`` (M,k) node numbers, ``kind`` (M,) int64 number of each
    element's matrix in ``matrices`` (C,3k,3k) float64, symmetric."""

    name: str
    cells: Int
    kind: Long
    matrices: Float


def model_groups(model: Model, formulation: Mapping[str, str]) -> list[Group]:
    """One group per cell type of a model."""
    elasticity = _elasticity(model)
    assert model.material_of_cell is not None
    groups = []
    for name, first, cells in model.mesh.blocks():
        if len(cells) == 0:
            continue
        material = model.material_of_cell[first : first + len(cells)]
        nodes = model.mesh.points[cells]
        representative, kind = congruence_classes(nodes, material)
        matrices = _matrices(name, nodes, elasticity, material, representative, formulation[name])
        groups.append(Group(name, cells, kind, matrices))
    return groups


def _matrices(
    name: str, nodes: Float, elasticity: Float, material: Int, which: Long, formulation: str
) -> Float:
    """Matrices of the elements ``which``, shared out to the processors."""

    width = 3 * nodes.shape[1]
    result = np.empty((len(which), width, width))

    def fill(first: int) -> None:
        part = which[first : first + _PORTION]
        result[first : first + _PORTION] = element_stiffness(
            name, nodes[part], elasticity[material[part]], formulation
        )

    list(pool().map(fill, range(0, len(which), _PORTION)))
    return result


def lattice_group(model: Model, lattice: Lattice, formulation: Mapping[str, str]) -> Group:
    """The hex8 elements of a lattice, nodes in lattice order: compared by spacings alone."""
    assert model.material_of_cell is not None
    at, nodes = lattice.corner_nodes()
    place = np.stack(np.unravel_index(at, lattice.cell.shape), axis=1)
    material = model.material_of_cell[lattice.cell.ravel()[at]]
    columns = [material.astype(np.int64)]
    for axis in range(3):
        columns.append(_distinct(np.diff(lattice.planes[axis]))[place[:, axis]])
    representative, kind = unique_rows(np.stack(columns, axis=1))
    matrices = element_stiffness(
        "hex8",
        model.mesh.points[nodes[representative]],
        _elasticity(model)[material[representative]],
        formulation["hex8"],
    )
    return Group("hex8", nodes, kind, matrices)


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
    held = ~free[group.cells].reshape(len(group.cells), -1)
    touched = np.flatnonzero(held.any(axis=1))
    width = held.shape[1]
    bits = np.zeros((len(touched), -(-width // 62)), dtype=np.int64)
    for column in range(width):
        bits[:, column // 62] |= held[touched, column].astype(np.int64) << (column % 62)
    key = np.concatenate([group.kind[touched, None], bits], axis=1)
    representative, number = unique_rows(key)
    keep = ~held[touched[representative]]
    extra = group.matrices[group.kind[touched[representative]]]
    extra = extra * keep[:, :, None] * keep[:, None, :]
    kind = group.kind.copy()
    kind[touched] = len(group.matrices) + number
    return kind, extra


def masked(group: Group, free: Bool) -> Group:
    """The group with rows and columns of fixed unknowns set to zero."""
    kind, extra = held_matrices(group, free)
    if len(extra) == 0:
        return group
    return Group(group.name, group.cells, kind, np.concatenate([group.matrices, extra]))
