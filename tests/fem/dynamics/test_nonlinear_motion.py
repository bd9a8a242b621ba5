"""Motion at large displacements: a pendulum, its energy, and small motions as linear theory has
them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.integrate import solve_ivp

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from gpusim.fem.dynamics.initial_value_problem import InitialValueProblem
from gpusim.fem.dynamics.nonlinear_motion import NonlinearMotion
from gpusim.fem.dynamics.time_integration import LinearMotion, Scheme
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.model import resolve_formulation
from tests.support.vibrating_bar import greatest, matrices, vibrating_bar

Float = npt.NDArray[np.float64]
LENGTH, HEIGHT, GRAVITY, DENSITY = 1.0, 0.05, 9.81, 1000.0


def pendulum(modulus: float = 1e9) -> gs.Model:
    """A bar hinged on its lower edge at x = 0, horizontal."""
    mesh = gs.mesh.box((LENGTH, HEIGHT, HEIGHT), (2, 1, 1))
    hinge = (mesh.points[:, 0] == 0.0) & (mesh.points[:, 2] == 0.0)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[hinge], fixed[:, 1] = True, True
    law = gs.SaintVenantKirchhoff(modulus, 0.3, density=DENSITY)
    weight = gs.fem.body_force(mesh, DENSITY, (0.0, 0.0, -GRAVITY))
    return gs.Model(mesh, law, fixed, weight)


def rigid_tip(times: Float) -> Float:
    """(T,2) x and z of the lower edge of the far end."""
    arm, inertia = 0.5 * np.hypot(LENGTH, HEIGHT), (LENGTH**2 + HEIGHT**2) / 3.0
    first = np.arctan2(HEIGHT, LENGTH)

    def slope(_: float, y: Float) -> list[float]:
        return [y[1], -GRAVITY * arm * np.cos(y[0]) / inertia]

    whole = float(times[-1])
    found = solve_ivp(slope, (0.0, whole), [first, 0.0], t_eval=times, rtol=1e-11, atol=1e-12)
    turned = found.y[0] - first
    return LENGTH * np.stack([np.cos(turned), np.sin(turned)], axis=1)


def off_by(history: gs.History) -> tuple[float, float]:
    """The greatest distance from the rigid pendulum's tip, and by how much that one has turned."""
    points = history.model.mesh.points
    tip = np.flatnonzero((points[:, 0] == LENGTH) & (points[:, 2] == 0.0))[0]
    expected = rigid_tip(history.times)
    place = (points + history.u)[:, tip][:, [0, 2]]
    turned = np.unwrap(np.arctan2(expected[:, 1], expected[:, 0]))
    return float(np.linalg.norm(place - expected, axis=1).max()), float(np.ptp(turned))


@pytest.mark.parametrize(
    "method", ["generalized-alpha", pytest.param("newmark", marks=pytest.mark.slow)]
)
def test_a_hinged_bar_swings_as_a_rigid_one(method: str) -> None:
    times = np.linspace(0.0, 0.8, 161)
    history = gs.transient(pendulum(), times=times, method=method, step=0.005, geometry="nonlinear")
    distance, turned = off_by(history)
    assert turned > np.radians(170.0)
    assert distance <= 1e-3 * LENGTH
    assert history.energy.drift <= 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("method", ["newmark", "hht", "generalized-alpha"])
def test_the_energy_of_1000_steps_is_bounded(method: str) -> None:
    times = np.linspace(0.0, 2.5, 1001)
    history = gs.transient(
        pendulum(), times=times, method=method, step=0.0025, geometry="nonlinear"
    )
    distance, _ = off_by(history)
    assert distance <= 1e-3 * LENGTH
    energy = history.energy
    assert energy.drift <= 2e-3
    assert (
        energy.kinetic + energy.strain <= energy.external_work + 1e-3 * energy.kinetic.max()
    ).all()


def test_a_step_that_adds_energy_is_refused() -> None:
    with pytest.raises(NotConverged, match=r"from nowhere|expected"):
        gs.transient(
            pendulum(1e12), times=[0.0, 20.0], method="newmark", step=0.2, geometry="nonlinear"
        )


def test_adaptive_steps_have_the_error_that_is_asked_for() -> None:
    distances = [
        off_by(
            gs.transient(
                pendulum(), times=np.linspace(0.0, 0.4, 5), method="generalized-alpha",
                step="adaptive", tolerance=tolerance, geometry="nonlinear",
            )
        )[0]
        for tolerance in (1e-2, 1e-3)
    ]  # fmt: skip
    assert 1e-2 * LENGTH > distances[0] > 1.5 * distances[1]


@pytest.mark.parametrize("method", ["newmark", "hht", "generalized-alpha"])
def test_small_motions_are_those_of_linear_theory(method: str) -> None:
    model, times = vibrating_bar(), np.linspace(0.0, 1.0, 5)
    factors = 1e-6 * np.outer([1.0, 0.5, -0.5, 1.0, 0.0], [1.0, -1.0])
    damping = gs.Rayleigh(mass=0.5)
    base = gs.Record([0.0, 1.0], 1e-6 * np.array([[1.0, 2.0, 0.0], [0.0, 0.0, 1.0]]))
    linear, nonlinear = (
        gs.transient(
            model, times=times, loads=factors, base=base, method=method, damping=damping,
            step=0.125, tolerance=1e-9, geometry=geometry,
        )
        for geometry in ("linear", "nonlinear")
    )  # fmt: skip
    assert greatest(nonlinear.u - linear.u, linear.u) <= 1e-5
    assert greatest(nonlinear.a - linear.a, linear.a) <= 1e-5
    for name in ("kinetic", "strain", "external_work", "dissipated"):
        one, other = (getattr(history.energy, name) for history in (linear, nonlinear))
        assert greatest(one - other, one) <= 1e-5


def test_a_released_equilibrium_keeps_its_energy_and_stays_under_its_load() -> None:
    model = vibrating_bar((4, 1, 1))
    model = gs.Model(model.mesh, model.materials, model.fixed, 3.0 * model.load_cases[0])
    bent = gs.solve(model, geometry="nonlinear", tolerance=1e-9)
    assert bent.u.max() > 0.2
    times = np.linspace(0.0, 0.4, 3)
    options = {"times": times, "method": "newmark", "step": 0.02, "geometry": "nonlinear"}
    stays = gs.transient(model, initial=bent, tolerance=1e-9, **options)  # type: ignore[arg-type]
    assert greatest(stays.u - bent.u, bent.u) <= 1e-5
    free = gs.transient(model, initial=bent, loads=0.0 * times, **options)  # type: ignore[arg-type]
    assert free.energy.strain[0] == pytest.approx(bent.strain_energy[0], rel=1e-6)
    assert free.energy.drift <= 1e-2
    assert free.energy.kinetic[-1] > 0.0


def test_plastic_flow_dissipates() -> None:
    mesh = gs.mesh.box((1.0, 1.0, 1.0), (1, 1, 1))
    metal = gs.J2(gs.Isotropic(100.0, 0.3, density=1.0), yield_stress=1.0)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    pull = gs.fem.face_force(mesh, gs.mesh.select_faces(mesh, name="x_max"), (2.5, 0.0, 0.0))
    blow = gs.Record([0.0, 0.1, 0.2, 1.0], [0.0, 1.0, 0.0, 0.0])
    history = gs.transient(
        gs.Model(mesh, metal, fixed, pull), times=np.linspace(0.0, 0.6, 13), loads=blow,
        method="newmark", step=0.0125, geometry="nonlinear",
    )  # fmt: skip
    energy = history.energy
    assert energy.dissipated[-1] > 0.1 * energy.external_work[-1]
    assert energy.drift <= 1e-3


def test_a_state_of_metal_that_nobody_knows_is_refused() -> None:
    model = vibrating_bar()
    metal = gs.J2(gs.Isotropic(100.0, 0.3, density=1.0), yield_stress=1.0)
    moved = np.where(model.fixed, 0.0, 1e-3)
    with pytest.raises(InputError, match="history"):
        gs.transient(
            gs.Model(model.mesh, metal, model.fixed), times=[0.0, 1.0], method="newmark",
            initial=(moved, 0.0 * moved), geometry="nonlinear",
        )  # fmt: skip


@pytest.mark.parametrize("moving", [LinearMotion, NonlinearMotion])
def test_the_first_acceleration_may_be_slowed_by_stiffness(moving: type[LinearMotion]) -> None:
    model, onset = vibrating_bar(), 0.02
    names, still = resolve_formulation(model, None), np.zeros(model.mesh.points.shape)
    factors = gs.Record([0.0, 1.0], 1e-6 * np.ones((2, 2)))
    problem = InitialValueProblem(model, names, "exact", factors, still, still)
    options = Options("auto", None, "numpy", 1e-9, None, None, None, names, Clock())
    motion = moving(problem, Scheme.named("newmark", 1.0), gs.Rayleigh(), options)
    k, m, free = matrices(model)
    push = 1e-6 * model.load_cases.sum(axis=0).ravel()[free]
    expected = np.linalg.solve(m + onset * k, push)
    got = motion.displacements(motion.begin(0.0, onset).a).ravel()[free]
    assert greatest(got - expected, expected) <= 1e-8
