"""Modal analysis: natural frequencies and mode shapes, K u = omega^2 M u."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.eigenvalues.davidson import Pencil, davidson
from gpusim.fem.eigenvalues.rayleigh_quotients import AIM, rayleigh_ritz, sharpened
from gpusim.fem.eigenvalues.rigid_body_modes import RigidBodyModes, rigid_body_modes
from gpusim.fem.linear.shifted_solver import ShiftedSolver, definite_solver, with_factors
from gpusim.fem.linear.solve_plan import METHODS, Clock, Options
from gpusim.fem.model.elimination import solved_for
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.fem.procedures.statics import Tolerance
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.parallel.machine import host_memory, keep_freed_memory
from gpusim.validation import Count, checked, finite_numbers, one_of, require

# modes of one band, at most
_MOST = 1000
# share of the free memory that the basis of the iteration may take
_MEMORY = 0.5
# of the greatest 1 / lambda: less belongs to motions without mass
_MASSLESS = 1e-15
# error of frequencies by that of a prestress, above which a warning says so
_OPEN = 1e-5
# rows to begin with; times that a shift is brought nearer to the lowest elastic value, and of that
# the multiple beyond which modes are hard to tell apart
_START, _SHIFTS, _FAR = 8, 6, 2.0


@checked
def modes(
    model: Model,
    count: Count = 10,
    *,
    band: tuple[float, float] | None = None,
    mass: Annotated[str, one_of(*MASS_RULES)] = "exact",
    formulation: str | Mapping[str, str] | None = None,
    tolerance: Tolerance = 1e-8,
    method: Annotated[str, one_of(*METHODS)] = "auto",
    prestress: Solution | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Modes:
    """The lowest natural frequencies of a model, and their mode shapes.

    Loads and prescribed displacements don't matter, unless by ``prestress``: supports hold still.
    What isn't held moves as a rigid body (at 0 Hz), which isn't computed but known.

    Parameters
    ----------
    model : see `gpusim.Model`; its materials need densities.
    count : how many modes, rigid-body modes included.
    band : (low, high) Hz: all modes in it, at most 1000 below ``high``, in place of ``count``.
    mass : rule of the mass matrix, see `gpusim.fem.mass_matrix`.
    formulation : see `gpusim.solve`.
    tolerance : relative error of the frequencies to reach, as the mesh has them.
    method : "direct", "multigrid", or "auto": what is cheaper for a static solve.
    prestress : a solution of this model, linear or nonlinear, about whose last state it vibrates:
        tension stiffens, compression softens.
    progress : called with (steps, worst error so far).

    Raises
    ------
    InputError
        A wrong argument, a material without density, more modes than unknowns, more than memory
        holds.
    NotConverged
        A stiffness that isn't positive definite: an unstable prestress, or motions without
        stiffness that aren't rigid ('reduced' elements have such); a nearly incompressible body
        whose factors don't fit. Modes that aren't good enough after many steps are no error:
        ``Modes.converged`` is False.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> steel = gs.Isotropic(210e9, 0.3, density=7850.0)
    >>> gs.modes(gs.Model(bar, steel, fixed), count=4).frequencies.round(1)
    array([ 83.8,  83.8, 522.6, 522.6])
    """
    require(isinstance(model, Model), "modes model", type(model).__name__, "a Model")
    limits = None if band is None else _limits(band)
    keep_freed_memory()
    names, clock = resolve_formulation(model, formulation), Clock()
    options = Options(method, None, "numpy", tolerance, None, None, progress, names, clock)
    check_count(model, count if limits is None else 1, "modes")
    with one_blas_thread():
        equation = equation_about(prestress, model, names, mass, "modes")
        clock.mark("assembly")
        rigid = rigid_body_modes(equation)
        most = min(int(count), int(equation.unknown.sum()))
        try:
            search = _Search(equation, rigid, options)
        except NotConverged as error:
            if prestress is None or "definite" not in str(error):
                raise
            raise NotConverged(
                "modes: prestress; got a state that isn't stable (its stiffness isn't positive "
                "definite); expected less load: gpusim.buckling finds how much a body bears"
            ) from None
        found = search.lowest(most - len(rigid.names))
        if limits is not None:
            found = search.up_to((2.0 * np.pi * limits[1]) ** 2, found)
        by_stress = np.zeros_like(found.error)
        if prestress is not None:
            by_stress = _errors_by_stress(equation, found, prestress, names)
        return _result(search, found, limits, int(count), by_stress)


def check_count(model: Model, count: int, what: str) -> None:
    """Raises InputError, naming ``what``, for more modes than a model has unknowns."""
    unknowns = int(solved_for(model).sum())
    require(count <= unknowns, f"{what}: count", count, f"at most {unknowns}, the unknowns")


def _limits(band: tuple[float, float]) -> Float:
    expected = "(low, high) in Hz, 0 <= low < high"
    limits = finite_numbers(band, "modes: band", [(2,)], expected)
    require(bool(0.0 <= limits[0] < limits[1]), "modes: band", band, expected)
    return limits


def equation_about(
    prestress: Solution | None, model: Model, formulation: Mapping[str, str], mass: str, what: str
) -> EquationOfMotion:
    """Of a model about a state of it, or at rest. Raises InputError, naming ``what``, for another
    model's."""
    if prestress is None:
        return EquationOfMotion.of(model, formulation, mass)
    known = isinstance(prestress, Solution)
    got = "one of another model" if known else repr(prestress)
    own = known and prestress.model is model
    require(own, f"{what}: prestress", got, "a Solution of this model, or None")
    return EquationOfMotion.at(prestress, formulation, mass)


def _errors_by_stress(
    equation: EquationOfMotion, found: _Elastic, state: Solution, formulation: Mapping[str, str]
) -> Float:
    """(k,) relative, of frequencies: what the error of a ``state`` leaves open of lambda is that
    share of what the state has made of it, as stiffness is nearly linear in displacements."""
    at_rest = EquationOfMotion.of(state.model, formulation, None)
    x = at_rest.unknowns(equation.displacements(found.rows))
    energy = np.einsum("ij,ij->i", x, at_rest.stiffness(x)) * at_rest.scale / equation.scale
    return np.asarray(0.5 * state.error_estimate * np.abs(1.0 - energy / found.values))


@dataclass(frozen=True, eq=False)
class _Elastic:
    """``values`` (k,) of lambda, rows x (k,3N) orthonormal in the equation's mass, and ``error``
    (k,) of the frequencies, which the iteration has ``settled`` after so many ``steps``."""

    values: Float
    rows: Float
    error: Float
    settled: bool
    steps: int


class _Search:
    """Of elastic modes, beside the rigid ones that are known."""

    def __init__(self, equation: EquationOfMotion, rigid: RigidBodyModes, options: Options) -> None:
        self.equation, self.rigid, self.options = equation, rigid, options
        self.shift = rigid.value
        self._prepare()
        self._start = self._pencil.random(_START, 0)
        for _ in range(_SHIFTS if self.shift else 0):
            # rows in which the lowest modes prevail give a bound from above
            rows = self._elastic(self._start)
            values, _ = rayleigh_ritz(equation.stiffness, equation.inertia, rows)
            if self.shift * values[0] <= _FAR:
                break
            self.shift = float(1.0 / values[0])
            self._prepare()
            self._start = self._pencil.solve(equation.inertia(self._start))
        options.clock.mark("solver")

    def _elastic(self, rows: Float) -> Float:
        """Without what is rigid in them."""
        return rows - (rows @ self.equation.inertia(self.rigid.rows).T) @ self.rigid.rows

    def _prepare(self) -> None:
        self._take(definite_solver(self.equation, self.shift, self.options))

    def _take(self, solver: ShiftedSolver) -> None:
        self.solver = solver
        # A-orthonormal: rigid motions have the energy of the shift alone
        known = self.rigid.rows / np.sqrt(self.shift or 1.0)
        self._pencil = Pencil(
            solver.energy, self.equation.inertia, solver.apply, self.equation.unknown, known,
            solver.weakest, _MASSLESS,
        )  # fmt: skip

    def lowest(self, count: int) -> _Elastic:
        """The ``count`` lowest."""
        if count <= 0:
            none = np.zeros(0)
            return _Elastic(none, np.zeros((0, len(self.equation.unknown))), none, True, 0)
        need = 16 * (2 * count + 40) * len(self.equation.unknown)
        expected = f"at most {_MEMORY:.0%} of the free memory: fewer modes, or a narrower band"
        fits = need <= _MEMORY * host_memory()
        require(fits, f"modes: {count} modes need", f"{need / 1e9:.1f} GB", expected)
        # twice the error of a frequency is that of lambda, which is more of it than of lambda + s
        aim = 2.0 * self.options.tolerance / (1.0 + 2.0 * _FAR if self.shift else 1.0)
        pairs = davidson(self._pencil, count, AIM * aim, self._start, self.options.progress)
        self._start = pairs.vectors
        if not pairs.converged and self.options.method == "auto" and self.solver.may_be_exact:
            why = "multigrid hadn't found all modes"
            self._take(with_factors(self.equation, self.shift, self.options, why))
            return self.lowest(count)
        mu, rows, rounding = sharpened(self.equation, self.equation.inertia, pairs.vectors, aim)
        having = int((mu > max(_MASSLESS * mu[0], 1e-300)).sum())
        require(having == count, "modes: count", count, f"at most {having} that have mass")
        error = 0.5 * (pairs.error * mu / pairs.values + rounding)
        return _Elastic(1.0 / mu, rows / np.sqrt(mu[:, None]), error, pairs.converged, pairs.steps)

    def up_to(self, value: float, found: _Elastic) -> _Elastic:
        """All with lambda up to a ``value``, and some beyond, beginning with what was found."""
        beyond = f"more than {_MOST} below its upper end"
        many = _least_count(self.equation, value) > _MOST
        require(not many, "modes: modes of the band", beyond, "a narrower band")
        rigid = len(self.rigid.names)
        most = int(self.equation.unknown.sum()) - rigid
        count = max(len(found.values), 1)
        while not (found.values > value).any() and len(found.values) < most:
            require(count < _MOST, "modes: modes of the band", beyond, "a narrower band")
            count = min(2 * count, _MOST, most)
            found = self.lowest(count)
        return found


def _least_count(equation: EquationOfMotion, value: float) -> float:
    """Modes with lambda up to ``value``, a third of what waves in a body of this mass make (Weyl's
    law, see Dupuis, Mazo & Onsager, J. Chem. Phys. 33 (1960) 1452), which slender bodies exceed."""
    materials = equation.model.materials
    volume = float(equation.mass.sum()) / max(one.density for one in materials)
    slowness = [
        min(one.density / one.stiffness()[k, k] for one in materials) ** 1.5 for k in (0, 3, 3)
    ]
    waves = volume * value**1.5 * sum(slowness) / (6.0 * np.pi**2)
    return min(float(waves) / 3.0, float(equation.unknown.sum()))


def _result(
    search: _Search, found: _Elastic, limits: Float | None, count: int, by_stress: Float
) -> Modes:
    """In the model's units, with what motions of its supports say: modes within ``limits`` (2,) Hz,
    or the first ``count``; ``by_stress`` (k,): errors that aren't the iteration's."""
    equation, options, names = search.equation, search.options, search.rigid.names
    still = np.zeros(len(names))
    frequencies = np.concatenate([still, np.sqrt(found.values) / (2.0 * np.pi)])
    chosen = np.arange(len(frequencies)) < count
    if limits is not None:
        chosen = (frequencies >= limits[0]) & (frequencies <= limits[1])
    frequencies, error = frequencies[chosen], np.concatenate([still, found.error])[chosen]
    x = np.concatenate([search.rigid.rows, found.rows])[chosen] / np.sqrt(equation.scale)
    x *= np.sign(np.take_along_axis(x, np.abs(x).argmax(axis=1)[:, None], axis=1))
    centre, total, base = equation.base_motions()
    participation = equation.scale * x @ base.T
    how = how_found(search.solver, options, found.settled, error, found.steps)
    error = error + np.concatenate([still, by_stress])[chosen]
    told = (
        f"frequencies are known to {by_stress.max(initial=0.0):.1e} alone, by the error of the "
        "prestress, which is near buckling: a smaller tolerance of its solution mends that"
    )
    return Modes(
        frequencies=frequencies,
        shapes=equation.displacements(x),
        participation=participation,
        effective_mass=participation**2,
        total_mass=total,
        centre=centre,
        error_estimate=error,
        rigid=tuple(np.array(names)[chosen[: len(names)]].tolist()),
        below=int(np.argmax(chosen)),
        warnings=(told,) if (by_stress > _OPEN).any() else (),
        **how,
    )


def how_found(
    solver: ShiftedSolver, options: Options, settled: bool, error: Float, steps: int
) -> dict[str, Any]:
    """What results of an eigenvalue problem tell as a `Computation`, of an iteration that has
    ``settled`` after so many ``steps``, with estimated errors (n,)."""
    worst = float(error.max(initial=0.0))
    converged = settled and worst <= options.tolerance
    message = f"estimated errors of up to {worst:.1e} after {steps} steps"
    options.clock.mark("iteration")
    return {
        "converged": converged,
        "message": "converged" if converged else message,
        "steps": steps,
        "unknowns": int(solver.equation.unknown.sum()),
        "timings": options.clock.timings,
        "method": "direct" if solver.exact else "multigrid",
        "reasons": solver.plan.lines,
        "model": solver.equation.model,
    }
