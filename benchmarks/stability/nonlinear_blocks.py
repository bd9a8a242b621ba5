"""Blocks of the stability suite at large displacements: laws far from rest, metal, all cell types,
and questions that make no sense."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq

from benchmarks.stability.dense_newton import DenseBody, neo_hooke, saint_venant
from benchmarks.stability.nonlinear_suite import Question
from gpusim.fem import (
    J2,
    FollowerPressure,
    Hencky,
    Isotropic,
    Law,
    LoadStep,
    Material,
    Model,
    NeoHookean,
    Orthotropic,
    SaintVenantKirchhoff,
    face_force,
    solve,
)
from gpusim.mesh import Mesh, quadratic, select_faces
from tests.support.element_meshes import mixed_mesh
from tests.support.verification_models import mapped, unit_block

Float = npt.NDArray[np.float64]
Counts = tuple[int, int, int]

METAL = Isotropic(200e3, 0.3)
YIELD = 200.0


def block(kind: str = "hex8", divisions: Counts = (2, 2, 2), length: float = 2.0) -> Mesh:
    """``length`` x 1 x 1, from 0 on."""
    return mapped(unit_block(kind, divisions), lambda p: p * [length, 1.0, 1.0], straight=True)


def pulled(mesh: Mesh, laws: Material | Sequence[Material], force: float | None = None,
           of_cell: npt.NDArray[np.int32] | None = None) -> Model:  # fmt: skip
    """Between smooth walls at its low faces; pulled along x by its length times the load factor, or
    by a ``force``."""
    low, high = mesh.bounds
    fixed = np.abs(mesh.points - low) < 1e-9
    if force is not None:
        end = select_faces(mesh, plane=(high, "+x"))
        forces = face_force(mesh, end, (force, 0.0, 0.0))
        return Model(mesh, laws, fixed, forces, material_of_cell=of_cell)
    end = np.abs(mesh.points[:, 0] - high[0]) < 1e-9
    fixed[:, 0] |= end
    pull = np.where(end[:, None] & (np.arange(3) == 0), high[0] - low[0], 0.0)
    return Model(mesh, laws, fixed, prescribed=pull, material_of_cell=of_cell)


def uniaxial(law: Law, stretch: float) -> tuple[float, float]:
    """Stretch across, and force per area at rest, of a bar of ``law`` by its own definition."""
    if isinstance(law, NeoHookean | SaintVenantKirchhoff):
        of = neo_hooke if isinstance(law, NeoHookean) else saint_venant

        def stress(across: float) -> Float:
            return of(np.diag([stretch, across, across]), law.E, law.nu)

        across = brentq(lambda a: float(stress(a)[1, 1]), 1e-3, 30.0)
        return across, float(stress(across)[0, 0])
    if isinstance(law, Hencky):
        return float(stretch**-law.nu), float(law.E * np.log(stretch) / stretch)
    assert isinstance(law, Isotropic)
    return 1.0 - law.nu * (stretch - 1.0), law.E * (stretch - 1.0)


def stretched(
    law: Law, strains: Sequence[float], formulation: str | None = None, kind: str = "hex8",
    mesh: Mesh | None = None,
) -> Question:  # fmt: skip
    """Pulled by these engineering ``strains``: motion of the free sides, and force. NaN strains
    aren't."""
    mesh = block(kind) if mesh is None else mesh
    model = pulled(mesh, law)
    low, high = mesh.bounds
    side, end = mesh.points[:, 1] > high[1] - 1e-9, mesh.points[:, 0] < low[0] + 1e-9
    width, area = high[1] - low[1], float(np.prod(high[1:] - low[1:]))

    def values(step: LoadStep) -> Float:
        across = step.u[side, 1]
        return np.array([across.min(), across.max(), -step.reactions[end, 0].sum()])

    states = [uniaxial(law, 1.0 + strain) for strain in strains]
    expected = [[width * (a - 1.0), width * (a - 1.0), area * force] for a, force in states]
    options = {} if formulation is None else {"formulation": formulation}
    return Question(
        model, list(strains), values, np.array(expected), "uniaxial stress", options=options
    )


def forced(law: Law, forces: Sequence[float], stretches: Sequence[float]) -> Question:
    """Pulled by ``forces`` per area at rest; its ``stretches`` (NaN: there is none)."""
    mesh = block()

    def values(step: LoadStep) -> Float:
        end = step.u[mesh.points[:, 0] > 2.0 - 1e-9, 0]
        return np.array([end.min(), end.max()])

    ends = 2.0 * (np.array(stretches) - 1.0)
    expected = np.stack([ends, ends], axis=1)
    return Question(pulled(mesh, law, 1.0), list(forces), values, expected, "uniaxial stress")


def stretch_of(law: Law, force: float) -> float:
    """Of the bar under a ``force`` per area at rest, on its first branch."""
    return float(brentq(lambda s: uniaxial(law, s)[1] - force, 0.05, 60.0))


def metal(hardening: float) -> J2:
    return J2(METAL, YIELD, hardening)


def metal_path(hardening: float, forces: Sequence[float]) -> list[float]:
    """Stretches of a bar of metal under these forces per area at rest, one after the other: true
    stress over the area that is left in logarithmic strain; NaN beyond what it carries."""
    plastic, accumulated, stretches = 0.0, 0.0, list[float]()
    logs = np.linspace(-0.7, 1.2, 200_001)

    def stress(log: Float) -> Float:
        trial = METAL.E * (log - plastic)
        over = np.maximum(np.abs(trial) - YIELD - hardening * accumulated, 0.0)
        return np.asarray(trial - METAL.E * over / (METAL.E + hardening) * np.sign(trial))

    def surplus(log: Float, force: float) -> Float:
        # Kirchhoff's stress is the force times the stretch
        return np.asarray(stress(log) - force * np.exp(log))

    for force in forces:
        over = surplus(logs, force)
        crossing = np.flatnonzero((over[:-1] <= 0.0) & (over[1:] >= 0.0))
        if not len(crossing):
            return [*stretches, *[np.nan] * (len(forces) - len(stretches))]
        k = crossing[np.argmin(np.abs(logs[crossing] - plastic))]
        log = brentq(surplus, logs[k], logs[k + 1], args=(force,), xtol=1e-15)
        grown = log - plastic - float(stress(log)) / METAL.E
        plastic, accumulated = plastic + grown, accumulated + abs(grown)
        stretches.append(float(np.exp(log)))
    return stretches


def sheared_metal(shear: float, steps: int) -> Question:
    """A cell of metal sheared by ``shear`` between rough plates, in so many steps: the force,
    against 100 steps of the same elements."""
    mesh = block("hex8", (1, 1, 1), 1.0)
    top, bottom = mesh.points[:, 2] > 1.0 - 1e-9, mesh.points[:, 2] < 1e-9
    fixed = np.repeat((top | bottom)[:, None], 3, axis=1)
    aside = np.where(top[:, None] & (np.arange(3) == 0), shear, 0.0)
    model = Model(mesh, metal(1000.0), fixed, prescribed=aside)

    def values(step: LoadStep) -> Float:
        return np.array([step.reactions[top, 0].sum()])

    fine = solve(model, geometry="nonlinear", factors=np.arange(1, 101) / 100).steps
    factors = np.arange(1, steps + 1) / steps
    expected = np.full((steps, 1), np.nan)
    expected[-1] = values(fine[-1])
    for k in range(steps - 1):
        expected[k] = values(fine[round(100 * factors[k]) - 1])
    return Question(model, factors, values, expected, "100 steps")


def pressed_metal(kind: str) -> Question:
    """A cube of metal pressed by 4 % between rough plates, 4 cells of ``kind`` on an edge: the
    force, against 3 hex20 of reduced integration."""

    def force(kind: str, cells: int, **options: str) -> Question:
        mesh = block(kind, (cells, cells, cells), 1.0)
        top = mesh.points[:, 0] > 1.0 - 1e-9
        fixed = np.repeat((top | (mesh.points[:, 0] < 1e-9))[:, None], 3, axis=1)
        down = np.where(top[:, None] & (np.arange(3) == 0), -1.0, 0.0)
        model = Model(mesh, metal(200.0), fixed, prescribed=down)

        def values(step: LoadStep) -> Float:
            return np.array([step.reactions[top, 0].sum()])

        return Question(model, [0.01, 0.02, 0.03, 0.04], values, np.zeros((4, 1)),
                        "hex20, reduced", options=options)  # fmt: skip

    other = force("hex20", 3, formulation="reduced")
    steps = solve(other.model, geometry="nonlinear", factors=other.factors, **other.options).steps
    expected = np.array([other.values(step) for step in steps if step.wanted])
    return replace(force(kind, 4), expected=expected)


def layered(laws: Sequence[Law], strain: float) -> Question:
    """Two laws one behind the other in a bar: where their joint goes, and the force."""
    mesh = block("hex8", (4, 2, 2))
    second = mesh.points[mesh.cells["hex8"]].mean(axis=1)[:, 0] > 1.0
    model = pulled(mesh, list(laws), of_cell=second.astype(np.int32))

    def left(stretch: float) -> float:
        return uniaxial(laws[0], stretch)[1] - uniaxial(laws[1], 2.0 + 2.0 * strain - stretch)[1]

    stretch = brentq(left, 1.0, 1.0 + 2.0 * strain - 1e-9)
    joint, wall = np.abs(mesh.points[:, 0] - 1.0) < 1e-9, mesh.points[:, 0] < 1e-9

    def values(step: LoadStep) -> Float:
        return np.array([step.u[joint, 0].mean(), -step.reactions[wall, 0].sum()])

    expected = np.array([[stretch - 1.0, uniaxial(laws[0], stretch)[1]]])
    return Question(model, [strain], values, expected, "uniaxial stress")


def bent_block(kind: str, law: Law, force: float) -> Question:
    """A stocky bar of ``kind`` pushed aside by most of its length, fully integrated."""
    mesh = block(kind, (3, 1, 1), 3.0)
    end = select_faces(mesh, name="x_max")
    model = Model(mesh, law, np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1),
                  face_force(mesh, end, (0.3 * force, 0.15 * force, force)))  # fmt: skip
    return second_opinion(model, [1.0])


def mixed_block(second_order: bool) -> Question:
    """Bricks, wedges, pyramids and tetrahedra together, stretched by a half."""
    mesh = quadratic(mixed_mesh()) if second_order else mixed_mesh(0.1)
    return stretched(NeoHookean(1.0, 0.3), [0.5], mesh=mesh)


def dome(way: float) -> Question:
    """A shallow cap with a clamped edge, its crown led through, in one step."""
    radius, half = 50.0, 10.0

    def place(unit: Float) -> Float:
        x, y = half * (2.0 * unit[:, 0] - 1.0), half * (2.0 * unit[:, 1] - 1.0)
        z = np.sqrt(radius**2 - x**2 - y**2) - radius + 0.6 * unit[:, 2]
        return np.stack([x, y, z], axis=1)

    flat = unit_block("hex8", (6, 6, 1))
    mesh = mapped(flat, place, straight=True)
    edge = (np.abs(flat.points[:, :2] - 0.5) > 0.5 - 1e-9).any(axis=1)
    crown = (np.abs(flat.points[:, :2] - 0.5) < 1e-9).all(axis=1)
    fixed = np.repeat(edge[:, None], 3, axis=1)
    fixed[crown, 2] = True
    down = np.where(crown[:, None] & (np.arange(3) == 2), -1.0, 0.0)
    model = Model(mesh, SaintVenantKirchhoff(1e4, 0.3), fixed, prescribed=down)
    return second_opinion(model, [way])


def second_opinion(model: Model, factors: Sequence[float]) -> Question:
    """All displacements against the dense program's."""
    found = DenseBody(model).equilibria(factors)
    return Question(
        model, list(factors), lambda step: step.u.ravel(), found.reshape(len(found), -1),
        "dense Newton, 20 steps", float(np.abs(found).max()), {"formulation": "full"},
    )  # fmt: skip


def tube(nu: float, growth: float) -> Question:
    """A thick rubber tube, kept at its length, blown up until its bore is ``growth`` times as wide:
    p is the integral of mu (a^2 - a^-2) / r over the wall, a the stretch around."""
    inner, outer, E = 1.0, 2.0, 1.0

    def place(unit: Float) -> Float:
        angle, r = 0.5 * np.pi * unit[:, 0], inner + (outer - inner) * unit[:, 1]
        return np.stack([r * np.sin(angle), r * np.cos(angle), 0.2 * unit[:, 2]], axis=1)

    mesh = mapped(unit_block("hex8", (16, 10, 1)), place, straight=False)
    fixed = np.abs(mesh.points) < 1e-9
    fixed[:, 2] = True
    r = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
    bore = r < inner + 1e-9
    wall = select_faces(mesh, name="y_min")
    now = np.linspace(growth * inner, np.sqrt((growth**2 - 1.0) * inner**2 + outer**2), 4001)
    around = now / np.sqrt(now**2 - (growth**2 - 1.0) * inner**2)
    pressure = float(np.trapezoid(E / 3.0 * (around**2 - around**-2) / now, now))
    model = Model(mesh, NeoHookean(E, nu), fixed, loads=[FollowerPressure(wall, pressure)])

    def values(step: LoadStep) -> Float:
        return np.array([step.u[bore, 0].max(), step.u[bore, 1].max()])

    expected = np.full((1, 2), (growth - 1.0) * inner)
    return Question(model, [1.0], values, expected, "Rivlin's tube", options={
        "formulation": "bbar"})  # fmt: skip


def sunk_cube(pressure: float) -> Question:
    """A rubber cube on six supports that just hold it, under water: it shrinks evenly."""
    law, mesh = NeoHookean(1.0, 0.3), block("hex8", (2, 2, 2), 1.0)
    corners = [int(np.flatnonzero((np.abs(mesh.points - p) < 1e-9).all(axis=1))[0])
               for p in ((0, 0, 0), (1, 0, 0), (0, 1, 0))]  # fmt: skip
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[corners[0]] = True
    fixed[corners[1], 1:] = True
    fixed[corners[2], 2] = True
    model = Model(mesh, law, fixed, loads=[FollowerPressure(select_faces(mesh), pressure)])

    def surplus(s: float) -> float:
        return float(neo_hooke(s * np.eye(3), law.E, law.nu)[0, 0]) / s**2 + pressure

    shrunk = brentq(surplus, 0.05, 1.0) - 1.0
    expected = (shrunk * mesh.points).reshape(1, -1)
    return Question(model, [1.0], lambda step: step.u.ravel(), expected, "even pressure", 1.0)


def turned_fibres(degrees: float) -> Question:
    """An orthotropic bar whose ends are turned by ``degrees`` in steps of 15 and then pulled apart
    by a thousandth: the force along it is E_1 times that."""
    law = Orthotropic(E=(1e4, 100.0, 50.0), nu=(0.0, 0.0, 0.0), G=(40.0, 30.0, 20.0))
    mesh = block("hex8", (3, 1, 1), 3.0)
    ends = (mesh.points[:, 0] < 1e-9) | (mesh.points[:, 0] > 3.0 - 1e-9)
    x, z = mesh.points[:, 0], mesh.points[:, 2]
    given = np.zeros((4, *mesh.points.shape))
    given[0, ends, 0], given[1, ends, 2] = x[ends], x[ends]
    given[2, ends, 0], given[3, ends, 2] = -z[ends], z[ends]
    model = Model(mesh, law, np.repeat(ends[:, None], 3, axis=1), prescribed=given)
    angles = np.radians(np.arange(15.0, degrees + 1.0, 15.0))
    longer = np.where(np.arange(len(angles)) == len(angles) - 1, 1.001, 1.0)
    c, s = np.cos(angles), np.sin(angles)
    factors = np.stack([longer * c - 1.0, longer * s, s, c - 1.0], axis=1)
    last = np.array([c[-1], 0.0, s[-1]])
    end = x > 3.0 - 1e-9

    def values(step: LoadStep) -> Float:
        force = step.reactions[end].sum(axis=0)
        return np.array([force @ last, np.linalg.norm(force - (force @ last) * last)])

    expected = np.zeros((len(angles), 2))
    expected[-1, 0] = 10.0
    return Question(model, factors, values, expected, "E_1 times the strain", 10.0)


def pushed_corner(law: Law, push: float) -> Question:
    """One corner of a clamped block led into it, so far that its cell is turned inside out."""
    mesh = block()
    corner = int(np.flatnonzero((mesh.points == [2.0, 1.0, 1.0]).all(axis=1))[0])
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    fixed[corner] = True
    given = np.zeros(mesh.points.shape)
    given[corner] = (-push, -0.5 * push, -0.5 * push)
    model = Model(mesh, law, fixed, prescribed=given)
    nothing = np.full((1, 1), np.nan)
    return Question(model, [1.0], lambda step: step.u[:1, 0], nothing, "none")


def unused_node() -> Question:
    """A node of no cell, far away."""
    base = stretched(NeoHookean(1.0, 0.3), [0.5])
    mesh = base.model.mesh
    more = Mesh(np.concatenate([mesh.points, [[1.5, 0.5, 9.0]]]), mesh.cells)
    assert base.model.fixed is not None and base.model.prescribed is not None
    fixed = np.concatenate([base.model.fixed, [[False] * 3]])
    given = np.concatenate([base.model.prescribed, [[0.0] * 3]])

    def values(step: LoadStep) -> Float:
        return base.values(replace(step, u=step.u[:-1], reactions=step.reactions[:-1]))

    return replace(
        base, model=Model(more, NeoHookean(1.0, 0.3), fixed, prescribed=given), values=values
    )


def asked(
    factors: npt.ArrayLike | None, change: Callable[[Model], Model] | None = None
) -> Question:
    """A rubber bar with ``factors`` that make no sense, or after a ``change`` that doesn't."""
    model = pulled(block(), NeoHookean(1.0, 0.3), 0.5)
    model = model if change is None else change(model)
    nothing = np.full((8, 1), np.nan)
    return Question(model, factors, lambda step: step.u[:1, 0], nothing, "none")
