"""Linear buckling: factors of the load at which stiffness is lost, (K + factor K_g) u = 0."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Annotated

import numpy as np

from gpusim.errors import NotConverged
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.assembly.geometric_stiffness import GeometricStiffness
from gpusim.fem.eigenvalues.davidson import Apply, Eigenpairs, Pencil, davidson
from gpusim.fem.eigenvalues.modes import check_count, how_found
from gpusim.fem.eigenvalues.rayleigh_quotients import AIM, sharpened
from gpusim.fem.linear.shifted_solver import ShiftedSolver, definite_solver
from gpusim.fem.linear.solve_plan import METHODS, Clock, Options
from gpusim.fem.model.buckling import Buckling
from gpusim.fem.model.mass import scalar_matrix
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.solution import Solution
from gpusim.fem.procedures.statics import Tolerance, solve
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import Count, checked, one_of, require

# share of the tolerance for the static solution, whose stress is what buckles the body; the error
# that it may have at most
_STATIC, _POOR = 0.1, 0.01
# rows to begin with
_START = 8
# a factor this many times as large as the smallest one of either sign isn't looked for
_BEYOND = 1e4
# of 1 over the lowest factor, from which on that of the load reversed is looked for as well: what
# the search sees of it on the way may be half
_NEAR = 0.5
# stiffness by stress
_LEAST = 1e-140


@checked
def buckling(
    model: Model,
    count: Count = 3,
    *,
    formulation: str | Mapping[str, str] | None = None,
    tolerance: Tolerance = 1e-6,
    method: Annotated[str, one_of(*METHODS)] = "auto",
    progress: Callable[[int, float], None] | None = None,
) -> Buckling:
    """Factors of a model's load at which it buckles, by linear theory, and its shapes there.

    Stress grows with the load, and the body stays as it is until then: good where it hardly moves
    before, as columns and plates in compression; shells and shallow arches may carry far less.
    Loads keep their directions. Displacements that are given to supports are part of the load: they
    grow with it.

    Parameters
    ----------
    model : with one load case, held by its supports.
    count : how many factors.
    formulation, method : see `gpusim.solve`.
    tolerance : relative error of the factors to reach, as the mesh has them.
    progress : called with (steps, worst error so far).

    Raises
    ------
    InputError
        A wrong argument, several load cases, no load, a body that isn't held.
    NotConverged
        No solution under the load, or no positive factor: the load only stiffens the body.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> end = gs.mesh.select_faces(bar, name="x_max")
    >>> push = gs.fem.traction(bar, end, (-1e8, 0, 0))
    >>> found = gs.buckling(gs.Model(bar, gs.Isotropic(210e9, 0.0), fixed, push), count=2)
    >>> euler = np.pi**2 * 210e9 * 0.1**4 / 12 / 4 / 1e6
    >>> (found.factors / euler).round(3)
    array([1., 1.])
    """
    require(isinstance(model, Model), "buckling model", type(model).__name__, "a Model")
    cases = len(model.load_cases)
    expected = "one load case, or the sum of several"
    require(cases == 1, "buckling model: load cases", cases, expected)
    check_count(model, count, "buckling")
    solution = solve(
        model, tolerance=_STATIC * tolerance, formulation=formulation, backend="numpy",
        method=method,
    )  # fmt: skip
    if not solution.error_estimate <= _POOR:
        raise NotConverged(f"buckling: the static solution: {solution.message}")
    names, clock = resolve_formulation(model, formulation), Clock()
    options = Options(method, None, "numpy", tolerance, None, None, progress, names, clock)
    with one_blas_thread():
        return _found(model, solution, int(count), options)


def _found(model: Model, solution: Solution, count: int, options: Options) -> Buckling:
    equation = EquationOfMotion.of(model, options.formulation, None)
    inside, u = equation.element_mass.model, equation.inside(solution.u.reshape(1, -1, 3))[0]
    of_cells = GeometricStiffness(inside, options.formulation, u, np.ones(1))
    stress = scalar_matrix(inside.mesh, of_cells.at)
    # squares of less vanish
    stressed = bool(abs(stress).max() > _LEAST)
    require(stressed, "buckling: model: forces", "no stress", "a load, in ordinary units")
    solver = definite_solver(equation, 0.0, options)
    options.clock.mark("assembly")
    softening = partial(equation.scalar_product, -stress)
    pairs = _greatest(equation, solver, softening, count, options)
    largest, least, settled = pairs.values[0], pairs.least, pairs.converged
    positive = pairs.values > max(largest, -least) / _BEYOND
    if least < -max(_NEAR * largest, -least / _BEYOND):
        hardening = partial(equation.scalar_product, stress)
        reverse = _greatest(equation, solver, hardening, 1, options)
        least, settled = -reverse.values[0], settled and reverse.converged
    opposite = 1.0 / least if least < -largest / _BEYOND else -np.inf
    if not positive.any():
        raise NotConverged(
            "buckling: model: forces; got no positive load factor; expected a load that compresses "
            f"(reversed it buckles the body at {opposite:.4g} times itself)"
        )
    mu, rows, rounding = sharpened(equation, softening, pairs.vectors[positive], options.tolerance)
    shapes = equation.displacements(rows)
    shapes /= np.abs(shapes).max(axis=(1, 2))[:, None, None]
    error = pairs.error[positive] + rounding + solution.error_estimate
    moved = bool(model.prescribed_cases.any())
    told = ("factors multiply the displacements of supports, too",) if moved else ()
    return Buckling(
        factors=1.0 / mu,
        shapes=shapes,
        reversed_factor=opposite,
        error_estimate=error,
        solution=solution,
        warnings=solution.warnings + told,
        **how_found(solver, options, settled, error, pairs.steps),
    )


def _greatest(
    equation: EquationOfMotion, solver: ShiftedSolver, inertia: Apply, count: int, options: Options
) -> Eigenpairs:
    """The ``count`` greatest mu of ``inertia`` x = mu K x, those that aren't negligible."""
    none = np.zeros((0, len(equation.unknown)))
    pencil = Pencil(
        solver.energy, inertia, solver.apply, equation.unknown, none, solver.weakest, 1.0 / _BEYOND
    )
    start, aim = pencil.random(_START, 0), (AIM - _STATIC) * options.tolerance
    return davidson(pencil, count, aim, start, options.progress)
