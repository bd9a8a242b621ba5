"""The equation of equilibrium at large displacements: residual forces and their tangent.

The pattern of the tangent is found once, its values are filled in as often as they are asked for:
elements answer some at a time, with forces and matrices in one pass (`Want`), and no more of these
is held than is worked on.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.sparse import csr_matrix, diags

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.element_batches import Elements, pair_blocks, portions
from gpusim.fem.assembly.element_responses import free_strain
from gpusim.fem.assembly.node_graph import NodeGraph
from gpusim.fem.elements.element_response import ElementResponse, Internal, Want
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.fem.model.constraints import touched
from gpusim.fem.model.elimination import eliminate
from gpusim.fem.model.follower_loads import PressedFaces
from gpusim.fem.model.model import Model
from gpusim.fem.model.thermal_loads import linear_temperature
from gpusim.parallel.threads import shared

# of the stiffness of loads: skew parts that cancel between faces leave less
_ROUNDING = 1e-10
# steps in which the elements' own unknowns are found anew, and when they have been
_MODE_STEPS, _SETTLED = 8, 1e-12


@dataclass(frozen=True, eq=False)
class FormedElements:
    """Elements as assembly takes them, whose matrices (m,3k,3k) ``at`` forms when asked for;
    ``numbers`` (M,) of the mesh's cells, where they are its."""

    name: str
    cells: Int
    at: Callable[[Long], Float]
    numbers: Long | None = None

    @property
    def distinct(self) -> int:
        """As many as there are elements."""
        return len(self.cells)

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        """As those of a ``Group``."""
        return pair_blocks(self.at(which), diagonal)


@dataclass(frozen=True, eq=False)
class Tangent:
    """Of the displacements ``u`` (N,3) at ``factors`` (L,): the ``residual`` (N,3), external less
    internal forces, the symmetric part of the stiffness ``assembled``, and its ``skew`` part
    (3N,3N) on what is solved for, None where loads have a potential."""

    u: Float
    factors: Float
    residual: Float
    assembled: Assembled
    skew: csr_matrix | None


class Equation:
    """External forces equal internal ones: a model, discretised once.

    ``factors`` (L,) of its load cases add up; what is prescribed follows them as well.
    """

    def __init__(self, model: Model, responses: Sequence[ElementResponse]) -> None:
        self.model, self.responses = model, responses
        count = model.mesh.node_count
        assert model.fixed is not None
        self.free = ~model.fixed
        self.free[model.mesh.dangling_nodes] = False
        self.elimination = eliminate(model)
        self._pressed = [(load.case, part) for load in model.loads for part in load.parts]
        self._warmed = np.full(len(model.load_cases), np.nan)
        cells = [one.cells for one in responses]
        self._graph = NodeGraph([*cells, *(faces.cells for _, faces in self._pressed)], count)

    def _warm(self, factors: Float) -> None:
        """Temperatures of the points at ``factors`` (L,)."""
        temperature = self.model.temperature
        if temperature is None or np.array_equal(factors, self._warmed):
            return
        change = linear_temperature("solve", self.model.mesh, factors @ temperature)
        for one in self.responses:
            one.free_strain = free_strain(one, change)
        self._warmed = factors.copy()

    def external(self, u: Float, factors: Float) -> Float:
        """(N,3) forces that act on the body displaced by ``u`` (N,3)."""
        return external_forces(self.model, u, factors)

    def prescribed(self, factors: Float) -> Float:
        """(N,3) displacements of the supports, and what unknowns that constraints give up differ by
        from those that they follow; zero elsewhere."""
        cases = np.broadcast_to(self.model.prescribed_cases, self.model.load_cases.shape)
        result = np.asarray(np.tensordot(factors, cases, axes=1))
        return (
            result if self.elimination is None else result + factors.sum() * self.elimination.offset
        )

    def by_forces_alone(self, factors: Float) -> bool:
        """Whether ``factors`` (L,) mean forces: no displacements of supports, no temperature."""
        temperature = self.model.temperature
        warm = temperature is not None and bool((factors @ temperature).any())
        return not (warm or self.prescribed(factors).any())

    def missing(self, u: Float, factors: Float) -> Float:
        """(N,3) what ``u`` (N,3) lacks of what is prescribed."""
        reached = u
        if self.elimination is not None:
            # T u is u plus what given up unknowns follow
            followed = self.elimination.displacements(u[None])[0] - u
            reached = np.where(self.elimination.given_up, u - followed, u)
        return np.where(self.unknown, 0.0, self.prescribed(factors) - reached)

    @property
    def has_history(self) -> bool:
        """Whether points of some elements remember what they have been through."""
        return any(one.block.law.state_size for one in self.responses)

    @property
    def unknown(self) -> Bool:
        """(N,3) what is solved for."""
        return self.free if self.elimination is None else self.elimination.unknowns(self.free)

    def unbalanced(self, residual: Float) -> Float:
        """(N,3) residual forces on what is solved for."""
        if self.elimination is not None:
            residual = self.elimination.forces(residual[None])[0]
        return np.where(self.unknown, residual, 0.0)

    def reactions(self, u: Float, factors: Float) -> Float:
        """(N,3) forces of supports and constraints, zero elsewhere."""
        held = ~self.free | touched(self.model.constraints, self.free.shape)
        return np.where(held, self.internal(u, factors) - self.external(u, factors), 0.0)

    def internal(self, u: Float, factors: Float) -> Float:
        """(N,3) forces with which the body resists."""
        self._warm(factors)
        total = np.zeros_like(u)
        for one in self.responses:
            parts = shared(partial(one.response, u=u, want=Want.FORCES), portions(len(one.cells)))
            forces = np.concatenate([part for part, _ in parts])
            add_to(total, one.cells, forces.reshape(*one.cells.shape, 3))
        return total

    def linearised(self, u: Float, factors: Float, want: Want = Want.TANGENT) -> Tangent:
        """Residual forces and the tangent at ``u``, or the tangent's material part, which is
        definite: without the stiffness of loads."""
        self._warm(factors)
        residual = self.external(u, factors)
        forces = [np.zeros((*one.cells.shape, 3)) for one in self.responses]
        elements = self.elements(u, want, forces)
        acting = np.zeros_like(factors) if want is Want.MATERIAL else factors
        assembled = self.assembled(elements, u, acting)
        for one, of_cells in zip(elements, forces, strict=True):
            add_to(residual, one.cells, -of_cells)
        skew = self.skew_stiffness(u, acting)
        return Tangent(u, factors, residual, assembled, skew)

    def assembled(self, elements: Sequence[Elements], u: Float, factors: Float) -> Assembled:
        """These and, at ``u`` (N,3), the symmetric part of what loads that follow are to the
        stiffness."""
        rows = self._graph.fill([*elements, *self._follow(u, factors)])
        return Assembled(rows, elements, None)

    def elements(self, u: Float, want: Want, forces: Sequence[Float]) -> Sequence[Elements]:
        """Whose tangents are formed at ``u``; their ``forces`` (M,k,3) are written on the way."""
        return [
            FormedElements(
                one.name, one.cells, partial(_tangents, one, u, want, into), one.block.numbers
            )
            for one, into in zip(self.responses, forces, strict=True)
        ]

    def _follow(self, u: Float, factors: Float) -> list[FormedElements]:
        """What loads that follow are to the stiffness, but for its skew part."""
        points = self.model.mesh.points + u
        return [
            FormedElements(one.name, one.cells, partial(_symmetric, one, points, factors[case]))
            for case, one in self._pressed
        ]

    def skew_stiffness(self, u: Float, factors: Float) -> csr_matrix | None:
        """(3N,3N) on what is solved for, of the loads that follow; None where they have a
        potential: it comes from free edges of what is pressed."""
        if not self._pressed:
            return None
        points, whole = self.model.mesh.points + u, csr_matrix((u.size, u.size))
        for case, faces in self._pressed:
            count = len(faces.cells)
            matrices = factors[case] * faces.stiffness(np.arange(count), points)
            unknowns = (3 * faces.cells[..., None] + np.arange(3)).reshape(count, -1)
            rows, columns = np.broadcast_arrays(unknowns[:, :, None], unknowns[:, None])
            data = matrices.ravel(), (rows.ravel(), columns.ravel())
            whole = csr_matrix(whole + csr_matrix(data, shape=whole.shape))
        skew = 0.5 * (whole - whole.T)
        if self.elimination is not None:
            skew = self.elimination.matrix.T @ skew @ self.elimination.matrix
        solved = diags(self.unknown.ravel().astype(np.float64))
        skew = csr_matrix(solved @ skew @ solved)
        skew.data[np.abs(skew.data) <= _ROUNDING * abs(whole).max()] = 0.0
        skew.eliminate_zeros()
        return skew if skew.nnz else None

    def advance(self, u: Float, du: Float, foretell: bool) -> None:
        """The elements' own unknowns follow a step ``du`` (N,3) from ``u``."""
        for one in self.responses:
            shared(partial(one.advance, u=u, du=du, foretell=foretell), portions(len(one.cells)))

    def relax(self, u: Float, factors: Float) -> None:
        """The elements' own unknowns as they are in equilibrium at ``u``."""
        still, forces = np.zeros_like(u), self.internal(u, factors)
        for _ in range(_MODE_STEPS):
            self.advance(u, still, foretell=False)
            before, forces = forces, self.internal(u, factors)
            if np.abs(forces - before).max() <= _SETTLED * np.abs(forces).max():
                break

    def work_left(self, tangent: Tangent, du: Float) -> float:
        """What is gained by going on along the last step ``du`` (N,3), per share of it, at the
        ``tangent`` that was asked for last; less than nothing where it has gone too far."""
        left = float(np.vdot(du, self.unbalanced(tangent.residual)))
        return left - sum(one.work_of_modes(du) for one in self.responses)

    def shorten(self, share: float) -> None:
        """Of the last step only this share is made."""
        for one in self.responses:
            one.shorten(share)

    def forget_foretold(self) -> None:
        """Tangents take stresses of the state itself from now on."""
        for one in self.responses:
            one.forget_foretold()

    def snapshot(self) -> list[Internal]:
        """The elements' own unknowns and the history of their points."""
        return [one.snapshot() for one in self.responses]

    def restore(self, internal: Sequence[Internal]) -> None:
        """Back to a snapshot."""
        for one, kept in zip(self.responses, internal, strict=True):
            one.restore(kept)

    def commit(self, u: Float, factors: Float) -> None:
        """A step has ended at ``u``: what its points have been through is their history."""
        if self.has_history:
            self.internal(u, factors)
        for one in self.responses:
            one.commit(u)


def _tangents(response: ElementResponse, u: Float, want: Want, forces: Float, which: Long) -> Float:
    """(m,3k,3k) matrices of some elements; their forces go to ``forces`` (M,k,3)."""
    found, matrices = response.response(which, u, want)
    forces[which] = found.reshape(len(which), -1, 3)
    assert matrices is not None
    return matrices


def _symmetric(faces: PressedFaces, points: Float, factor: float, which: Long) -> Float:
    """(m,3k,3k) symmetric parts of the stiffness of some faces, times ``factor``."""
    whole = factor * faces.stiffness(which, points)
    return np.asarray(0.5 * (whole + whole.transpose(0, 2, 1)))


def external_forces(model: Model, u: Float, factors: Float) -> Float:
    """(N,3) forces that act on a body displaced by ``u`` (N,3), at ``factors`` (L,)."""
    total = np.tensordot(factors, model.load_cases, axes=1)
    for load in model.loads:
        total += factors[load.case] * load.forces(model.mesh.points + u)
    return np.asarray(total)
