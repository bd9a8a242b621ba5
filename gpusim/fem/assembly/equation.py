"""The equation of equilibrium at large displacements: residual forces and their tangent.

The pattern of the tangent is found once, its values are filled in as often as they are asked for:
elements answer some at a time, with forces and matrices in one pass (`Want`), and no more of these
is held than is worked on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.element_batches import Elements, pair_blocks
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

# elements that answer at a time
_PORTION = 512


@dataclass(eq=False)
class TangentElements:
    """The elements of a ``response`` as assembly takes them, with their matrices at ``u`` (N,3)."""

    response: ElementResponse
    u: Float
    want: Want = Want.TANGENT
    forces: Float = field(init=False)

    def __post_init__(self) -> None:
        self.name, self.cells = self.response.name, self.response.cells
        self.distinct = len(self.cells)
        self.forces = np.zeros((len(self.cells), 3 * self.cells.shape[1]))

    def at(self, which: Long) -> Float:
        """(m,3k,3k) matrices of the elements ``which``."""
        self.forces[which], matrices = self.response.response(which, self.u, self.want)
        assert matrices is not None
        return matrices

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        """As those of a ``Group``."""
        return pair_blocks(self.at(which), diagonal)


@dataclass(eq=False)
class PressedElements:
    """Pressed ``faces``, with the stiffness of their load times ``factor`` at ``points`` (N,3)."""

    faces: PressedFaces
    points: Float
    factor: float = 1.0

    def __post_init__(self) -> None:
        self.name, self.cells = self.faces.name, self.faces.cells
        self.distinct = len(self.cells)

    def at(self, which: Long) -> Float:
        """(m,3k,3k) matrices of the faces ``which``."""
        return self.factor * self.faces.stiffness(which, self.points)

    def blocks(self, which: Long, diagonal: bool) -> tuple[Float, Float | None]:
        """As those of a ``Group``."""
        return pair_blocks(self.at(which), diagonal)


@dataclass(frozen=True, eq=False)
class Tangent:
    """Of the displacements ``u`` (N,3) at ``factors`` (L,): the ``residual`` (N,3), external less
    internal forces, and the stiffness ``assembled``."""

    u: Float
    factors: Float
    residual: Float
    assembled: Assembled


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
        zero = np.zeros((count, 3))
        self._elements = [TangentElements(one, zero) for one in responses]
        self._pressed = [
            (load.case, PressedElements(part, zero)) for load in model.loads for part in load.parts
        ]
        self._warmed = np.full(len(model.load_cases), np.nan)
        self._filling: list[Elements] = [*self._elements, *(faces for _, faces in self._pressed)]
        self._graph = NodeGraph(self._filling, count)

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

            def forces(which: Long, response: ElementResponse = one) -> Float:
                return response.response(which, u, Want.FORCES)[0]

            parts = shared(forces, portions(one.cells))
            add_to(total, one.cells, np.concatenate(parts).reshape(*one.cells.shape, 3))
        return total

    def linearised(self, u: Float, factors: Float, want: Want = Want.TANGENT) -> Tangent:
        """Residual forces and the tangent at ``u``, or the tangent's material part, which is
        definite: without the stiffness of loads."""
        self._warm(factors)
        for elements in self._elements:
            elements.u, elements.want = u, want
        for case, faces in self._pressed:
            faces.points = self.model.mesh.points + u
            faces.factor = 0.0 if want is Want.MATERIAL else float(factors[case])
        rows = self._graph.fill(self._filling)
        residual = self.external(u, factors)
        for elements in self._elements:
            forces = elements.forces.reshape(*elements.cells.shape, 3)
            add_to(residual, elements.cells, -forces)
        return Tangent(u, factors, residual, Assembled(rows, list(self._elements), None))

    def advance(self, u: Float, du: Float, foretell: bool) -> None:
        """The elements' own unknowns follow a step ``du`` (N,3) from ``u``."""
        for one in self.responses:

            def move(which: Long, response: ElementResponse = one) -> None:
                response.advance(which, u, du, foretell)

            shared(move, portions(one.cells))

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
        if any(one.block.law.state_size for one in self.responses):
            self.internal(u, factors)
        for one in self.responses:
            one.commit(u)


def external_forces(model: Model, u: Float, factors: Float) -> Float:
    """(N,3) forces that act on a body displaced by ``u`` (N,3), at ``factors`` (L,)."""
    total = np.tensordot(factors, model.load_cases, axes=1)
    for load in model.loads:
        total += factors[load.case] * load.forces(model.mesh.points + u)
    return np.asarray(total)


def portions(cells: Int) -> list[Long]:
    """Numbers of elements, some at a time."""
    every = np.arange(len(cells))
    return [every[first : first + _PORTION] for first in range(0, len(cells), _PORTION)]
