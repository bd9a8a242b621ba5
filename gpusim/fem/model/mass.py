"""Mass matrices: consistent, by CalculiX's rules, and lumped on the diagonal."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix, kron

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.fem.elements.element import ELEMENTS, Rule, quadrature
from gpusim.fem.elements.isoparametric_map import volumes
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.mesh import Mesh
from gpusim.validation import checked, one_of, require

MASS_RULES = ("exact", "calculix", "lumped")
# points with which CalculiX integrates mass: fewer than products of shape functions ask for
_CALCULIX = {"hex20 reduced": 8, "tet4": 1, "tet10": 4, "wedge6": 2, "wedge15": 9}
_CHUNK = 4096


@checked
def mass_matrix(
    model: Model,
    rule: Annotated[str, one_of(*MASS_RULES)] = "exact",
    formulation: str | Mapping[str, str] | None = None,
) -> csr_matrix:
    """(3N,3N) mass matrix, row 3 n + axis for node n.

    Parameters
    ----------
    model : see `gpusim.Model`.
    rule : "exact": the integral of density x shape function x shape function, with a rule that is
        exact on straight cells (consistent); "calculix": with that program's points, which are
        fewer in C3D20R, C3D10, C3D15, C3D4 and C3D6; "lumped": see `lumped_mass`.
    formulation : see `gpusim.solve`; that of hex20 decides about CalculiX's points.

    Raises InputError if a material has no density.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.fem.mass_matrix(gs.Model(bar, gs.Isotropic(1.0, 0.3, density=7.0))).shape
    (36, 36)
    """
    check_densities(model)
    elements = ElementMass(model, resolve_formulation(model, formulation), rule)
    return csr_matrix(kron(scalar_mass(elements), np.eye(3), format="csr"))


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
    check_densities(model)
    elements = ElementMass(model, resolve_formulation(model, None), "lumped")
    return np.asarray(scalar_mass(elements).diagonal())


@dataclass(frozen=True, eq=False)
class ElementMass:
    """Mass matrices of a ``model``'s elements, the same for the three directions, by one of
    `MASS_RULES`; ``formulation`` per cell type."""

    model: Model
    formulation: Mapping[str, str]
    rule: str

    def at(self, name: str, cells: Int, numbers: Long) -> Float:
        """(m,k,k) of cells with nodes ``cells`` (m,k), the ``numbers`` (m,) of the mesh."""
        rule = _rule(name, self.formulation[name], self.rule)
        squares = np.einsum("qa,qb->qab", rule.shape, rule.shape).reshape(len(rule.weight), -1)
        weights = volumes(self.model.mesh.points[cells], rule)
        mass = weights * self.model.densities[numbers][:, None]
        matrices = (mass @ squares).reshape(*cells.shape, -1)
        if self.rule != "lumped":
            return np.asarray(matrices)
        diagonal = np.diagonal(matrices, axis1=1, axis2=2)
        share = matrices.sum(axis=(1, 2)) / diagonal.sum(axis=1)
        return np.asarray((diagonal * share[:, None])[..., None] * np.eye(cells.shape[1]))


def scalar_mass(elements: ElementMass) -> csr_matrix:
    """(N,N), the same for the three directions."""
    mass = scalar_matrix(elements.model.mesh, elements.at)
    if elements.rule == "lumped":
        mass.eliminate_zeros()
    return mass


def scalar_matrix(mesh: Mesh, matrices: Callable[[str, Int, Long], Float]) -> csr_matrix:
    """(N,N) sum of the elements' ``matrices``: (m,k,k) of a cell type's cells (m,k) and their
    numbers (m,) in the mesh."""
    rows, columns, values = [], [], []
    for name, first, block in mesh.blocks():
        width = block.shape[1]
        for start in range(0, len(block), _CHUNK):
            cells = block[start : start + _CHUNK]
            numbers = np.arange(first + start, first + start + len(cells))
            rows.append(np.repeat(cells, width, axis=1).ravel())
            columns.append(np.tile(cells, (1, width)).ravel())
            values.append(matrices(name, cells, numbers).ravel())
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return csr_matrix(coo_matrix(entries, shape=(mesh.node_count,) * 2))


@cache
def _rule(name: str, formulation: str, rule: str) -> Rule:
    if rule != "calculix":
        return ELEMENTS[name].mass
    points = _CALCULIX.get(name) or _CALCULIX.get(f"{name} {formulation}")
    return ELEMENTS[name].mass if points is None else quadrature(name, points)


def inertia_forces(model: Model, formulation: Mapping[str, str], rule: str) -> Float:
    """(3,N,3) on a body whose ground accelerates by 1 along x, y and z."""
    mass = np.asarray(scalar_mass(ElementMass(model, formulation, rule)).sum(axis=1))
    return np.asarray(-mass[None] * np.eye(3)[:, None])


def check_densities(model: Model) -> None:
    require(isinstance(model, Model), "mass: model", type(model).__name__, "a Model")
    density = model.densities
    assert model.material_of_cell is not None
    number = int(model.material_of_cell[int(np.argmin(density))])
    what, got = f"mass: materials[{number}] has no density", repr(model.materials[number])
    require((density > 0.0).all(), what, got, "density > 0")
