"""Load cases that are iterated each by itself: bits, errors, and what is told of them."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.system import System, make_system
from gpusim.fem.krylov.cg import NumpyCG, Preconditioner
from gpusim.fem.krylov.error_estimates import Norm
from gpusim.fem.krylov.outer_iteration import Outcome, each_case, iterate
from gpusim.fem.model.model import resolve_formulation
from gpusim.mesh import Mesh, box
from gpusim.parallel.machine import limited

Float = npt.NDArray[np.float64]

# enough unknowns for copies of the process
LATTICE = box((1.0, 0.9, 0.8), (16, 14, 13))


def loaded(mesh: Mesh, cases: tuple[int, ...], nu: float = 0.3) -> Model:
    """Clamped at x = 0; the cases of these numbers out of three, a lazy one among them."""
    points = mesh.points
    fixed = np.repeat(points[:, :1] < 1e-9, 3, axis=1)
    forces = np.zeros((3, *points.shape))
    forces[0, points[:, 0] > 1.0 - 1e-9] = (0.0, 0.0, 1.0)
    forces[1, points[:, 2] > 0.8 - 1e-9] = (1.0, -2.0, 0.3)
    chosen = forces[list(cases)]
    return Model(mesh, [Isotropic(1.0, nu)], fixed=fixed, forces=chosen)


def moved(mesh: Mesh) -> Mesh:
    rng = np.random.default_rng(3)
    inside = ((mesh.points > 1e-9) & (mesh.points < mesh.points.max(axis=0) - 1e-9)).all(axis=1)
    return mesh.moved(0.003 * rng.random(mesh.points.shape) * inside[:, None])


@pytest.mark.parametrize(
    ("mesh", "nu"),
    [(LATTICE, 0.3), (moved(LATTICE), 0.3), pytest.param(LATTICE, 0.4999, marks=pytest.mark.slow)],
)
def test_a_case_doesnt_depend_on_its_companions(mesh: Mesh, nu: float) -> None:
    options: dict[str, Any] = {"method": "multigrid", "backend": "numpy", "tolerance": 1e-6}
    if nu > 0.49:
        options["formulation"] = "bbar"
    both = solve(loaded(mesh, (0, 1, 2), nu), **options)
    with limited(1):
        in_turn = solve(loaded(mesh, (0, 1, 2), nu), **options)
    np.testing.assert_array_equal(both.u, in_turn.u)
    np.testing.assert_array_equal(both.residuals, in_turn.residuals)
    assert both.message == in_turn.message
    alone = [solve(loaded(mesh, (case,), nu), **options) for case in (0, 1)]
    for case, one in enumerate(alone):
        np.testing.assert_array_equal(both.u[case], one.u[0])
        np.testing.assert_array_equal(both.reactions[case], one.reactions[0])
    assert not both.u[2].any()
    assert both.converged
    assert both.error_estimate == max(one.error_estimate for one in alone)
    assert both.iterations == max(one.iterations for one in alone)
    assert both.residuals.shape == (max(len(one.residuals) for one in alone), 3)
    assert np.isfinite(both.residuals).all()
    assert both.energy_balance < 1e-5


@pytest.mark.parametrize(
    ("method", "nu"),
    [("multigrid", 0.3), ("multigrid", 0.4999)],
)
def test_prescribed_displacements_are_each_cases_own(method: str, nu: float) -> None:
    both = loaded(LATTICE, (0, 1), nu)
    assert both.fixed is not None and both.forces is not None
    prescribed = np.zeros_like(both.forces)
    prescribed[1, LATTICE.points[:, 0] < 1e-9] = (0.01, 0.0, -0.02)
    prescribed[1] += 0.1 * np.where(both.fixed, LATTICE.points, 0.0)
    options: dict[str, Any] = {"tolerance": 1e-5, "method": method, "backend": "numpy"}
    options["formulation"] = "bbar"
    found = solve(replace(both, prescribed=prescribed), **options)
    for case, (forces, given) in enumerate(zip(both.forces, prescribed, strict=True)):
        one = solve(replace(both, forces=forces, prescribed=given), **options)
        np.testing.assert_array_equal(found.u[case], one.u)
        np.testing.assert_array_equal(found.reactions[case], one.reactions)


def test_starts_and_progress_are_each_cases_own(tmp_path: Path) -> None:
    model = loaded(LATTICE, (0, 1))
    options: dict[str, Any] = {"method": "multigrid", "backend": "numpy"}
    known = solve(model, tolerance=1e-8, **options).u
    heard: list[tuple[int, float]] = []
    note = tmp_path / "pids"

    def hear(iterations: int, error: float) -> None:
        heard.append((iterations, error))
        with note.open("a") as file:
            file.write(f"{os.getpid()} ")

    cold = solve(model, progress=hear, **options)
    counts = [iterations for iterations, _ in heard]
    assert counts == sorted(counts)
    assert set(note.read_text().split()) == {str(os.getpid())}
    assert counts[0] == 1
    warm = solve(model, start=known, **options)
    assert warm.iterations < cold.iterations
    crossed = solve(model, start=known[::-1], **options)
    assert crossed.iterations >= cold.iterations
    np.testing.assert_allclose(crossed.u, known, atol=1e-6 * np.abs(known).max())


def test_the_worst_case_is_told_of() -> None:
    model = loaded(LATTICE, (0, 1))
    found = solve(model, method="multigrid", backend="numpy", max_iterations=3, tolerance=1e-12)
    assert not found.converged
    assert found.message == "stopped after 3 iterations"
    assert found.residuals.shape == (3, 2)


def test_a_cases_error_is_raised() -> None:
    model = loaded(LATTICE, (0, 1))
    system = make_system(model, assemble(model, resolve_formulation(model, None)))

    def fails(part: System, start: Any, progress: Any) -> Outcome:
        if (part.right == system.right[1]).all():
            raise NotConverged("case 1; got nothing; expected something")
        return Outcome(part.right, True, 0.0, 1, np.ones((1, 1)), "converged")

    with pytest.raises(NotConverged, match="case 1; got nothing"):
        each_case(fails, system, None, None)


class _Identity(Preconditioner):
    def apply(self, r: Float) -> Float:
        return r


def test_errors_name_the_load_case() -> None:
    model = loaded(LATTICE, (2, 0))
    system = make_system(model, assemble(model, resolve_formulation(model, None)))

    def fails(part: System, start: Any, progress: Any) -> Outcome:
        loop = NumpyCG(lambda x: -x, _Identity())
        return iterate(
            part, loop, Norm(1.0), start,
            tolerance=1e-6, most=3, progress=progress, rounding=lambda *_: 0.0,
        )  # fmt: skip

    with pytest.raises(NotConverged, match="negative curvature in load case 1"):
        each_case(fails, system, None, None)
