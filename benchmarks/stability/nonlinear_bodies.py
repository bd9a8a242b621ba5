"""Slender bodies of the stability suite at large displacements, and what they should do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt
from scipy.integrate import trapezoid
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from benchmarks.stability.nonlinear_suite import Question
from gpusim.fem import (
    Isotropic,
    LoadStep,
    Material,
    Model,
    body_force,
    equations,
    face_force,
    nodal_force,
    tie,
)
from gpusim.mesh import Mesh, box, select_faces
from tests.support.elastica import DistributedLoad, Strip, cantilever, clamped_arch, integrated
from tests.support.nonlinear_cases import (
    ELASTICA,
    NonlinearCase,
    arch_strip,
    bar,
    bimetal_strip,
    clamped_end,
    pressed_column,
    shallow_arch,
)

Float = npt.NDArray[np.float64]
Counts = tuple[int, int, int]
Elastic = Callable[[float, float], Material]

LENGTH = 100.0


def question_of(case: NonlinearCase) -> Question:
    """A case of the tests of large displacements."""
    return Question(
        case.model, case.factors, lambda step: case.values(step.u), case.expected, case.source,
        case.size,
    )  # fmt: skip


def end_motion(mesh: Mesh, length: float) -> Callable[[LoadStep], Float]:
    """Mean displacement x, z of the end of a bar of this ``length``."""
    end = mesh.points[:, 0] >= length * (1.0 - 1e-9)
    return lambda step: step.u[end][:, [0, 2]].mean(axis=0)


def bent_strip(
    slender: float,
    alphas: Sequence[float],
    *,
    kind: str = "hex8",
    divisions: Counts = (100, 1, 1),
    law: Elastic = Isotropic,
    width: float = 1.0,
    scale: float = 1.0,
    E: float = 1e6,
) -> Question:
    """Cantilever of ``slender`` times its thickness in length under a force across its end, P L^2 /
    E I = ``alphas`` in its load steps; nu = 0."""
    length = LENGTH * scale
    strip = Strip(length, width * scale, length / slender, E)
    mesh = bar(strip, kind, divisions)
    unit = strip.bending / length**2
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, unit))
    # a bar of another unit is the same bar
    one = Strip(LENGTH, width, LENGTH / slender, 1e6)
    ends = [cantilever(one, (0.0, a * one.bending / LENGTH**2), DistributedLoad()) for a in alphas]
    expected = scale * np.array([[x - LENGTH, z] for x, z, _ in ends])
    return Question(
        Model(mesh, law(E, 0.0), clamped_end(mesh), forces), list(alphas),
        end_motion(mesh, length), expected, ELASTICA, length,
    )  # fmt: skip


def perfect_column(share: float) -> Question:
    """Pressed along its axis by ``share`` of Euler's load: it stays straight, or is told of."""
    case = pressed_column((40, 1, 1), share * (0.5 * np.pi) ** 2, 0.0)
    strip = Strip(LENGTH, 1.0, 1.0, 1e6)
    load = share * (0.5 * np.pi) ** 2 * strip.bending / LENGTH**2
    straight = [-load * LENGTH / strip.stretching, 0.0]
    expected = np.array([straight if share <= 1.0 else [np.nan, np.nan]])
    return replace(question_of(case), expected=expected, source="Euler")


def crooked_column(share: float, eccentric: float) -> Question:
    """The same with ``eccentric`` of the load across its end, in one load step."""
    case = pressed_column((60, 1, 1), share * (0.5 * np.pi) ** 2, eccentric)
    return question_of(case)


def folded_column(*shares: float) -> Question:
    """A column with a thousandth of the load across, at ``shares`` of Euler's load far beyond it
    (its elastica turns by up to 180 degrees): judged by that of the perfect one."""
    strip = Strip(LENGTH, 1.0, 0.5, 1e6)
    mesh = bar(strip, "hex8", (80, 1, 1))
    load = (0.5 * np.pi) ** 2 * strip.bending / LENGTH**2
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (-load, 0.0, 1e-3 * load))
    ends = []
    for alpha in 0.5 * np.pi * np.sqrt(shares):
        k2 = brentq(lambda m, alpha=alpha: ellipk(m) - alpha, 1e-9, 1.0 - 1e-15)
        ends.append([2.0 * float(ellipe(k2)) / alpha - 2.0, 2.0 * k2**0.5 / alpha])
    model = Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), forces)
    return Question(
        model, list(shares), end_motion(mesh, LENGTH), LENGTH * np.array(ends),
        "elastica, elliptic integrals", LENGTH,
    )  # fmt: skip


def arch(loads: Sequence[float], ways: Sequence[float] | None = None) -> Question:
    """Clamped shallow arch (limit loads 9.06 and 4.03) under forces at its crown: ``ways`` down;
    None: the second branch."""
    case = shallow_arch("hex8", (60, 1, 1), 12.0)
    if ways is None:
        ways = [arch_way(load, last=True) for load in loads]
    return replace(
        question_of(case), factors=np.array(loads) / 12.0, expected=np.array(ways)[:, None],
        size=10.0,
    )  # fmt: skip


def arch_way(load: float, last: bool = False) -> float:
    """The crown's way down where its path first (or last) has this ``load``."""
    ways, loads = _arch_path()
    crossing = np.flatnonzero((loads[:-1] <= load) & (load <= loads[1:]))
    k = int(crossing[-1 if last else 0])
    return float(np.interp(load, loads[k : k + 2], ways[k : k + 2]))


@cache
def _arch_path() -> tuple[Float, Float]:
    strip, half_angle = arch_strip()
    ways = np.linspace(0.2, 10.0, 50)
    loads = clamped_arch(strip, 5.0, half_angle, ways)
    fine = np.linspace(0.0, 10.0, 4001)
    return fine, CubicSpline(np.append(0.0, ways), np.append(0.0, loads))(fine)


def led_arch(way: float, stable: bool) -> Question:
    """The same arch, its crown led down by ``way`` in one step: the force that it takes."""
    base = shallow_arch("hex8", (60, 1, 1), 12.0).model
    crown = np.abs(base.mesh.points[:, 0]) < 1e-9
    assert base.fixed is not None
    fixed = base.fixed.copy()
    fixed[crown, 2] = True
    down = np.where(crown[:, None] & (np.arange(3) == 2), -1.0, 0.0)
    model = Model(base.mesh, base.materials, fixed, prescribed=down)
    ways, loads = _arch_path()
    force = float(np.interp(way, ways, loads)) if stable else np.nan

    def values(step: LoadStep) -> Float:
        return np.array([-step.reactions[crown, 2].sum()])

    return Question(model, [way], values, np.array([[force]]), "Reissner's arch, integrated", 10.0)


def uneven_strip(ratio: float, stiff: str, method: str) -> Question:
    """Half of a cantilever ``ratio`` times as stiff as the other half: its "root" or its "tip";
    alpha = 8 of the soft material."""
    strip = Strip(LENGTH, 1.0, 1.0, 1e6)
    mesh = bar(strip, "hex8", (60, 1, 2))
    root = mesh.points[mesh.cells["hex8"]].mean(axis=1)[:, 0] < 0.5 * LENGTH
    chosen = root if stiff == "root" else ~root
    force = 8.0 * strip.bending / LENGTH**2
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, force))
    half = replace(strip, length=0.5 * LENGTH)
    if stiff == "root":
        x, z, _ = cantilever(half, (0.0, force), DistributedLoad())
        end = [x - half.length, z]
    else:
        # the soft half bears the force at the end of a rigid one

        def clamp(angle: float) -> Float:
            start = np.array([0.0, 0.0, angle, 0.0, force, force * half.length * np.cos(angle)])
            return integrated(half, start, DistributedLoad(), -half.length)

        angle = brentq(lambda a: float(clamp(a)[2]), 0.01, 1.5)
        x, z = clamp(angle)[:2]
        end = [half.length * np.cos(angle) - x - LENGTH, half.length * np.sin(angle) - z]
    materials = [Isotropic(strip.E, 0.0), Isotropic(ratio * strip.E, 0.0)]
    model = Model(
        mesh, materials, clamped_end(mesh), forces, material_of_cell=chosen.astype(np.int32)
    )
    return Question(model, [1.0], end_motion(mesh, LENGTH), np.array([end]), ELASTICA, LENGTH,
                    {"method": method})  # fmt: skip


def tied_strip(first: Counts, second: Counts) -> Question:
    """Two halves of a cantilever, meshed by themselves and tied; alpha = 4."""
    size = (0.5 * LENGTH, 1.0, 1.0)
    one, other = box(size, first), box(size, second, (0.5 * LENGTH, 0.0, 0.0))
    points = np.concatenate([one.points, other.points])
    cells = np.concatenate([one.cells["hex8"], other.cells["hex8"] + one.node_count])
    mesh = Mesh(points, {"hex8": cells})
    joint = (0.5 * LENGTH, 0.0, 0.0)
    faces, others = (select_faces(mesh, plane=(joint, n), normal=n) for n in ("+x", "-x"))
    constraint = tie(mesh, faces, others)
    strip = Strip(LENGTH, 1.0, 1.0, 1e6)
    force = 4.0 * strip.bending / LENGTH**2
    end = select_faces(mesh, plane=((LENGTH, 0.0, 0.0), "+x"))
    model = Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh),
                  face_force(mesh, end, (0.0, 0.0, force)), constraints=[constraint])  # fmt: skip
    x, z, _ = cantilever(strip, (0.0, force), DistributedLoad())
    expected = np.array([[x - LENGTH, z]])
    return Question(model, [1.0], end_motion(mesh, LENGTH), expected, ELASTICA, LENGTH)


def guided_strip() -> Question:
    """Equations keep the end section upright: two cantilevers of half the length; they turn by 60
    degrees between."""
    strip = Strip(LENGTH, 1.0, 1.0, 1e6)
    mesh = bar(strip, "hex8", (80, 1, 1))
    force = 30.0 * strip.bending / LENGTH**2
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, force))
    first, *rest = (int(n) for n in np.flatnonzero(mesh.points[:, 0] >= LENGTH - 1e-9))
    alike = [([(n, axis, 1.0), (first, axis, -1.0)], 0.0) for n in rest for axis in "xz"]
    model = Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), forces,
                  constraints=[equations(mesh, alike)])  # fmt: skip
    half = replace(strip, length=0.5 * LENGTH)
    x, z, _ = cantilever(half, (0.0, force), DistributedLoad())
    expected = np.array([[2.0 * x - LENGTH, 2.0 * z]])
    return Question(model, [1.0], end_motion(mesh, LENGTH), expected, ELASTICA, LENGTH)


def hanging_strip(parameter: float, slender: float) -> Question:
    """Cantilever that hangs by its own weight, q L^3 / E I = ``parameter``."""
    strip = Strip(LENGTH, 1.0, LENGTH / slender, 1e6)
    mesh = bar(strip, "hex8", (200, 1, 1))
    weight = parameter * strip.bending / LENGTH**3
    density = np.full(mesh.cell_count, weight / (strip.width * strip.height))
    x, z, _ = cantilever(strip, (0.0, 0.0), DistributedLoad(dead=(0.0, weight)), 60)
    model = Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh),
                  body_force(mesh, density, (0.0, 0.0, 1.0)))  # fmt: skip
    expected = np.array([[x - LENGTH, z]])
    return Question(model, [1.0], end_motion(mesh, LENGTH), expected, ELASTICA, LENGTH)


def hanging_chain() -> Question:
    """A strip between two clamps, so thin that it hangs as a string: T^3 = E A (q L)^2 / 24."""
    strip = Strip(LENGTH, 1.0, LENGTH / 2000.0, 1e6)
    mesh = bar(strip, "hex8", (200, 1, 1))
    weight = 1e-2 * strip.stretching / LENGTH * 0.03
    density = np.full(mesh.cell_count, weight / (strip.width * strip.height))
    ends = (mesh.points[:, :1] < 1e-9) | (mesh.points[:, :1] > LENGTH - 1e-9)
    model = Model(mesh, Isotropic(strip.E, 0.0), np.repeat(ends, 3, axis=1),
                  body_force(mesh, density, (0.0, 0.0, 1.0)))  # fmt: skip
    tension = (strip.stretching * (weight * LENGTH) ** 2 / 24.0) ** (1.0 / 3.0)
    sag = weight * LENGTH**2 / (8.0 * tension)
    middle = np.abs(mesh.points[:, 0] - 0.5 * LENGTH) < 1e-6

    def values(step: LoadStep) -> Float:
        return np.array([step.u[middle, 2].mean()])

    return Question(model, [1.0], values, np.array([[sag]]), "elastic string")


def heated_column(share: float, aside: float) -> Question:
    """Clamped at both ends and heated to ``share`` of the strain at which it buckles, with a force
    ``aside`` (over Euler's load) at its middle, in one step."""
    strip, expansion = Strip(LENGTH, 1.0, 1.0, 1e6), 1e-5
    mesh = bar(strip, "hex8", (80, 1, 1))
    euler = 4.0 * np.pi**2 * strip.bending / LENGTH**2
    heat = share * euler / strip.stretching / expansion
    ends = (mesh.points[:, :1] < 1e-9) | (mesh.points[:, :1] > LENGTH - 1e-9)
    middle = np.abs(mesh.points[:, 0] - 0.5 * LENGTH) < 1e-9
    forces = nodal_force(mesh, np.flatnonzero(middle), (0.0, 0.0, aside * euler))
    model = Model(mesh, Isotropic(strip.E, 0.0, expansion=expansion), np.repeat(ends, 3, axis=1),
                  forces, temperature=heat)  # fmt: skip
    way = 0.0 if not aside else _heated_middle(strip, expansion * heat, aside * euler)
    expected = np.array([[way if aside or share <= 1.0 else np.nan]])

    def values(step: LoadStep) -> Float:
        return np.array([step.u[middle, 2].mean()])

    return Question(model, [1.0], values, expected, "beam-column", 1.0)


def _heated_middle(strip: Strip, strain: float, force: float) -> float:
    """A beam-column, E I w_xxxx + P w_xx = 0, with half the ``force`` in each half, and a length
    that grows by what the thrust P leaves of the heat's (rotations here are a few hundredths)."""
    half = 0.5 * strip.length
    x = np.linspace(0.0, half, 2001)

    def shape(k: float) -> tuple[Float, Float]:
        """w and its slope."""
        b = -force / (2.0 * strip.bending * k**3)
        a = b * (np.cos(k * half) - 1.0) / np.sin(k * half)
        w = a * (np.cos(k * x) - 1.0) + b * (np.sin(k * x) - k * x)
        return w, k * (b * (np.cos(k * x) - 1.0) - a * np.sin(k * x))

    def left(k: float) -> float:
        longer = float(trapezoid(shape(k)[1] ** 2, x)) / strip.length
        return strain - k * k * strip.bending / strip.stretching - longer

    k = brentq(left, 1e-6, (1.0 - 1e-9) * np.pi / half)
    return abs(float(shape(k)[0][-1]))


def heated_and_loaded() -> Question:
    """A strip of two layers that coils up to 52 degrees by heat, with a force across its end."""
    case = bimetal_strip((100, 1, 2), (52.0,))
    base, heat = case.model, float(case.factors[0])
    strip = Strip(LENGTH, 1.0, 0.25, 1e6)
    force = 2.0 * strip.bending / LENGTH**2
    forces = face_force(base.mesh, select_faces(base.mesh, name="x_max"), (0.0, 0.0, -force))
    model = replace(base, forces=forces / heat)
    curved = replace(strip, length=LENGTH * (1.0 + 0.5 * heat), curvature=np.radians(52.0) / LENGTH)
    x, z, _ = cantilever(curved, (0.0, -force), DistributedLoad())
    expected = np.array([[x - LENGTH, z]])
    return Question(
        model, [heat], end_motion(base.mesh, LENGTH), expected, "Timoshenko, Reissner", LENGTH
    )
