"""Mass matrices: consistent, and lumped on the diagonal."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, kron

from gpusim.arrays.array_types import Float, Int
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import volumes
from gpusim.fem.model.model import Model
from gpusim.validation import require

_CHUNK = 16384


def mass_matrix(model: Model) -> csr_matrix:
    """(3N,3N) consistent mass matrix, row 3 n + axis for node n.

    Integral of density x shape function x shape function with a rule that is exact on straight
    cells. Raises InputError if a material has no density.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.fem.mass_matrix(gs.Model(bar, gs.Isotropic(1.0, 0.3, density=7.0))).shape
    (36, 36)
    """
    return csr_matrix(kron(scalar_mass(model), np.eye(3), format="csr"))


def scalar_mass(model: Model) -> csr_matrix:
    """(N,N) consistent mass matrix, the same for the three directions. Raises InputError if a
    material has no density."""
    _check(model)
    rows, columns, values = [], [], []
    for block, matrix in _element_masses(model):
        width = block.shape[1]
        rows.append(np.repeat(block, width, axis=1).ravel())
        columns.append(np.tile(block, (1, width)).ravel())
        values.append(matrix.ravel())
    count = model.mesh.node_count
    entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
    return csr_matrix(coo_matrix(entries, shape=(count, count)))


def lumped_mass(model: Model) -> Float:
    """(N,) mass at each node: the diagonal of each cell's consistent matrix, scaled to its mass.

    Positive for every cell type, unlike row sums (Hinton, Rock & Zienkiewicz, Earthquake Eng.
    Struct. Dyn. 4 (1976) 245). The same for the three directions. Raises InputError if a material
    has no density.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> print(f"{gs.fem.lumped_mass(gs.Model(bar, gs.Isotropic(1.0, 0.3, density=7.0))).sum():.6f}")
    14.000000
    """
    _check(model)
    result = np.zeros(model.mesh.node_count)
    for block, matrix in _element_masses(model):
        diagonal = np.diagonal(matrix, axis1=1, axis2=2)
        share = diagonal * (matrix.sum(axis=(1, 2)) / diagonal.sum(axis=1))[:, None]
        result += np.bincount(block.ravel(), share.ravel(), minlength=len(result))
    return result


def _check(model: Model) -> None:
    require(isinstance(model, Model), "mass: model", type(model).__name__, "a Model")
    density = model.densities
    assert model.material_of_cell is not None
    number = int(model.material_of_cell[int(np.argmin(density))])
    what, got = f"mass: materials[{number}] has no density", repr(model.materials[number])
    require((density > 0.0).all(), what, got, "density > 0")


def _element_masses(model: Model) -> Iterator[tuple[Int, Float]]:
    """Nodes (M,k) and scalar mass matrices (M,k,k) of some cells at a time."""
    density = model.densities
    for kind, first, block in model.mesh.blocks():
        rule = ELEMENTS[kind].mass
        squares = np.einsum("qa,qb->qab", rule.shape, rule.shape)
        table = squares.reshape(len(rule.weight), -1)
        for start in range(0, len(block), _CHUNK):
            cells = block[start : start + _CHUNK]
            densities = density[first + start : first + start + len(cells)]
            mass = volumes(model.mesh.points[cells], rule) * densities[:, None]
            yield cells, (mass @ table).reshape(len(cells), cells.shape[1], cells.shape[1])
