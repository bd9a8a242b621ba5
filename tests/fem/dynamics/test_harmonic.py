"""Harmonic response: closed forms of each mode, matrices at each frequency, shaken bases, a
benchmark."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from scipy.linalg import eigh
from scipy.sparse.linalg import splu

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from gpusim.fem.assembly import node_graph
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.model.damping import Damping
from gpusim.fem.model.mass import mass_matrix
from gpusim.fem.model.model import resolve_formulation
from tests.support.element_meshes import linear_mesh
from tests.support.fem_reference import stiffness
from tests.support.vibration_reference import reduced_matrices

BAR = gs.mesh.box(size=(1.0, 0.1, 0.12), divisions=(5, 1, 1))
HELD = np.isclose(BAR.points[:, :1], 0.0).repeat(3, axis=1)
STEEL = gs.Isotropic(210e9, 0.3, density=7850.0)
FREQUENCIES = np.array([0.0, 60.0, 400.0, 3000.0, 20000.0])
DAMPINGS = [gs.Rayleigh(3.0, 1e-6), gs.StructuralDamping(0.03), gs.ModalDamping([0.01, 0.03]), None]


def shaken(seed: int = 0) -> gs.Model:
    forces = np.random.default_rng(seed).normal(size=(2, *BAR.points.shape))
    return gs.Model(BAR, STEEL, HELD, forces)


def matrices(model: gs.Model) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """K, M on free unknowns, and which these are."""
    free = np.flatnonzero(~model.fixed.ravel())  # type: ignore[union-attr]
    both = (stiffness(model), mass_matrix(model).tocsc())
    whole = [one[free][:, free].toarray() for one in both]
    return whole[0], whole[1], free


def worst(found: np.ndarray, expected: np.ndarray) -> float:
    """Greatest difference at any frequency, over what is expected there."""
    axes = tuple(range(1, expected.ndim))
    assert np.isfinite(found).all()
    return float((np.abs(found - expected).max(axis=axes) / np.abs(expected).max(axis=axes)).max())


def directly(
    model: gs.Model,
    frequencies: npt.ArrayLike,
    loads: npt.ArrayLike,
    damping: Damping | None = None,
    base: tuple[float, ...] | None = None,
) -> npt.NDArray[np.complex128]:
    """(F,N,3) of K (1 + i g) + i omega C - omega^2 M, factorised at each frequency."""
    motions, k, m = reduced_matrices(model)
    force = np.tensordot(loads, model.load_cases, axes=1).ravel()
    if base is not None:
        force = force - mass_matrix(model) @ np.tile(base, model.mesh.node_count)
    found = []
    for omega in 2.0 * np.pi * np.asarray(frequencies):
        of_mass = of_stiffness = 0.0
        if isinstance(damping, gs.Rayleigh):
            of_mass, of_stiffness = omega * damping.mass, omega * damping.stiffness
        elif isinstance(damping, gs.StructuralDamping):
            of_stiffness = damping.loss_factor
        dynamic = (1.0 + 1j * of_stiffness) * k + (1j * of_mass - omega**2) * m
        factor, right = splu(dynamic.tocsc()), (motions.T @ force).astype(complex)
        x = factor.solve(right)
        x += factor.solve(right - dynamic @ x)
        found.append(motions @ x)
    return np.reshape(found, (len(found), -1, 3))


def test_a_load_like_one_mode_moves_that_mode_alone() -> None:
    model = shaken()
    k, m, free = matrices(model)
    squares, shapes = eigh(k, m)
    force = np.zeros(BAR.points.size)
    force[free] = m @ shapes[:, 1]
    single = gs.Model(BAR, STEEL, HELD, force.reshape(-1, 3))
    omega, angular = 2.0 * np.pi * FREQUENCIES[:3], np.sqrt(squares[1])
    lost = [
        omega * (3.0 + 1e-6 * squares[1]),
        np.full(3, 0.03 * squares[1]),
        2.0 * 0.03 * omega * angular,
        np.zeros(3),
    ]
    for damping, imaginary in zip(DAMPINGS, lost, strict=True):
        response = gs.harmonic(single, FREQUENCIES[:3], damping=damping, count=6)
        expected = np.zeros((3, BAR.points.size), dtype=complex)
        expected[:, free] = shapes[:, 1] / (squares[1] - omega**2 + 1j * imaginary)[:, None]
        assert worst(response.u.reshape(3, -1), expected) <= 1e-9


@pytest.mark.parametrize("damping", [DAMPINGS[0], DAMPINGS[1], DAMPINGS[3]], ids=str)
def test_all_modes_are_what_matrices_say(damping: Damping | None) -> None:
    model, loads = shaken(), [1.0, 0.5j]
    every = gs.harmonic(model, FREQUENCIES, loads=loads, damping=damping, count=60)
    assert worst(every.u, directly(model, FREQUENCIES, loads, damping)) <= 1e-9
    assert (every.truncation == 0.0).all()


def test_few_modes_are_exact_at_rest_and_off_by_less_than_stated() -> None:
    model, frequencies = shaken(), np.array([0.0, 60.0, 400.0, 1500.0])
    expected = directly(model, frequencies, [1, 2j])
    few = gs.harmonic(model, frequencies, loads=[1, 2j], count=8)
    assert worst(few.u[:1], expected[:1]) <= 1e-9
    assert few.truncation[0] == 0.0 and (np.diff(few.truncation) > 0.0).all()
    k, _, free = matrices(model)
    away = (few.u - expected).reshape(4, -1)[:, free]
    static = expected[0].ravel()[free]
    error = np.sqrt(
        np.einsum("fi,ij,fj->f", away.conj(), k, away).real / (static.conj() @ k @ static).real
    )
    assert (error[1:] <= few.truncation[1:]).all()
    assert (few.truncation[1:] <= 20.0 * error[1:]).all()


def test_modes_that_are_known_are_taken() -> None:
    model = shaken()
    known = gs.modes(model, 8)
    again = gs.harmonic(model, [60.0], modes=known)
    assert worst(again.u, gs.harmonic(model, [60.0], count=8).u) <= 1e-12
    with pytest.raises(NotConverged, match="modes"):
        gs.harmonic(model, [60.0], modes=replace(known, converged=False))
    other = gs.modes(gs.Model(BAR, gs.Isotropic(180e9, 0.3, density=7850.0), HELD), 8)
    with pytest.raises(InputError, match="modes; got others"):
        gs.harmonic(model, [60.0], modes=other)


def test_what_modes_cant_do_is_told_before_any_work(monkeypatch: pytest.MonkeyPatch) -> None:
    model = shaken()
    known, some = gs.modes(model, 8), gs.modes(model, band=(400.0, 3000.0))
    assert (known.below, some.below) == (0, 2)
    monkeypatch.delattr(EquationOfMotion, "of")
    with pytest.raises(InputError, match="modes; got 2 lower ones left out"):
        gs.harmonic(model, [60.0], modes=some)
    with pytest.raises(
        InputError, match=r"up to 1e\+06 Hz; expected less than [\d.]+ Hz, the last"
    ):
        gs.harmonic(model, [60.0, 1e6], modes=known)
    with pytest.raises(
        InputError, match="harmonic: count; got 1000; expected at most 60, the unkn"
    ):
        gs.harmonic(model, [60.0], count=1000)
    with pytest.raises(InputError, match="modes: count; got 61; expected at most 60, the unknowns"):
        gs.modes(model, 61)
    with pytest.raises(InputError, match="frequency_response: unknown argument; got 'modus'"):
        gs.frequency_response(model, [60.0], at=(9, "x"), modus=known)  # type: ignore[call-arg]


def tied() -> gs.Model:
    mesh = gs.mesh.box(size=(2.0, 1.0, 1.0), divisions=(4, 2, 2))
    held = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    tie = gs.fem.equations(mesh, [([(4, "x", 1.0), (14, "x", -0.5)], 0.0)])
    force = np.random.default_rng(1).normal(size=mesh.points.shape)
    return gs.Model(mesh, gs.Isotropic(50.0, 0.3, density=2.0), held, force, constraints=[tie])


def numbered_anew() -> gs.Model:
    mesh = gs.mesh.quadratic(linear_mesh("tet4", (4, 3, 3), 0.03))
    x = mesh.points[:, :1]
    held = (x < x.min() + 1e-9).repeat(3, axis=1)
    force = np.random.default_rng(2).normal(size=mesh.points.shape)
    return gs.Model(mesh, gs.Isotropic(50.0, 0.3, density=2.0), held, force)


@pytest.mark.parametrize("model", [tied(), numbered_anew()], ids=["tied", "numbered anew"])
@pytest.mark.parametrize("base", [None, (0.0, 1.0, 0.3)])
def test_other_models(
    model: gs.Model, base: tuple[float, ...] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(node_graph, "_FEW", 100)
    damping, frequencies = gs.Rayleigh(0.1, 1e-3), [0.0, 0.05]
    found = gs.harmonic(model, frequencies, base=base, damping=damping).u
    expected = directly(model, frequencies, [float(base is None)], damping, base)
    assert worst(found[:1], expected[:1]) <= 1e-9
    assert worst(found, expected) <= 1e-4


def test_tension_stiffens() -> None:
    mesh = gs.mesh.box(size=(1.0, 0.02, 0.02), divisions=(20, 1, 1))
    held = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    end = gs.mesh.select_faces(mesh, name="x_max")
    pull = gs.fem.traction(mesh, end, (1e8, 0, 0))
    push = gs.fem.traction(mesh, end, (0, 1e4, 0))
    model = gs.Model(mesh, STEEL, held, np.stack([pull, push]))
    solution = gs.solve(model, geometry="nonlinear", factors=[[1.0, 0.0]])
    found = gs.harmonic(model, [0.0, 10.0], loads=[0, 1], prestress=solution)
    equation = EquationOfMotion.at(solution, resolve_formulation(model, None), "exact")
    free, each = equation.unknown, np.eye(equation.unknown.size)[equation.unknown]
    k, m = (product(each)[:, free] for product in (equation.stiffness, equation.inertia))
    load = equation.forces(model.load_cases[1:])[0, free]
    steps = [np.linalg.solve(k - omega**2 * m, load) for omega in (0.0, 20.0 * np.pi)]
    assert worst(equation.unknowns(found.u)[:, free], np.array(steps)) <= 1e-6
    # P (L - tanh(k L) / k) / N, k^2 = N / E I
    force, tension, rate = 4.0, 4e4, np.sqrt(4e4 / (210e9 * 0.02**4 / 12.0))
    tip = force / tension * (1.0 - np.tanh(rate) / rate)
    assert abs(found.u[0, -1, 1] / tip - 1.0) <= 0.01


def test_a_shaken_base_is_a_moving_support() -> None:
    """Against the equations of the free nodes with the others' motion given."""
    model, frequencies = gs.Model(BAR, STEEL, HELD), np.array([40.0, 90.0, 300.0])
    base, damping = np.array([0.3, 1.0, 0.2j]), gs.StructuralDamping(0.05)
    found = gs.harmonic(model, frequencies, base=base, damping=damping, count=60)
    free = np.flatnonzero(~HELD.ravel())
    held = np.flatnonzero(HELD.ravel())
    k, m = stiffness(model).toarray() * (1.0 + 0.05j), mass_matrix(model).toarray()
    for number, omega in enumerate(2.0 * np.pi * frequencies):
        dynamic = k - omega**2 * m
        u = np.tile(-base / omega**2, BAR.node_count)
        u[free] = np.linalg.solve(
            dynamic[np.ix_(free, free)], -dynamic[np.ix_(free, held)] @ u[held]
        )
        moved = found.absolute().u[number].ravel()
        assert np.abs(moved - u).max() <= 1e-9 * np.abs(u).max()


def test_transmissibility_of_a_tuned_cantilever() -> None:
    """At its first frequency the tip of a slender one moves by 1 - 1.566 i / (2 zeta) of the base,
    and a little for the other modes, which follow the base: -0.566."""
    mesh = gs.mesh.quadratic(gs.mesh.box(size=(2.0, 0.02, 0.02), divisions=(20, 1, 1)))
    held = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    model = gs.Model(mesh, gs.Isotropic(210e9, 0.0, density=7850.0), held)
    known, zeta = gs.modes(model, 8), 0.01
    tuned = 1.8751**2 / (2.0 * np.pi * 4.0) * 0.02 * np.sqrt(210e9 / 7850.0 / 12.0)
    assert abs(known.frequencies[0] / tuned - 1.0) <= 1e-3
    found = gs.harmonic(
        model, known.frequencies[:1], base=(0, 1, 0), damping=gs.ModalDamping(zeta), modes=known
    )
    moved = found.absolute().u[0, :, 1]
    tip = moved[np.argmax(mesh.points[:, 0])] / moved[np.argmin(mesh.points[:, 0])]
    assert abs(tip - (1.0 - 1j * 1.566 / (2.0 * zeta))) <= 1e-3 * abs(tip)


def deep_beam() -> gs.Model:
    """NAFEMS Test 5 (Selected Benchmarks for Forced Vibration, R0016, 1989): 10 x 2 x 2 m, simply
    supported, 1e6 N/m over the span; a quarter of it, by symmetry."""
    mesh = gs.mesh.quadratic(gs.mesh.box(size=(5.0, 2.0, 1.0), divisions=(5, 2, 1)))
    x, _, z = mesh.points.T
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[np.isclose(x, 0.0), 1:] = True
    fixed[np.isclose(x, 5.0), 0] = True
    fixed[np.isclose(z, 0.0), 2] = True
    force = gs.fem.body_force(mesh, 1.0, (0.0, 1e6 / 4.0, 0.0))
    return gs.Model(mesh, gs.Isotropic(200e9, 0.3, density=8000.0), fixed, force)


def test_nafems_5h() -> None:
    """Peak at mid span 13.45 mm at 42.65 Hz, bending stress 241.9 MPa."""
    model, frequencies = deep_beam(), np.linspace(42.0, 43.4, 141)
    found = gs.harmonic(model, frequencies, damping=gs.ModalDamping(0.02), count=12)
    middle, top = (
        np.flatnonzero((model.mesh.points == [5.0, y, 0.0]).all(axis=1))[0] for y in (1.0, 2.0)
    )
    peak = int(np.argmax(found.amplitude[:, middle, 1]))
    assert abs(frequencies[peak] / 42.65 - 1.0) <= 0.005
    assert abs(found.amplitude[peak, middle, 1] / 13.45e-3 - 1.0) <= 0.005
    # every mode of the mesh, in dense algebra
    k, m, free = matrices(model)
    squares, shapes = eigh(k, m)
    assert model.forces is not None
    angular = 2.0 * np.pi * frequencies[:, None]
    dynamic = squares - angular**2 + 0.04j * angular * np.sqrt(squares)
    expected = (shapes.T @ model.forces.ravel()[free] / dynamic) @ shapes.T
    assert worst(found.u.reshape(len(frequencies), -1)[:, free], expected) <= 1e-6
    quarters = (gs.fem.stress(model, found.at(peak, turn)) for turn in (0.0, 0.5 * np.pi))
    assert abs(np.hypot(*(one.nodal[top, 0] for one in quarters)) / 241.9e6 - 1.0) <= 0.02


def free_bar() -> gs.Model:
    force = np.zeros(BAR.points.shape)
    force[-1, 1] = 1e3
    return gs.Model(BAR, STEEL, forces=force)


def test_a_free_body() -> None:
    expected = directly(free_bar(), [40.0, 300.0, 900.0], [1.0])
    every = gs.harmonic(free_bar(), [40.0, 300.0, 900.0], count=72)
    assert worst(every.u, expected) <= 1e-9
    few = gs.harmonic(free_bar(), [40.0, 300.0], count=14)
    assert worst(few.u, expected[:2]) <= 1e-5
    # forces like a mass times an acceleration don't strain it
    force = gs.fem.body_force(BAR, 7850.0, (0.0, 2.0, 0.0))
    pushed = gs.harmonic(gs.Model(BAR, STEEL, forces=force), [40.0], count=8)
    assert worst(pushed.u[..., 1], np.full((1, BAR.node_count), -2.0 / (80.0 * np.pi) ** 2)) <= 1e-9


def test_a_slender_free_body() -> None:
    """Whose rigid motions rounding gives less than no energy."""
    blade = gs.mesh.box(size=(1, 0.02, 0.01), divisions=(20, 2, 2))
    force = gs.fem.face_force(blade, gs.mesh.select_faces(blade, name="x_max"), total=(0, 0, -5.0))
    model = gs.Model(blade, STEEL, forces=force)
    assert np.isfinite(gs.harmonic(model, [5.0]).u).all()
    times = np.linspace(0.0, 0.1, 11)
    shaken = gs.transient(
        model, times=times, loads=0.0 * times, base=gs.Record(times, np.ones((11, 3)))
    )
    assert np.abs(shaken.u[-1] + 0.5 * 0.1**2).max() <= 1e-12
    swung = gs.transient(model, times=times)
    stepped = gs.transient(model, times=times, method="newmark", step=5e-5)
    assert np.abs(swung.u[-1] - stepped.u[-1]).max() <= 1e-3 * np.abs(stepped.u[-1]).max()


def test_a_resonance_that_nothing_damps_is_refused() -> None:
    model = shaken()
    resonance = float(gs.modes(model, 1).frequencies[0])
    for damping in (None, gs.Rayleigh()):
        with pytest.raises(InputError, match=r"a resonance .*that nothing damps; expected damping"):
            gs.harmonic(model, [10.0, resonance], damping=damping)
    beside = gs.harmonic(model, [resonance * (1.0 + 1e-5)])
    assert np.isfinite(beside.u).all()
    with pytest.raises(InputError, match="nothing damps"):
        gs.harmonic(free_bar(), [0.0], damping=gs.Rayleigh(3.0))


def test_what_is_refused() -> None:
    model, refused = shaken(), {}
    refused["frequencies"] = [[], [-1.0], [np.nan], [[1.0]], "many", 5.0]
    refused["loads"] = [[1.0], [np.inf, 0.0], "ab", [True, False], [0.0, 0.0]]
    refused["base"] = [(1.0, 0.0), (np.nan, 0.0, 0.0), "up"]
    refused["damping"] = [0.02, "some"]
    refused["prestress"] = [model, "pull"]
    refused["count"] = [0, 1.5, 10_000]
    refused["modes"] = [
        5,
        gs.modes(
            gs.Model(
                gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1)),
                STEEL,
                np.ones((8, 3), bool) & (np.arange(8) < 4)[:, None],
            ),
            2,
        ),
    ]
    for name, values in refused.items():
        for value in values:
            given = {"frequencies": [10.0], name: value}
            with pytest.raises(InputError, match=name):
                gs.harmonic(model, **given)  # type: ignore[arg-type]
    other = gs.solve(shaken())
    with pytest.raises(InputError, match=r"prestress; got one of another model"):
        gs.harmonic(model, [10.0], prestress=other, modes=gs.modes(other.model, prestress=other))
    with pytest.raises(InputError, match="beyond 8 modes that lack"):
        gs.harmonic(model, [1e5], count=8)
    with pytest.raises(InputError, match="unknown argument; got 'method'"):
        gs.harmonic(model, [10.0], method="direct")
    warm = gs.Model(
        BAR, STEEL, HELD, model.forces, temperature=[[1.0] * BAR.node_count, [0.0] * BAR.node_count]
    )
    with pytest.raises(InputError, match="loads; got a case with a change of temperature"):
        gs.harmonic(warm, [10.0])
    again = gs.harmonic(warm, [10.0], loads=[0, 1])
    assert worst(again.u, gs.harmonic(model, [10.0], loads=[0, 1]).u) <= 1e-12
    pulled = gs.Model(BAR, STEEL, HELD, prescribed=np.where(HELD, 1e-3, 0.0))
    apart = gs.fem.equations(BAR, [([(9, "x", 1.0), (15, "x", -1.0)], 1e-3)])
    wedged = gs.Model(BAR, STEEL, HELD, model.forces, constraints=[apart])
    for given_displacement in (pulled, wedged):
        with pytest.raises(InputError, match="displacements that are given"):
            gs.harmonic(given_displacement, [10.0])
