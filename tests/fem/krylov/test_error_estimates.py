"""The estimate: near the error and never below; what rounding leaves is part of it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.system import make_system
from gpusim.fem.krylov import error_estimates
from gpusim.fem.krylov import outer_iteration as iteration
from gpusim.fem.krylov.error_estimates import BELOW, Estimates, Norm, RoundingError
from gpusim.fem.model.model import resolve_formulation
from gpusim.mesh import Mesh

Float = npt.NDArray[np.float64]


def cube() -> Model:
    mesh = gs.mesh.box(size=(1.0, 0.8, 0.7), divisions=(7, 6, 5))
    fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    forces = np.random.default_rng(3).normal(size=(3, *mesh.points.shape))
    return Model(mesh, [Isotropic(1.0, 0.3)], fixed=fixed, forces=forces)


def test_an_estimate_that_is_too_large_by_what_rounding_leaves_is_made_smaller(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(iteration, "VISIBLE", 0.5)
    rounding = 0.0
    monkeypatch.setattr(RoundingError, "__call__", lambda self, system, u: rounding)
    for tolerance in np.geomspace(1e-4, 1e-7, 16):
        alone = solve(cube(), backend="numpy", method="multigrid", tolerance=tolerance)
        if alone.error_estimate > 0.65 * tolerance:
            break
    else:
        raise AssertionError("none ends near its tolerance")
    # a little more than there is room for
    rounding = 1.02 * tolerance - alone.error_estimate
    solution = solve(cube(), backend="numpy", method="multigrid", tolerance=tolerance)
    assert solution.converged and rounding < solution.error_estimate <= tolerance
    assert solution.iterations > alone.iterations
    exact = solve(cube(), backend="numpy", method="direct", tolerance=1e-9)
    assert np.abs(solution.u - exact.u).max() <= tolerance * np.abs(exact.u).max()
    # it wouldn't have been by itself
    monkeypatch.setattr(iteration, "_LITTLE", 0.0)
    short = solve(cube(), backend="numpy", method="multigrid", tolerance=tolerance)
    assert not short.converged and "rounding of the stiffness" in short.message


def held(
    mesh: Mesh, pull: tuple[float, float, float], nu: float = 0.3, corner: bool = False
) -> Model:
    """Clamped at the least x, or in a corner, and pulled at the greatest x."""
    points = np.asarray(mesh.points)
    held_here = points <= 0.12 * np.ptp(points, axis=0).max() if corner else points[:, :1] <= 1e-9
    fixed = np.repeat(held_here.all(axis=1, keepdims=True), 3, axis=1)
    forces = np.zeros(points.shape)
    forces[points[:, 0] >= points[:, 0].max() - 1e-9] = pull
    return Model(mesh, [Isotropic(1.0, nu)], fixed=fixed, forces=forces)


def block() -> Model:
    mesh = gs.mesh.split(gs.mesh.box((1.0, 0.9, 0.8), (5, 4, 4)), "tet4")
    return held(gs.mesh.quadratic(mesh), (0.3, 0.2, -1.0), corner=True)


def rubber() -> Model:
    return held(gs.mesh.box((4.0, 1.0, 0.7), (24, 6, 4)), (0.3, 0.2, -1.0), nu=0.4999)


@pytest.mark.parametrize(("build", "rule"), [(block, {}), (rubber, {"hex8": "bbar"})])
def test_the_estimate_is_near_the_error_and_never_below(
    build: Callable[[], Model], rule: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    model = build()
    exact = solve(model, method="direct", tolerance=1e-8, formulation=rule).u
    options: dict[str, Any] = {"method": "multigrid", "backend": "numpy", "formulation": rule}
    saved = 0
    for tolerance in (1e-4, 1e-5, 1e-6):
        monkeypatch.setattr(error_estimates, "_SHARP", 2.5)
        found = solve(model, tolerance=tolerance, **options)
        errors = (
            np.abs(found.u - exact).max() / np.abs(exact).max(),
            np.linalg.norm(found.u - exact) / np.linalg.norm(exact),
        )
        assert found.converged
        assert max(errors) <= found.error_estimate <= min(tolerance, 30.0 * max(errors))
        # the bound by the softest mode alone
        monkeypatch.setattr(error_estimates, "_SHARP", np.inf)
        saved += solve(model, tolerance=tolerance, **options).iterations - found.iterations
    assert saved >= 5


def test_softer_motions_that_come_up_late_are_covered() -> None:
    """A thin plate pulled along bends a little about its clamp, which first steps hardly feel."""
    mesh = gs.mesh.quadratic(gs.mesh.box((1.0, 0.9, 0.0166), (12, 11, 1)))
    model = held(mesh, (1.0, 0.0, 0.0), corner=True)
    exact = solve(model, method="direct", tolerance=1e-9).u
    for tolerance in (1e-5, 1e-6, 1e-7):
        found = solve(model, method="multigrid", backend="numpy", tolerance=tolerance)
        error = np.abs(found.u - exact).max() / np.abs(exact).max()
        assert found.converged and error <= found.error_estimate <= tolerance


class Seen:
    """A loop whose M^-1 r is known."""

    def __init__(self, z: Float) -> None:
        self._z = z

    def preconditioned(self) -> Float:
        return self._z


def test_the_softness_of_what_is_left_counts_where_all_is_known() -> None:
    model = cube()
    system = make_system(model, assemble(model, resolve_formulation(model, None)))
    system = system.case(0)
    state = Estimates(system, Norm(1e-3))
    total = np.where(system.free, 1.0, 0.0)[None]
    step, rz = 1e-4 * total, np.array([4e-12])
    history = np.array([[[0.09 / 0.3, 0.3, 0.5, 1.0]]])  # an energy norm of 0.3

    def estimate(z: float, enough: float = 1.0) -> float:
        return float(state.by_softness(rz, Seen(z * total.reshape(1, -1)), total, enough)[0])

    state.mu = np.array([0.25])
    assert estimate(1e-9) == np.inf  # no step yet
    state.follow(step, 1e-2 * total, history, total)
    assert estimate(1e-9) == np.inf  # a correction as stiff as that doesn't feel the softest mode
    state.follow(step, total, history, total)
    energy = 2e-6 / np.sqrt(BELOW * 0.25)
    # as soft as the last step, or less so: that one counts
    assert estimate(1e-12) == pytest.approx(2.5 * energy * 1e-4 / 0.3)
    # twice as soft: so may be what follows
    z = 2.0 * 1e-4 / 0.3 * np.sqrt(0.25 * 4e-12)
    assert estimate(z) == pytest.approx(2.5 * energy * 4.0 * 1e-4 / 0.3)
    # the greatest displacement counts where it is more beside that of the whole
    one = np.zeros_like(total)
    one[0, -1, 0] = z
    tall = state.by_softness(rz, Seen(one.reshape(1, -1)), total, 1.0)
    assert tall[0] == pytest.approx(estimate(z))
    assert estimate(z, enough=1e-9) == np.inf
    for name, value in (("mu", np.array([0.02])), ("probed", True), ("lowest", 1e-18)):
        before = getattr(state, name)
        setattr(state, name, value)
        assert estimate(z) == np.inf, name
        setattr(state, name, before)
    assert np.isfinite(estimate(z))
