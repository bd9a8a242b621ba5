"""Elements of each kinematics with small laws, their tangents by differences, and Newton's method
with dense matrices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.elements.element_response import ElementBlock, ElementResponse, Want
from gpusim.fem.elements.enhanced_modes import EnhancedModes
from gpusim.fem.elements.mean_dilatation import MeanDilatation
from gpusim.fem.elements.total_lagrangian import TotalLagrangian
from gpusim.fem.materials.law import Law, Update
from gpusim.mesh import Mesh
from gpusim.mesh.shape_functions import reference_nodes

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

E, NU = 1000.0, 0.3
FINITE = {"incompatible": EnhancedModes, "bbar": MeanDilatation}
FORMS = [
    (kinematics, kind, name)
    for kind, element in ELEMENTS.items()
    for name in element.formulations
    for kinematics in ("corotational", "finite")
]
"""Kinematics, cell type and formulation: all that there are."""
HEXAHEDRA = [form for form in FORMS if form[1] == "hex8"]
ROTATION = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
ROTATION *= np.linalg.det(ROTATION)
"""By more than a right angle about no axis of the coordinates."""
PAIRS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))


@dataclass(frozen=True)
class SaintVenantKirchhoff:
    """S = C : E; ``error`` of its moduli, for tests of tests."""

    nu: float = NU
    error: float = 0.0
    density = 0.0
    state_size = 0
    finite_strain = True

    def stiffness(self) -> Float:
        return Isotropic(E, self.nu).stiffness()

    def expansion_strain(self) -> Float:
        return np.zeros(6)

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        matrix = self.stiffness()
        return Update(strain @ matrix, matrix * (1.0 + self.error) if moduli else None, None)


class NeoHooke(SaintVenantKirchhoff):
    """mu/2 (I1 - 3) - mu ln J + lambda/2 ln^2 J."""

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        matrix = self.stiffness()
        lame, mu = matrix[0, 1], matrix[3, 3]
        metric = 2.0 * tensors(strain, 0.5) + np.eye(3)
        log = 0.5 * np.log(np.linalg.det(metric))
        inv = np.linalg.inv(metric)
        stress = mu * np.eye(3) + (lame * log - mu)[..., None, None] * inv
        row, column = np.array(PAIRS).T
        result = None
        if moduli:
            v = inv[..., row, column]
            i, j, k, m = row[:, None], column[:, None], row, column
            pair = inv[..., i, k] * inv[..., j, m] + inv[..., i, m] * inv[..., j, k]
            result = lame * v[..., :, None] * v[..., None, :]
            result += (mu - lame * log)[..., None, None] * pair
        return Update(stress[..., row, column], result, None)


class Flowing(SaintVenantKirchhoff):
    """J2 with linear hardening in Green-Lagrange strain; state: plastic strain, its length."""

    state_size = 7
    yield_stress, hardening = 5.0, 100.0

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> Update:
        assert state is not None
        matrix = self.stiffness()
        mu = matrix[3, 3]
        stress = (strain - state[..., :6]) @ matrix
        deviator = stress.copy()
        deviator[..., :3] -= stress[..., :3].mean(axis=-1, keepdims=True)
        size = np.sqrt((deviator[..., :3] ** 2).sum(-1) + 2.0 * (deviator[..., 3:] ** 2).sum(-1))
        over = np.sqrt(1.5) * size - self.yield_stress - self.hardening * state[..., 6]
        amount = np.maximum(over, 0.0) / (3.0 * mu + self.hardening)
        normal = deviator / np.where(size > 0.0, size, 1.0)[..., None]
        flow = np.sqrt(1.5) * amount[..., None] * normal
        new = state.copy()
        new[..., :6] += flow * [1, 1, 1, 2, 2, 2]
        new[..., 6] += amount
        result = None
        if moduli:
            flowing = (over > 0.0)[..., None, None]
            theta = 3.0 * mu * amount / np.where(over > 0.0, np.sqrt(1.5) * size, 1.0)
            share = 1.0 / (1.0 + self.hardening / (3.0 * mu)) - theta
            project = np.diag([1.0, 1, 1, 0.5, 0.5, 0.5])
            project[:3, :3] -= 1.0 / 3.0
            result = matrix - 2.0 * mu * theta[..., None, None] * project
            outer = normal[..., :, None] * normal[..., None, :]
            result = result - flowing * 2.0 * mu * share[..., None, None] * outer
        return Update(stress - 2.0 * mu * flow, result, new)


def tensors(values: Float, shear: float = 1.0) -> Float:
    """(…,3,3) of (…,6), shear times ``shear``."""
    result = np.empty((*values.shape[:-1], 3, 3))
    for column, (i, j) in enumerate(PAIRS):
        result[..., i, j] = result[..., j, i] = values[..., column] * (shear if i != j else 1.0)
    return result


class Matrices:
    """Linear element matrices as a group of elements has them."""

    def __init__(self, block: ElementBlock) -> None:
        nodes = block.points[block.cells]
        stiffness = block.law.stiffness()
        self.values = element_stiffness(block.name, nodes, stiffness, block.formulation)

    def at(self, which: Long) -> Float:
        return self.values[which]


def elements(
    form: tuple[str, str, str],
    points: Float,
    cells: npt.NDArray[np.integer],
    law: Law | None = None,
    free: Float | None = None,
) -> ElementResponse:
    kinematics, kind, name = form
    block = ElementBlock(
        kind, name, points, np.asarray(cells, np.int32), law or SaintVenantKirchhoff()
    )
    own: ElementResponse
    if kinematics == "corotational":
        own = Corotational(block, Matrices(block))
    else:
        own = FINITE.get(name, TotalLagrangian)(block)
    own.free_strain = free
    return own


def single(kind: str, seed: int = 0) -> Float:
    """(k,3) nodes of a distorted cell, sides of three lengths."""
    shape = reference_nodes(kind) * [1.0, 0.6, 0.4]
    spread = 0.08 if len(shape) <= 8 else 0.025
    return shape + spread * np.random.default_rng(seed).uniform(-1.0, 1.0, shape.shape)


def motion_of(points: Float, amount: float = 0.04, seed: int = 1) -> Float:
    """(k,3) displacements: a random motion of each node, then the large rotation."""
    moved = points + amount * np.random.default_rng(seed).uniform(-1.0, 1.0, points.shape)
    return moved @ ROTATION.T - points


def copies(
    form: tuple[str, str, str], nodes: Float, count: int, law: Law | None, free: Float | None
) -> ElementResponse:
    """The same element many times, each with nodes of its own."""
    cells = np.arange(count * len(nodes)).reshape(count, -1)
    if free is not None:
        points = len(ELEMENTS[form[1]].rule(form[2]).weight)
        free = np.broadcast_to(free, (count, points, 6))
    return elements(form, np.tile(nodes, (count, 1)), cells, law, free)


def settle(own: ElementResponse, u: Float) -> None:
    """Let internal modes come to rest at u, as global iterations do."""
    which = np.arange(len(own.cells))
    for _ in range(12 if isinstance(own, EnhancedModes) else 0):
        own.response(which, u, Want.TANGENT)
        own.advance(which, u, np.zeros_like(u), False)


def tangent_errors(
    form: tuple[str, str, str],
    path: list[tuple[Float, Float]],
    law: Law | None = None,
    step: float = 1e-3,
    free: Float | None = None,
) -> list[float]:
    """Relative, against central differences of sixth order: of one element at rest at ``nodes``,
    path[0][0], after each of the motions (nodes, u) in turn. ``free`` (6,) strain."""
    nodes = path[0][0]
    offsets = [0, 1, -1, 2, -2, 3, -3]
    unit = np.eye(nodes.size).reshape(-1, *nodes.shape)
    apart = step * np.concatenate([offset * unit for offset in offsets])
    own = copies(form, nodes, len(apart), law, free)
    which, start = np.arange(len(apart)), own.snapshot()
    before, errors = np.zeros((len(apart) * len(nodes), 3)), []
    for _, u in path:
        same = np.tile(u, (len(apart), 1))
        own.restore(start)
        own.response(which, before, Want.TANGENT)
        own.advance(which, before, same - before, False)
        settle(own, same)
        tangent = own.response(which[:1], same, Want.TANGENT)[1]
        start = own.snapshot()
        moved = same + apart.reshape(-1, 3)
        settle(own, moved)
        forces = own.response(which, moved, Want.FORCES)[0].reshape(7, -1, nodes.size)
        slope = 45 * (forces[1] - forces[2]) - 9 * (forces[3] - forces[4]) + forces[5] - forces[6]
        assert tangent is not None
        difference = slope.T / (60.0 * step) - tangent[0]
        errors.append(float(np.abs(difference).max() / np.abs(tangent).max()))
        before = same
    return errors


@dataclass(frozen=True)
class Body:
    """A mesh of one cell type with its elements; ``free`` (N,3) are its unknowns."""

    mesh: Mesh
    own: ElementResponse
    free: npt.NDArray[np.bool_]

    def dense(self, u: Float) -> tuple[Float, Float]:
        """Internal forces (N,3) and the tangent (3N,3N)."""
        size, cells = u.size, self.own.cells
        forces, tangents = self.own.response(np.arange(len(cells)), u, Want.TANGENT)
        assert tangents is not None
        unknowns = (3 * cells[..., None] + np.arange(3)).reshape(len(cells), -1)
        total = np.bincount(unknowns.ravel(), forces.ravel(), size)
        matrix = np.zeros((size, size))
        np.add.at(matrix, (unknowns[:, :, None], unknowns[:, None, :]), tangents)
        return total.reshape(u.shape), matrix

    def newton(
        self, load: Float, u: Float, foretell: bool = False, most: int = 30
    ) -> tuple[Float, list[float]]:
        """u at equilibrium, and the largest entry of each step."""
        kept, which, steps = np.flatnonzero(self.free), np.arange(len(self.own.cells)), []
        for _ in range(most):
            forces, matrix = self.dense(u)
            step = np.zeros(u.size)
            residual = (load - forces).ravel()[kept]
            step[kept] = np.linalg.solve(matrix[np.ix_(kept, kept)], residual)
            step = step.reshape(u.shape)
            self.own.advance(which, u, step, foretell)
            u = u + step
            steps.append(float(np.abs(step).max()))
            if steps[-1] <= 1e-13 * max(float(np.abs(u).max()), 1e-3):
                break
        return u, steps
