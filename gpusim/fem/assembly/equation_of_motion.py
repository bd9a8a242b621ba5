"""The linear equation of motion, M a + K u = f: products with mass and stiffness.

What vibrates is what is solved for: supports hold still, and constraints (their constant parts left
out) are eliminated by congruence, u = T x (see ``Elimination``). At an equilibrium K is the tangent
there: stresses stiffen or soften the body.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.assembly import Assembled, assemble, model_lattice
from gpusim.fem.assembly.element_responses import element_responses
from gpusim.fem.assembly.equation import Equation
from gpusim.fem.assembly.geometric_stiffness import GeometricStiffness
from gpusim.fem.assembly.node_graph import Numbering
from gpusim.fem.assembly.reduced_system import reduced_system
from gpusim.fem.assembly.shifted_system import Shift, shifted_elements, shifted_system
from gpusim.fem.assembly.system import (
    ElementForces,
    System,
    finest_product,
    make_system,
    scaled_system,
)
from gpusim.fem.elements.element_response import Want
from gpusim.fem.model.elimination import Elimination, eliminate
from gpusim.fem.model.mass import ElementMass, check_densities, scalar_mass
from gpusim.fem.model.model import Model
from gpusim.fem.model.solution import Solution
from gpusim.fem.model.supports import rigid_modes
from gpusim.validation import require


@dataclass(frozen=True, eq=False)
class EquationOfMotion:
    """Of a ``model``, whose nodes may be numbered anew inside.

    Vectors are rows x (L,3N), zero where nothing is solved for. Stiffness, mass and forces are over
    ``scale``, a power of two. ``element_mass`` of the model as it is numbered inside, ``mass``
    (N,N) its sum for one direction; ``points`` (N,3) of its nodes, where they are by now.
    """

    model: Model
    element_mass: ElementMass
    mass: csr_matrix
    points: Float
    scale: float
    _numbering: Numbering | None
    _elimination: Elimination | None
    _assembled: Assembled
    _system: System

    @staticmethod
    def of(model: Model, formulation: Mapping[str, str], mass_rule: str | None) -> EquationOfMotion:
        """At rest, without loads; by no rule without mass, for what depends on the stiffness alone.
        Raises InputError for a material without density."""
        return _equation_of_motion(model, formulation, mass_rule, None)

    @staticmethod
    def at(solution: Solution, formulation: Mapping[str, str], mass_rule: str) -> EquationOfMotion:
        """About the state of a ``solution``, stressed as it is there.

        Raises InputError for laws with a history, whose state a solution doesn't hold, and
        NotConverged for a solution that isn't one.
        """
        if not solution.converged:
            got, expected = solution.message, "a converged one"
            raise NotConverged(f"prestress: the solution; got {got}; expected {expected}")
        return _equation_of_motion(solution.model, formulation, mass_rule, solution)

    @cached_property
    def unknown(self) -> Bool:
        """(3N,) what is solved for."""
        return self._reduced[1].free.ravel()

    def stiffness(self, x: Float) -> Float:
        """K x (L,3N); on a lattice from differences of displacements, as the usual product is wrong
        by 7e-6 in the first mode of a beam 200 times as long as thick."""
        return np.where(self.unknown, self._product(x), 0.0)

    def stiffness_by_deformation(self, x: Float) -> Float:
        """The same without the rounding of the elements' matrices, several times as slow."""
        return self._on_rows(self._reduced[1].elements.product, x) / self.scale

    def rounding_by_deformation(self, x: Float) -> Float:
        """(L,3N) as much as rounding can do to `stiffness_by_deformation`."""
        return np.abs(self._on_rows(self._reduced[1].by_deformation().rounding, x))

    def stiffness_by_differences(self, x: Float) -> Float:
        """K x from differences of displacements, as it is on a lattice anyway; between the two
        others, in time and as sharp."""
        return self._on_rows(self._reduced[1].apply, x)

    def rounding_by_differences(self, x: Float) -> Float:
        """(L,3N) as much as rounding can do to `stiffness_by_differences`."""
        return np.abs(self._on_rows(self._reduced[1].rounding, x))

    def _on_rows(self, product: Callable[[Float], Float], x: Float) -> Float:
        image = product(x.reshape(len(x), -1, 3)).reshape(x.shape)
        return np.where(self.unknown, image, 0.0)

    def inertia(self, x: Float) -> Float:
        """M x (L,3N)."""
        return self.scalar_product(self.mass, x)

    def scalar_product(self, matrix: csr_matrix, x: Float) -> Float:
        """(L,3N) what a ``matrix`` (N,N), in the numbers inside and the same for the three
        directions, makes of x (L,3N)."""
        if not len(x):
            return x
        u = x.reshape(len(x), -1, 3)
        moved = u if self._elimination is None else self._elimination.displacements(u)
        return self._forces(Shift(self.element_mass, matrix, 1.0).forces(moved))

    def displacements(self, x: Float) -> Float:
        """(L,N,3) in the model's own numbers, with what constraints gave up."""
        u, elimination = x.reshape(len(x), *self.points.shape), self._elimination
        numbering = self._numbering
        moved = u if elimination is None else elimination.displacements(u)
        return moved if numbering is None else numbering.backward(moved)

    def unknowns(self, u: Float) -> Float:
        """x (L,3N) of displacements (L,N,3) in the model's own numbers that obey the supports."""
        return np.where(self.unknown, self.inside(u).reshape(len(u), -1), 0.0)

    def inside(self, u: Float) -> Float:
        """(L,N,3) in the numbers inside of (L,N,3) in the model's own."""
        return u if self._numbering is None else self._numbering.forward(u)

    def forces(self, f: Float) -> Float:
        """What nodal forces (L,N,3), in the model's own numbers, do to x: (L,3N)."""
        return self._forces(self.inside(f))

    def base_motions(self) -> tuple[Float, Float, Float]:
        """The centre of mass (3,), masses and moments of inertia about it (6,), and what M r does
        to x: (6,3N), of translations and rotations r of all nodes about the centre."""
        weights = np.asarray(self.mass.sum(axis=1)).ravel()
        centre = weights @ self.points / weights.sum()
        base = np.moveaxis(rigid_modes(self.points, centre, 1.0), 2, 0)
        forces = self.shift(1.0).forces(base)
        return centre, np.einsum("kni,kni->k", base, forces), self._forces(forces)

    def _forces(self, f: Float) -> Float:
        """(L,3N) of forces (L,N,3) in the numbers inside."""
        if self._elimination is not None:
            f = self._elimination.forces(f)
        return np.where(self.unknown, f.reshape(len(f), -1) / self.scale, 0.0)

    def shift(self, factor: float) -> Shift:
        """``factor`` times the mass."""
        return Shift(self.element_mass, self.mass, factor)

    def shifted(self, factor: float) -> tuple[Assembled, System]:
        """What solvers take of K + ``factor`` M."""
        if factor == 0.0:
            return self._reduced
        return self._on_unknowns(*shifted_system(self._assembled, self._system, self.shift(factor)))

    @cached_property
    def _reduced(self) -> tuple[Assembled, System]:
        return self._on_unknowns(self._assembled, self._system)

    def _on_unknowns(self, assembled: Assembled, system: System) -> tuple[Assembled, System]:
        elimination = self._elimination
        if elimination is None:
            return assembled, system
        offset = np.zeros_like(elimination.offset)
        return reduced_system(assembled, system, replace(elimination, offset=offset))

    @cached_property
    def _product(self) -> Callable[[Float], Float]:
        assembled, system = self._reduced
        if assembled.lattice is None:
            return finest_product(assembled.rows, system)
        return lambda x: system.apply(x.reshape(len(x), -1, 3)).reshape(x.shape)


def _equation_of_motion(
    model: Model, formulation: Mapping[str, str], mass_rule: str | None, solution: Solution | None
) -> EquationOfMotion:
    if mass_rule is not None:
        check_densities(model)
    lattice = model_lattice(model)
    numbering = Numbering.of(model) if lattice is None else None
    inside = model if numbering is None else numbering.renumbered(model)
    if solution is None:
        assembled = assemble(inside, formulation, lattice)
        system, points = make_system(inside, assembled), inside.mesh.points
    else:
        assembled, system, points = _tangent(inside, formulation, solution, numbering)
    element_mass = ElementMass(inside, formulation, mass_rule or "exact")
    empty = csr_matrix((inside.mesh.node_count,) * 2)
    mass = empty if mass_rule is None else scalar_mass(element_mass)
    return EquationOfMotion(
        model, element_mass, mass, points, system.scale,
        numbering, eliminate(inside), assembled, system,
    )  # fmt: skip


def _tangent(
    model: Model,
    formulation: Mapping[str, str],
    solution: Solution,
    numbering: Numbering | None,
) -> tuple[Assembled, System, Float]:
    """At the last state of a solution, and its nodes: of an equilibrium its tangent, of linear
    theory the material's stiffness there and that of its stress. Rotations cost energy there: there
    is no product by deformation."""
    equation = Equation(model, element_responses(model, formulation))
    where, got = "prestress", "a law with a history, which a solution doesn't hold"
    require(not equation.has_history, where, got, "elastic laws")
    u = solution.u if solution.u.ndim == 2 else solution.u.sum(axis=0)
    u = u if numbering is None else numbering.forward(u)
    factors = solution.steps[-1].factors if solution.steps else np.ones(len(model.load_cases))
    equation.relax(u, factors)
    if solution.steps:
        assembled = equation.linearised(u, factors).assembled
    else:
        # that of the displaced body would have parts of second order, which nothing balances; its
        # sum over elements isn't asked for
        stress = Shift(GeometricStiffness(model, formulation, u, factors), csr_matrix((0, 0)), 1.0)
        forces = [np.zeros((*one.cells.shape, 3)) for one in equation.responses]
        material = equation.elements(u, Want.MATERIAL, forces)
        elements = [shifted_elements(one, stress) for one in material]
        assembled = equation.assembled(elements, u, factors)
    still, points = np.zeros_like(u), model.mesh.points + u
    system = scaled_system(assembled, points, equation.free, still[None], still[None])
    sums = ElementForces(lambda v: system.apply(v) * system.scale, system.elements.rounding)
    return assembled, replace(system, elements=sums), points
