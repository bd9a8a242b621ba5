"""A deck: mesh, materials, and one problem for each step."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int, Long
from gpusim.deck.initial_state import point_stresses
from gpusim.deck.load_path import LoadPath
from gpusim.deck.procedures import Static
from gpusim.deck.step import Analysis, Result, Step
from gpusim.errors import InputError
from gpusim.fem import Material, Model, Rayleigh, Solution, solve
from gpusim.field_summary import field_summary
from gpusim.gpu import Device
from gpusim.mesh import Mesh
from gpusim.validation import require, unmasked


@unmasked()
@dataclass(frozen=True, eq=False)
class Deck:
    """An analysis as an input file describes it; units are the file's.

    It is ``nonlinear`` with NLGEOM, and with *PLASTIC or *HYPERELASTIC also without: all of it is
    then solved at large displacements, in one analysis in which each step goes on from the one
    before. Materials are as CalculiX has them with NLGEOM: *ELASTIC holds between second
    Piola-Kirchhoff stress and Green-Lagrange strain; *PLASTIC is `gpusim.fem.J2`, which differs
    from plasticity at small strain by about the square of the strain.

    mesh : nodes in the order of their labels; sets and surfaces by name.
    node_labels, cell_labels : (N,), (M,) the file's numbers; of further instances of parts, counted
        on from the next power of ten.
    materials, material_of_cell : as in ``Model``.
    formulation : cell type -> integration rule, as CalculiX has it for the deck's elements.
    steps : the steps, in order.
    node_axes : position of a node -> (3,3), its own axes from *TRANSFORM in rows. Supports and
        forces of the file are in these; models and solutions here are in global axes.
    initial_stress : cell type -> (M,Q,6) at the integration points; types without any are absent.
    ignored : keywords that were read over: output requests and what can't change the result.
    initial_motion : displacement and velocity (N,3) at the beginning.
    damping, loss_factor : of *DAMPING; the first is that of *DYNAMIC, the second of *STEADY STATE
        DYNAMICS.

    Examples
    --------
    >>> deck = gs.load_deck("bricks.inp")
    >>> deck.mesh
    Mesh(12 nodes, 2 hex8, 5 named sets)
    >>> deck.materials[0]
    Isotropic(E=200.0, nu=0.25, density=3.0, expansion=0.002)
    """

    path: str
    mesh: Mesh
    node_labels: Long
    cell_labels: Long
    materials: Sequence[Material]
    material_of_cell: Int
    formulation: Mapping[str, str]
    steps: Sequence[Step]
    node_axes: Mapping[int, Float]
    initial_stress: Mapping[str, Float]
    ignored: Sequence[str]
    initial_motion: tuple[Float, Float]
    damping: Rayleigh
    loss_factor: float = 0.0
    nonlinear: bool = False
    __repr__ = field_summary

    def model(self, *numbers: int) -> Model:
        """The model of one step, or of several that hold the same degrees of freedom.

        Several steps become the load cases of one model. Raises InputError for a step that
        doesn't exist, and for steps whose supports or constraints differ.
        """
        chosen = [self._step(number) for number in numbers]
        if not chosen:
            raise InputError("Deck.model: no step; expected at least one number, counted from 1")
        for step in chosen:
            if not step.held_as(chosen[0]):
                raise InputError(
                    f"Deck.model: steps {chosen[0].number} and {step.number} hold different "
                    "degrees of freedom; expected steps with the same supports and constraints"
                )
        return self.model_of(chosen)

    def solve(
        self,
        device: Device | None = None,
        *,
        tolerance: float = 1e-6,
        backend: str = "auto",
        method: str = "auto",
        progress: Callable[[int, float], None] | None = None,
    ) -> tuple[Result, ...]:
        """The result of each step: of *STATIC a `Solution`, whose ``u`` is (N,3), of *FREQUENCY
        `Modes`, of *BUCKLE `Buckling`, of *MODAL DYNAMIC and *DYNAMIC a `History`, and of *STEADY
        STATE DYNAMICS a `HarmonicResponse`.

        Steps with the same supports and constraints are solved together as load cases; those of a
        nonlinear deck one after the other, and ``Solution.steps`` are the load steps of each. If
        no equilibrium is found in one of them, the later ones have none, and the displacements
        that were reached. Arguments and errors are those of ``gpusim.fem.solve``.
        """
        solved = partial(
            solve,
            device=device,
            tolerance=tolerance,
            formulation=self.formulation,
            backend=backend,
            method=method,
            progress=progress,
        )
        found: dict[int, Solution] = {}
        waiting = [step for step in self.steps if isinstance(step.procedure, Static)]
        if self.nonlinear and waiting:
            path = LoadPath(waiting)
            whole = solved(self.model_of(path.states), geometry="nonlinear", factors=path.factors)
            found = {
                one.number: own for one, own in zip(waiting, path.solutions(whole), strict=True)
            }
            waiting = []
        while waiting:
            first = waiting[0]
            group = [step for step in waiting if step.held_as(first)]
            waiting = [step for step in waiting if step not in group]
            both = solved(self.model_of(group))
            found |= {step.number: _case(both, k) for k, step in enumerate(group)}
        results: list[Result] = []
        for step in self.steps:
            analysis = Analysis(
                path=self.path, steps=self.steps, materials=self.materials, model_of=self.model_of,
                formulation=self.formulation, nonlinear=self.nonlinear, damping=self.damping,
                loss_factor=self.loss_factor, initial_motion=self.initial_motion, method=method,
                tolerance=tolerance, static=found, before=tuple(results),
            )  # fmt: skip
            results.append(step.procedure.solve(step, analysis))
        pairs = zip(self.steps, results, strict=True)
        return tuple(step.procedure.shown(result) for step, result in pairs)

    def point_stress(self, number: int, u: npt.ArrayLike | Solution) -> Mapping[str, Float]:
        """Stress at the integration points of each element for ``u`` (N,3) of step ``number``, or
        for its solution; a nonlinear deck takes its solution, and gives Cauchy stress.

        Returns cell type -> (M,Q,6) float64, order xx yy zz xy yz zx, global axes, elements in the
        order of the mesh. Free strain of the step's temperature is subtracted, initial stress
        added. Raises InputError.
        """
        step = self._step(number)
        if self.nonlinear:
            stress = u.steps[-1].stress if isinstance(u, Solution) and u.steps else None
            what = "Deck.point_stress: u of a nonlinear deck"
            require(stress is not None, what, repr(u), "a step's Solution with load steps")
            assert stress is not None
            return stress.points
        field = np.asarray(u.u if isinstance(u, Solution) else u, dtype=np.float64)
        fits = field.shape == self.mesh.points.shape and np.isfinite(field).all()
        expected = f"{self.mesh.points.shape} finite numbers"
        require(fits, "Deck.point_stress: u", f"shape {field.shape}", expected)
        found = point_stresses(self, field, step.temperature)
        return {kind: one + self.initial_stress.get(kind, 0.0) for kind, one in found.items()}

    def _step(self, number: int) -> Step:
        expected = f"1 … {len(self.steps)}, the deck's steps"
        require(1 <= number <= len(self.steps), "Deck: step", repr(number), expected)
        return self.steps[number - 1]

    def model_of(self, steps: Sequence[Step]) -> Model:
        """With what acts in each of some ``steps`` that hold the same as a load case."""
        following: dict[str, Any] = {}
        if self.nonlinear:
            loads = [replace(load, case=k) for k, step in enumerate(steps) for load in step.loads]
            zero = np.zeros(self.mesh.node_count)
            warm = [zero if step.temperature is None else step.temperature for step in steps]
            following = {"loads": loads, "temperature": np.stack(warm) if np.any(warm) else None}
        return Model(
            self.mesh,
            self.materials,
            fixed=steps[0].fixed,
            prescribed=np.stack([step.prescribed for step in steps]),
            forces=np.stack([step.forces for step in steps]),
            material_of_cell=self.material_of_cell,
            constraints=steps[0].constraints,
            **following,
        )


def _case(both: Solution, case: int) -> Solution:
    """One load case of a solution as a solution of its own."""
    return replace(
        both,
        u=both.u[case],
        reactions=both.reactions[case],
        residuals=both.residuals[:, case : case + 1],
        strain_energy=both.strain_energy[case : case + 1],
        external_work=both.external_work[case : case + 1],
    )
