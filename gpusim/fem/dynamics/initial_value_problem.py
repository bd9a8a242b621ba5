"""Initial value problems of a body: what moves, from where, and what acts on it when."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.model.dead_loads import with_dead_loads
from gpusim.fem.model.mass import ElementMass, check_densities, scalar_mass
from gpusim.fem.model.model import Model
from gpusim.fem.model.record import Record
from gpusim.fem.model.solution import Solution
from gpusim.validation import finite_numbers, require

Loads = npt.ArrayLike | Record | Callable[[float], npt.ArrayLike]
Initial = Solution | tuple[npt.ArrayLike, npt.ArrayLike]

# of the greatest displacement or velocity, that constraints may miss at first
_CONSISTENT = 1e-6


@dataclass(frozen=True, eq=False)
class InitialValueProblem:
    """M a + C v + f_int(u) = the load cases of ``model`` by ``factors`` (R,K), from displacements
    ``u`` and velocities ``v`` (N,3). ``mass_rule`` and ``formulation`` say how M and f_int are
    found. The first acceleration is what M + ``onset`` K makes of forces that aren't balanced.
    Where the ``ground`` moves, the last three load cases are its accelerations along x y z."""

    model: Model
    formulation: Mapping[str, str]
    mass_rule: str
    factors: Record
    u: Float
    v: Float
    onset: float = 0.0
    ground: bool = False

    @property
    def linear_equation(self) -> EquationOfMotion:
        """M and K about the state at rest."""
        return EquationOfMotion.of(self.model, self.formulation, self.mass_rule)

    def forces(self, equation: EquationOfMotion) -> Float:
        """(K,3N) of the load cases in the rows of an ``equation``."""
        return equation.forces(with_dead_loads(self.model, self.formulation).load_cases)

    @property
    def load_names(self) -> list[str]:
        """(K) of the load cases."""
        own = len(self.model.load_cases) - 3 * self.ground
        ground = [f"motion of the ground along {axis}" for axis in "xyz" if self.ground]
        return [*(f"load case {number}" for number in range(own)), *ground]

    def missed(self, step: float) -> float:
        """The share of a factor's sum over time that steps miss, of the one that they miss most."""
        first, last = self.factors.times[[0, -1]]
        grid = np.append(np.arange(first, last, step), last)
        exact, seen = (
            np.trapezoid(np.abs(self.factors.at(times)), times, axis=0)
            for times in (np.union1d(grid, self.factors.times), grid)
        )
        return float((np.abs(seen - exact) / np.maximum(exact, 1e-300)).max())


def checked_model(model: Model) -> Model:
    """Raises InputError for what can't move as it is told to."""
    check_densities(model)
    expected = "none: move the ground (base=...), or push with forces"
    moved = bool(model.prescribed_cases.any())
    require(not moved, "transient: prescribed displacements", "some that aren't 0", expected)
    constant = any(one.right.any() for one in model.constraints)
    require(not constant, "transient: constraints", "constant parts", "equations with right = 0")
    return model


def load_factors(loads: Loads | None, cases: int, times: Float, spacing: float) -> Record:
    """(R,L) from the first to the last of ``times``. A function is asked every ``spacing``."""
    if loads is None:
        return Record(times[[0, -1]], np.ones((2, cases)))
    if callable(loads):
        steps = int(np.ceil((times[-1] - times[0]) / spacing))
        asked = np.linspace(times[0], times[-1], steps + 1)
        shapes, expected = [(cases,), ()][: 1 + (cases == 1)], f"{cases} finite factors"
        found = [
            finite_numbers(loads(float(t)), "transient: loads", shapes, expected) for t in asked
        ]
        loads = Record(asked, np.reshape(found, (-1, cases)))
    elif not isinstance(loads, Record):
        shapes = [(len(times), cases)] + [(len(times),)] * (cases == 1)
        expected = f"finite numbers at each of the {len(times)} times, for {cases} load cases"
        loads = Record(times, finite_numbers(loads, "transient: loads", shapes, expected))
    width, expected = loads.values.shape[1], f"{cases}, one for each load case"
    require(width == cases, "transient: loads: factors", width, expected)
    return loads.within(times[0], times[-1], "transient: loads")


def with_moving_ground(problem: InitialValueProblem, base: Record | None) -> InitialValueProblem:
    """With the forces of inertia on a body whose ground has the accelerations (R,3) of ``base``:
    displacements are relative to it."""
    if base is None:
        return problem
    require(isinstance(base, Record), "transient: base", type(base).__name__, "a Record, or None")
    width = base.values.shape[1]
    require(width == 3, "transient: base: components", width, "3 accelerations, x y z")
    factors, model = problem.factors, problem.model
    ground = base.within(factors.times[0], factors.times[-1], "transient: base")
    elements = ElementMass(model, problem.formulation, problem.mass_rule)
    weight = np.asarray(scalar_mass(elements).sum(axis=1))
    inertia = -weight[None] * np.eye(3)[:, None]
    warm = model.temperature
    if warm is not None:
        warm = np.concatenate([warm, np.zeros((3, warm.shape[1]))])
    times = np.union1d(factors.times, ground.times)
    return replace(
        problem,
        model=replace(model, forces=np.concatenate([model.load_cases, inertia]), temperature=warm),
        factors=Record(times, np.hstack([factors.at(times), ground.at(times)])),
        ground=True,
    )


def initial_state(model: Model, initial: Initial | None) -> tuple[Float, Float]:
    """Displacement and velocity (N,3)."""
    shape = model.mesh.points.shape
    if initial is None:
        return np.zeros(shape), np.zeros(shape)
    expected = f"a Solution with u {shape}, or (u, v) {shape} each"
    if isinstance(initial, Solution):
        initial = initial.u, np.zeros(shape)
    pair = isinstance(initial, tuple) and len(initial) == 2
    require(pair, "transient: initial", type(initial).__name__, expected)
    u, v = (finite_numbers(one, "transient: initial", [shape], expected) for one in initial)
    assert model.fixed is not None
    for moved in (u, v):
        what, allowed = "transient: initial", _CONSISTENT * np.abs(moved).max()
        require(not moved[model.fixed].any(), what, "motion of fixed nodes", "0 where model.fixed")
        for one in model.constraints:
            fits = bool(np.abs(one.matrix @ moved.ravel()).max(initial=0.0) <= allowed)
            require(fits, what, "motion against constraints", "what they allow")
    return u, v
