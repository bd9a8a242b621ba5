"""Cases of large displacement with a reference: closed forms, integrated bars, published shells.

A case is a model, the factors of its load steps, and the values of each that are judged. Units are
those of the publication.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from gpusim.fem import (
    FollowerPressure,
    Isotropic,
    Model,
    Solution,
    body_force,
    face_force,
    nodal_force,
    solve,
)
from gpusim.mesh import Mesh, select_faces
from tests.support.elastica import (
    DistributedLoad,
    Strip,
    cantilever,
    clamped_arch,
    integrated,
    pulled_ring,
)
from tests.support.verification_models import mapped, unit_block

Float = npt.NDArray[np.float64]

# displacements x, y, z here (Abaqus' y, x, z)
_NAFEMS = np.array([[-12.19, -7.188, 40.50], [-18.76, -10.93, 48.73], [-23.85, -13.74, 53.63],
                    [-47.78, -25.04, 68.52]])  # fmt: skip

ELASTICA = "Reissner's beam, integrated; Bisshopp & Drucker, Quart. Appl. Math. 3 (1945) 272"


@dataclass(frozen=True)
class NonlinearCase:
    """``expected`` (K,V): what ``values`` of the displacements in each load step should be.

    Errors are relative to ``size``, or to the expected value itself where that is None.
    """

    name: str
    model: Model
    factors: Float
    values: Callable[[Float], Float]
    expected: Float
    source: str
    size: float | None = None

    def solve(self, **options: Any) -> Solution:
        """All load steps."""
        return solve(self.model, geometry="nonlinear", factors=self.factors, **options)

    def errors(self, solution: Solution) -> Float:
        """(K,V) relative errors of the wanted steps. Raises AssertionError where one is missing."""
        assert solution.converged, solution.message
        wanted = [step for step in solution.steps if step.wanted]
        assert len(wanted) == len(self.expected)
        found = np.stack([self.values(step.u) for step in wanted])
        size = np.abs(self.expected) if self.size is None else self.size
        return np.asarray((found - self.expected) / size)


def bar(strip: Strip, kind: str, divisions: Sequence[int]) -> Mesh:
    """Along x, its width along y, its middle at z = 0."""
    size = np.array([strip.length, strip.width, strip.height])
    shift = np.array([0.0, 0.0, -0.5 * strip.height])
    block = unit_block(kind, tuple(divisions))
    return mapped(block, lambda unit: unit * size + shift, straight=True)


def clamped_end(mesh: Mesh) -> npt.NDArray[np.bool_]:
    """Fixed degrees of freedom of the nodes at x = 0."""
    return np.repeat(mesh.points[:, :1] <= 1e-9, 3, axis=1)


def end_motion(mesh: Mesh, at: npt.NDArray[np.bool_]) -> Callable[[Float], Float]:
    """Mean displacement x, z of the nodes ``at``."""
    return lambda u: u[at][:, [0, 2]].mean(axis=0)


def end_load(
    kind: str, divisions: Sequence[int], alphas: Sequence[float] = (0.2, 1.0, 2.0, 4.0, 10.0)
) -> NonlinearCase:
    """Slender cantilever under a dead force at its end, P L^2 / E I = ``alphas``."""
    strip = Strip(100.0, 1.0, 1.0, 1e6)
    mesh = bar(strip, kind, divisions)
    unit = strip.bending / strip.length**2
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, unit))
    ends = [cantilever(strip, (0.0, a * unit), DistributedLoad()) for a in alphas]
    return NonlinearCase(
        "elastica, end load", Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), forces),
        np.array(alphas), end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6),
        np.array([[x - strip.length, z] for x, z, _ in ends]), ELASTICA,
    )  # fmt: skip


def published_cantilever(kind: str, divisions: Sequence[int]) -> NonlinearCase:
    """Sze, Liu & Lo's, 10 x 1 x 0.1, E = 1.2e6, nu = 0, under 4 at its end: `end_load` of 4 in
    their dimensions. `PUBLISHED_CANTILEVER` is their value."""
    strip = Strip(10.0, 1.0, 0.1, 1.2e6)
    mesh = bar(strip, kind, divisions)
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, 4.0))
    x, z, _ = cantilever(strip, (0.0, 4.0), DistributedLoad())
    return NonlinearCase(
        "Sze's cantilever", Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), forces),
        np.array([1.0]), end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6),
        np.array([[x - strip.length, z]]), ELASTICA,
    )  # fmt: skip


PUBLISHED_CANTILEVER = (-3.286, 6.698)
"""Displacements x and z of the end (Finite Elem. Anal. Des. 40 (2004) 1551, table 1)."""


def own_weight(kind: str, divisions: Sequence[int], parameter: float = 11.772) -> NonlinearCase:
    """Slender cantilever under its own weight, q L^3 / E I = ``parameter``."""
    strip = Strip(100.0, 1.0, 1.0, 1e6)
    mesh = bar(strip, kind, divisions)
    weight = parameter * strip.bending / strip.length**3
    density = np.full(mesh.cell_count, weight / (strip.width * strip.height))
    forces = body_force(mesh, density, (0.0, 0.0, 1.0))
    x, z, _ = cantilever(strip, (0.0, 0.0), DistributedLoad(dead=(0.0, weight)))
    return NonlinearCase(
        "elastica, own weight", Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), forces),
        np.array([1.0]),
        end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6),
        np.array([[x - strip.length, z]]), ELASTICA,
    )  # fmt: skip


def following_pressure(
    kind: str, divisions: Sequence[int], parameter: float = 12.0
) -> NonlinearCase:
    """Strip under a pressure that stays normal to its face, p b L^3 / E I = ``parameter``: turns to
    104 degrees. The pressed face is the stretched one."""
    strip = Strip(200.0, 1.0, 2.0, 1e6)
    mesh = bar(strip, kind, divisions)
    line = parameter * strip.bending / strip.length**3
    pressed = FollowerPressure(select_faces(mesh, name="z_max"), line / strip.width)
    x, z, angle = integrated(strip, np.zeros(6), DistributedLoad(following=line), -strip.length)[:3]
    # the end was put at 0, along x
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    end = turn @ -np.array([x, z]) - np.array([strip.length, 0.0])
    model = Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), loads=[pressed])
    return NonlinearCase(
        "strip under following pressure", model, np.array([1.0]),
        end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6), end[None], ELASTICA,
    )  # fmt: skip


def roll_up(kind: str, divisions: Sequence[int], turns: float, steps: int) -> NonlinearCase:
    """Strip bent into a circle: its end section is led along the circles of equal bending, turned
    with them. Judged by where its middle is, and by the moment (over that of the last step).

    Load cases: the section's motion along x and z, and its fibres' along x and z by the turn.
    """
    strip = Strip(100.0, 1.0, 1.0, 1e6)
    mesh = bar(strip, kind, divisions)
    end = mesh.points[:, 0] >= strip.length - 1e-6
    height = np.where(end, mesh.points[:, 2], 0.0)
    given = np.zeros((4, mesh.node_count, 3))
    given[0, end, 0] = given[1, end, 2] = 1.0
    given[2, :, 0], given[3, :, 2] = -height, height
    angle = 2.0 * np.pi * turns * np.arange(1, steps + 1) / steps
    sine, cosine = np.sin(angle), np.cos(angle)
    x, z = strip.length * sine / angle, strip.length * (1.0 - cosine) / angle
    fixed = clamped_end(mesh) | end[:, None]
    model = Model(mesh, Isotropic(strip.E, 0.0), fixed, prescribed=given)
    middle = np.abs(mesh.points[:, 0] - 0.5 * strip.length) <= 1e-6
    half = 0.5 * angle
    at = np.stack([np.sin(half), 1.0 - np.cos(half)], axis=1) * strip.length / angle[:, None]
    return NonlinearCase(
        f"rolled up, {turns:g} turns", model, np.stack([x - strip.length, z, sine, cosine - 1], 1),
        end_motion(mesh, middle), at - [0.5 * strip.length, 0.0], "circle", strip.length,
    )  # fmt: skip


def rolled_by_pressures(
    kind: str, divisions: Sequence[int], turns: float, steps: int
) -> NonlinearCase:
    """Strip bent into a circle by pressures p and -p, which turn with it, on the halves of its end,
    p b h^2 / 4 = 2 pi E I ``turns`` / L. The last cells are a thousand times as stiff: the halves
    of an end that gives would differ in area, and push it. Judged by where that end is.
    """
    strip = Strip(100.0, 1.0, 1.0, 1e6)
    mesh = bar(strip, kind, divisions)
    end = select_faces(mesh, normal="+x")
    height = mesh.points[end.nodes[:, :4], 2].mean(axis=1)
    unit = 8.0 * np.pi * turns * strip.bending / (strip.length * strip.width * strip.height**2)
    loads = [FollowerPressure(end[np.flatnonzero(side * height > 0)], side * unit)
             for side in (-1.0, 1.0)]  # fmt: skip
    rigid = strip.length / divisions[0]
    length = strip.length - rigid
    middle = mesh.points[mesh.cells[kind], 0].mean(axis=1)
    model = Model(
        mesh, [Isotropic(strip.E, 0.0), Isotropic(1e3 * strip.E, 0.0)], clamped_end(mesh),
        material_of_cell=(middle > length).astype(np.int32), loads=loads,
    )  # fmt: skip
    factors = np.arange(1, steps + 1) / steps
    angle = 2.0 * np.pi * turns * factors * length / strip.length
    sine, cosine = np.sin(angle), np.cos(angle)
    x = length * sine / angle + rigid * cosine
    z = length * (1.0 - cosine) / angle + rigid * sine
    return NonlinearCase(
        f"rolled up by pressures, {turns:g} turns", model, factors,
        end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6),
        np.stack([x - strip.length, z], axis=1), "circle", strip.length,
    )  # fmt: skip


def ring(kind: str, divisions: Sequence[int], height: float = 1.0) -> NonlinearCase:
    """Quarter of a ring of radius 50, ``height`` thick, pulled apart by 12 E I / R^2."""
    radius, E = 50.0, 1e6
    strip = Strip(2.0 * np.pi * radius, 1.0, height, E, curvature=-1.0 / radius)

    def place(unit: Float) -> Float:
        angle, r = 0.5 * np.pi * unit[:, 0], radius + height * (unit[:, 2] - 0.5)
        return np.stack([r * np.sin(angle), unit[:, 1], r * np.cos(angle)], axis=1)

    mesh = mapped(unit_block(kind, tuple(divisions)), place, straight=False)
    x, _, z = mesh.points.T
    top, side = np.abs(x) <= 1e-9, np.abs(z) <= 1e-9
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[top, 0], fixed[side, 2] = True, True
    fixed[mesh.points[:, 1] <= 1e-9, 1] = True
    force = 12.0 * strip.bending / radius**2
    forces = nodal_force(mesh, np.flatnonzero(top), (0.0, 0.0, 0.5 * force))
    return NonlinearCase(
        "ring, pulled", Model(mesh, Isotropic(E, 0.0), fixed, forces), np.array([1.0]),
        lambda u: np.array([u[top, 2].mean(), u[side, 0].mean()]),
        np.array([pulled_ring(strip, force)]), "Reissner's ring, integrated",
    )  # fmt: skip


def curved_cantilever(kind: str, divisions: Sequence[int]) -> NonlinearCase:
    """NAFEMS 3DNLG-5: an eighth of a circle of radius 100, 1 x 1, under 300, 450, 600, 3000."""

    def place(unit: Float) -> Float:
        angle, r = 0.25 * np.pi * unit[:, 0], 100.0 - (unit[:, 1] - 0.5)
        return np.stack([r * np.sin(angle), 100.0 - r * np.cos(angle), unit[:, 2] - 0.5], axis=1)

    mesh = mapped(unit_block(kind, tuple(divisions)), place, straight=False)
    fixed = clamped_end(mesh)
    end = np.abs(mesh.points[:, 0] + mesh.points[:, 1] - 100.0) <= 1e-6
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, 1.0))
    return NonlinearCase(
        "NAFEMS 3DNLG-5", Model(mesh, Isotropic(1e7, 0.0), fixed, forces),
        np.array([300.0, 450.0, 600.0, 3000.0]), lambda u: u[end].mean(axis=0),
        _NAFEMS, "NAFEMS R0024, test 3DNLG-5 (Abaqus, elements B33)",
    )  # fmt: skip


def shallow_arch(kind: str, divisions: Sequence[int], load: float) -> NonlinearCase:
    """Clamped circular arch, span 100, rise 5, 1 x 1, under a force at its crown: it snaps through
    at 9.06, and comes back at 4.03. Judged by the crown's way down on the second branch."""
    strip, half_angle = arch_strip()
    radius = -1.0 / strip.curvature

    def place(unit: Float) -> Float:
        angle, r = half_angle * (2.0 * unit[:, 0] - 1.0), radius + unit[:, 2] - 0.5
        return np.stack([r * np.sin(angle), unit[:, 1], r * np.cos(angle)], axis=1)

    block = unit_block(kind, tuple(divisions))
    mesh = mapped(block, place, straight=False)
    x = block.points[:, 0]
    crown = np.abs(x - 0.5) <= 1e-9
    fixed = np.repeat(((x <= 1e-9) | (x >= 1.0 - 1e-9))[:, None], 3, axis=1)
    forces = nodal_force(mesh, np.flatnonzero(crown), (0.0, 0.0, -load))
    way = arch_way(load)
    return NonlinearCase(
        "shallow arch", Model(mesh, Isotropic(strip.E, 0.0), fixed, forces), np.array([1.0]),
        lambda u: -u[crown, 2].mean(keepdims=True), np.array([[way]]),
        "Reissner's arch, integrated",
    )  # fmt: skip


def arch_strip() -> tuple[Strip, float]:
    """The arch' middle line, and half its angle."""
    span, rise = 100.0, 5.0
    radius = (span**2 / 4.0 + rise**2) / (2.0 * rise)
    half_angle = float(np.arcsin(0.5 * span / radius))
    return Strip(2.0 * radius * half_angle, 1.0, 1.0, 1e5, -1.0 / radius), half_angle


def arch_way(load: float) -> float:
    """The crown's way down under ``load``, on the branch that ends highest."""
    ways, loads = _arch_path()
    last = len(ways) - 1 - int(np.argmax(loads[::-1] < load))
    exact = CubicSpline(ways, loads - load)
    return float(brentq(exact, ways[last], ways[last + 1]))


@cache
def _arch_path() -> tuple[Float, Float]:
    strip, half_angle = arch_strip()
    ways = np.linspace(0.2, 10.0, 50)
    return ways, clamped_arch(strip, 5.0, half_angle, ways)


def bimetal_strip(divisions: Sequence[int], degrees: Sequence[float]) -> NonlinearCase:
    """Strip of two layers (E = 1e6 both), one of which is heated so that it coils up to circles of
    ``degrees`` (Timoshenko, J. Opt. Soc. Am. 11 (1925) 233)."""
    assert divisions[2] % 2 == 0
    strip = Strip(100.0, 1.0, 0.25, 1e6)
    mesh = bar(strip, "hex8", divisions)
    materials = [Isotropic(strip.E, 0.0, expansion=2e-5), Isotropic(strip.E, 0.0)]
    centres = np.concatenate([mesh.points[cells].mean(axis=1) for _, _, cells in mesh.blocks()])
    upper = (centres[:, 2] > 0.0).astype(np.int32)
    angle = np.radians(degrees)
    # equal layers: 3/2 of the difference of their strains over the height
    strain = angle / strip.length * strip.height / 1.5
    model = Model(mesh, materials, clamped_end(mesh), material_of_cell=upper, temperature=5e4)
    # half of the heat's strain stretches the middle
    length = strip.length * (1.0 + 0.5 * strain)
    x, z = length * np.sin(angle) / angle, length * (1.0 - np.cos(angle)) / angle
    return NonlinearCase(
        "bimetal strip", model, strain, end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6),
        np.stack([x - strip.length, z], axis=1), "Timoshenko's circle", strip.length,
    )  # fmt: skip


def pressed_column(divisions: Sequence[int], alpha: float, eccentric: float) -> NonlinearCase:
    """Clamped column under P L^2 / E I = ``alpha`` along it, and ``eccentric`` times that across;
    it buckles at (pi / 2)^2."""
    strip = Strip(100.0, 1.0, 1.0, 1e6)
    mesh = bar(strip, "hex8", divisions)
    load = alpha * strip.bending / strip.length**2
    end = select_faces(mesh, name="x_max")
    forces = face_force(mesh, end, (-load, 0.0, eccentric * load))
    x, z, _ = cantilever(strip, (-load, eccentric * load), DistributedLoad(), 60)
    return NonlinearCase(
        "column", Model(mesh, Isotropic(strip.E, 0.0), clamped_end(mesh), forces), np.array([1.0]),
        end_motion(mesh, mesh.points[:, 0] >= strip.length - 1e-6),
        np.array([[x - strip.length, z]]), ELASTICA, strip.length,
    )  # fmt: skip
