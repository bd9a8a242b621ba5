"""Equilibria by a second program: dense plain Newton in small steps, moduli by complex steps.

Only shape functions and integration points are the solver's own. A law is the stress per area at
rest that belongs to a deformation gradient; its derivative is taken with an imaginary step, which
is exact to the last digit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.fem import Model
from gpusim.fem.elements.element import ELEMENTS

__all__ = ["LAWS", "DenseBody", "neo_hooke", "saint_venant"]

Float = npt.NDArray[np.float64]
Array = npt.NDArray[Any]

_IMAGINARY = 1e-40
_MOST, _ENOUGH = 40, 1e-11


def neo_hooke(F: Array, E: float, nu: float) -> Array:
    """First Piola-Kirchhoff stress (…,3,3) of mu/2 (I1 - 3) - mu ln J + lambda/2 ln^2 J."""
    shear, lame = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    turned = np.linalg.inv(F).swapaxes(-1, -2)
    growth = np.log(np.linalg.det(F))[..., None, None]
    return np.asarray(shear * (F - turned) + lame * growth * turned)


def saint_venant(F: Array, E: float, nu: float) -> Array:
    """First Piola-Kirchhoff stress (…,3,3), linear in Green-Lagrange's strain."""
    shear, lame = E / (2.0 * (1.0 + nu)), E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))
    strain = 0.5 * (F.swapaxes(-1, -2) @ F - np.eye(3))
    trace = np.einsum("...ii->...", strain)[..., None, None]
    return np.asarray(F @ (lame * trace * np.eye(3) + 2.0 * shear * strain))


LAWS: dict[str, Callable[[Array, float, float], Array]] = {
    "NeoHookean": neo_hooke,
    "SaintVenantKirchhoff": saint_venant,
}


@dataclass(frozen=True)
class _Block:
    """Cells (M,k) of one type and law: gradients (M,Q,k,3) and weights (M,Q) of their points."""

    cells: npt.NDArray[np.int64]
    gradients: Float
    weights: Float
    stress: Callable[[Array], Array]


class DenseBody:
    """A hyperelastic ``model`` whose cells are integrated fully: forces and stiffness, dense."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.blocks = []
        assert model.material_of_cell is not None and model.fixed is not None
        for kind, first, cells in model.mesh.blocks():
            numbers = model.material_of_cell[first : first + len(cells)]
            for number, law in enumerate(model.materials):
                chosen = cells[numbers == number].astype(np.int64)
                if len(chosen):
                    self.blocks.append(_block(model.mesh.points, kind, chosen, law))
        self.free = ~model.fixed
        self.free[model.mesh.dangling_nodes] = False

    def answer(self, u: Float) -> tuple[Float, Float]:
        """Internal forces (N,3) and stiffness (3N,3N) at ``u`` (N,3)."""
        forces, stiffness = np.zeros_like(u), np.zeros((u.size, u.size))
        for block in self.blocks:
            moved = u[block.cells]
            F = np.eye(3) + np.einsum("mki,mqkj->mqij", moved, block.gradients)
            weighted = block.gradients * block.weights[..., None, None]
            force = np.einsum("mqij,mqkj->mki", block.stress(F.astype(complex)).real, weighted)
            np.add.at(forces, block.cells, force)
            moduli = np.empty((*F.shape, 3, 3))
            for r in range(3):
                for s in range(3):
                    step = F.astype(complex)
                    step[..., r, s] += 1j * _IMAGINARY
                    moduli[..., r, s] = block.stress(step).imag / _IMAGINARY
            matrix = np.einsum("mqaj,mqijrs,mqbs->maibr", weighted, moduli, block.gradients)
            unknowns = (3 * block.cells[:, :, None] + np.arange(3)).reshape(len(moved), -1)
            size = unknowns.shape[1]
            rows = np.repeat(unknowns[:, :, None], size, 2)
            columns = np.repeat(unknowns[:, None], size, 1)
            np.add.at(stiffness, (rows, columns), matrix.reshape(len(moved), size, size))
        return forces, stiffness

    def equilibria(self, factors: npt.ArrayLike, steps: int = 20) -> Float:
        """(K,N,3) at load ``factors`` (K,) or (K,L), each in so many equal ``steps``.

        Raises AssertionError where Newton's method doesn't settle, or ends where the body wouldn't
        stay.
        """
        model, free = self.model, self.free.ravel()
        given = np.asarray(factors, dtype=np.float64).reshape(-1, len(model.load_cases))
        prescribed = np.broadcast_to(model.prescribed_cases, model.load_cases.shape)
        u, before, found = np.zeros(model.mesh.points.shape), np.zeros(given.shape[1]), []
        for target in given:
            for share in np.arange(1, steps + 1) / steps:
                at = before + share * (target - before)
                acting = np.tensordot(at, model.load_cases, axes=1)
                held = np.tensordot(at, prescribed, axes=1)
                change, correction = np.where(model.fixed, held - u, 0.0), np.inf
                for _ in range(_MOST):
                    forces, stiffness = self.answer(u)
                    right = (acting - forces).ravel() - stiffness @ change.ravel()
                    du = change.ravel().copy()
                    du[free] += np.linalg.solve(stiffness[np.ix_(free, free)], right[free])
                    u = u + du.reshape(u.shape)
                    change, correction = np.zeros_like(u), float(np.abs(du).max())
                    if correction <= _ENOUGH * float(np.abs(u).max()):
                        break
                assert correction <= 1e-8 * max(float(np.abs(u).max()), 1e-300), "doesn't settle"
            least = np.linalg.eigvalsh(self.answer(u)[1][np.ix_(free, free)])[0]
            assert least > 0.0, "ends where the body wouldn't stay"
            before = target
            found.append(u)
        return np.array(found)


def _block(points: Float, kind: str, cells: npt.NDArray[np.int64], law: Any) -> _Block:
    rule = ELEMENTS[kind].rule("full")
    jacobian = np.einsum("mki,qkj->mqij", points[cells], rule.gradient)
    gradients = np.einsum("qkj,mqji->mqki", rule.gradient, np.linalg.inv(jacobian))
    stress = LAWS[type(law).__name__]
    return _Block(
        cells, gradients, rule.weight * np.linalg.det(jacobian),
        lambda F: stress(F, law.E, law.nu),
    )  # fmt: skip
