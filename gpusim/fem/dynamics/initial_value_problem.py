"""Initial value problems of a body: what moves, from where, and what acts on it when."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.model.dead_loads import with_dead_loads
from gpusim.fem.model.mass import inertia_forces
from gpusim.fem.model.model import Model
from gpusim.fem.model.record import Record
from gpusim.fem.model.solution import Solution
from gpusim.fem.model.supports import free_motions
from gpusim.validation import finite_numbers, require

Loads = npt.ArrayLike | Record
Initial = Solution | tuple[npt.ArrayLike, npt.ArrayLike]

# of the greatest displacement or velocity, that constraints may miss at first
_CONSISTENT = 1e-6
# of what the ground swings about its mean way, by which it ends away from where it began
_AWAY = 3.0


@dataclass(frozen=True, eq=False)
class InitialValueProblem:
    """M a + C v + f_int(u) = the load cases of ``model`` by ``factors`` (R,K), from displacements
    ``u`` and velocities ``v`` (N,3). ``mass_rule`` and ``formulation`` say how M and f_int are
    found."""

    model: Model
    formulation: Mapping[str, str]
    mass_rule: str
    factors: Record
    u: Float
    v: Float

    @property
    def linear_equation(self) -> EquationOfMotion:
        """M and K about the state at rest."""
        return EquationOfMotion.of(self.model, self.formulation, self.mass_rule)

    def forces(self, equation: EquationOfMotion) -> Float:
        """(K,3N) of the load cases in the rows of an ``equation``."""
        return equation.forces(with_dead_loads(self.model, self.formulation).load_cases)

    def missed(self, step: float) -> float:
        """The share of a factor's sum over time that steps miss, of the one that they miss most."""
        first, last = self.factors.times[[0, -1]]
        grid = np.append(np.arange(first, last, step), last)
        exact, seen = (
            np.trapezoid(np.abs(self.factors.at(times)), times, axis=0)
            for times in (np.union1d(grid, self.factors.times), grid)
        )
        return float((np.abs(seen - exact) / np.maximum(exact, 1e-300)).max())


def load_factors(loads: Loads | None, cases: int, times: Float) -> Record:
    """(R,L) from the first to the last of ``times``."""
    if loads is None:
        return Record(times[[0, -1]], np.ones((2, cases)))
    if not isinstance(loads, Record):
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
    factors, model, warm = problem.factors, problem.model, problem.model.temperature
    ground = base.within(factors.times[0], factors.times[-1], "transient: base")
    inertia = inertia_forces(model, problem.formulation, problem.mass_rule)
    if warm is not None:
        warm = np.concatenate([warm, np.zeros((3, warm.shape[1]))])
    times, forces = np.union1d(factors.times, ground.times), [*model.load_cases, *inertia]
    model = replace(model, forces=np.stack(forces), temperature=warm)
    factors = Record(times, np.hstack([factors.at(times), ground.at(times)]))
    return replace(problem, model=model, factors=factors)


def drifts(model: Model, base: Record | None, times: Float) -> Iterator[str]:
    """What lets displacements grow on a ground that moves, at ``times``: a body that isn't held,
    and accelerations by which the ground goes away rather than to and fro."""
    if base is None:
        return
    ground = base.within(times[0], times[-1], "transient: base")
    if any(True for _ in free_motions(model)):
        yield "base moves the ground alone: supports leave the body free to stay behind"
    lapse = ground.times - ground.times[0]
    path = make_interp_spline(lapse, ground.values, k=1).antiderivative(2)
    along = path(lapse[-1])
    swing = np.abs(path(lapse) - lapse[:, None] / lapse[-1] * along).max(axis=0)
    for axis in np.flatnonzero(np.abs(along) > _AWAY * swing):
        yield (
            f"the ground of base goes away along {'xyz'[axis]}, by {along[axis]:.3g} in all: "
            f"it has a mean velocity of {along[axis] / lapse[-1]:.3g} (is its record without a "
            "baseline correction?)"
        )


def initial_state(model: Model, initial: Initial | None) -> tuple[Float, Float]:
    """Displacement and velocity (N,3)."""
    shape, what = model.mesh.points.shape, "transient: initial"
    if initial is None:
        return np.zeros(shape), np.zeros(shape)
    if isinstance(initial, Solution):
        initial = initial.u, np.zeros(shape)
    expected = f"a Solution with u {shape}, or (u, v) {shape} each"
    pair = isinstance(initial, tuple) and len(initial) == 2
    require(pair, what, type(initial).__name__, expected)
    u, v = (finite_numbers(one, what, [shape], expected) for one in initial)
    assert model.fixed is not None
    for moved in (u, v):
        require(not moved[model.fixed].any(), what, "motion of fixed nodes", "0 where model.fixed")
        allowed = _CONSISTENT * np.abs(moved).max()
        off = [np.abs(one.matrix @ moved.ravel()).max(initial=0.0) for one in model.constraints]
        require(all(one <= allowed for one in off), what, "motion against constraints", "none")
    return u, v
