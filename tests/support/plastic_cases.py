"""Plastic bodies with a solution by one coordinate as finite element models, and how far off they
are: a tube under pressure, a widened one, bars and plates in bending, a bar pulled and pressed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.fem import (
    J2,
    FollowerPressure,
    Isotropic,
    LoadStep,
    Model,
    Solution,
    equations,
    solve,
)
from gpusim.fem.elements.element import ELEMENTS
from gpusim.mesh import Mesh, select_faces
from tests.support.plastic_references import Bent, Metal, Tube, bar_stress
from tests.support.verification_models import mapped, unit_block

Float = npt.NDArray[np.float64]

INNER, OUTER = 100.0, 200.0
STEEL = Metal(210e3, 0.3, 240.0, 2100.0)
PRESSURE, PRESSURES = 170.0, (0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95, 1.0, 0.5, 0.0)
"""Flows from 0.62 on; a thin layer at the bore comes close to flowing back."""
SOFT = Metal(1000.0, 0.3, 20.0, 50.0)
WIDENING = 30.0
WEAK = Metal(200e3, 0.3, 2.0, 4e3)
"""Strains of 1e-5, at which those of bars and plates are what theory takes them for."""
HEIGHT, MOMENTS = 2.0, (0.9, 1.1, 1.2, 1.3, 1.4, 0.0, -1.4)
PLATE_MOMENTS = (0.9, *np.arange(1.01, 1.401, 0.01), 0.0)
"""Over the one at which flow begins. In a plate stress turns as it flows: small steps are needed
(of a twentieth, the curvature that stays is off by 0.5 %)."""
_ANGLE = np.radians(2.0)


def law(metal: Metal) -> J2:
    return J2(Isotropic(metal.E, metal.nu), metal.Y, metal.H)


@dataclass(frozen=True)
class Slice:
    """Elements of one ``kind`` and ``formulation``, ``cells`` along the coordinate that counts."""

    kind: str
    formulation: str
    cells: int

    def __str__(self) -> str:
        return f"{self.kind} {self.formulation}, {self.cells} cells"

    def solve(
        self, model: Model, factors: Sequence[float] | Float
    ) -> tuple[Solution, list[LoadStep]]:
        """The solution, and its steps, none of which had to be cut back."""
        form = {self.kind: self.formulation}
        found = solve(
            model, geometry="nonlinear", factors=factors, formulation=form, tolerance=1e-8
        )
        assert found.converged, found.message
        assert all(step.wanted and step.substeps == 1 for step in found.steps)
        return found, list(found.steps)

    def points(self, mesh: Mesh) -> Float:
        """(M,Q,3) quadrature points at rest."""
        shape = ELEMENTS[self.kind].rule(self.formulation).shape
        return np.asarray(np.einsum("qk,mki->mqi", shape, mesh.points[mesh.cells[self.kind]]))


def sector(part: Slice) -> tuple[Mesh, dict[str, Any]]:
    """Of the tube, one cell of two degrees wide, held in plane strain between its two planes."""
    side = (OUTER - INNER) / part.cells

    def place(unit: Float) -> Float:
        radius, angle = INNER + (OUTER - INNER) * unit[:, 0], _ANGLE * unit[:, 1]
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), side * unit[:, 2]], axis=1)

    mesh = mapped(unit_block(part.kind, (part.cells, 1, 1)), place, straight=False)
    x, y, _ = mesh.points.T
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[:, 1], fixed[:, 2] = np.abs(y) <= 1e-9, True
    other = np.flatnonzero(np.abs(np.arctan2(y, x) - _ANGLE) <= 1e-9)
    normal = {"x": -float(np.sin(_ANGLE)), "y": float(np.cos(_ANGLE))}
    rows = [([(node, axis, factor) for axis, factor in normal.items()], 0.0) for node in other]
    return mesh, {"fixed": fixed, "constraints": [equations(mesh, rows)]}


def radial(mesh: Mesh, u: Float, radius: float) -> float:
    """Mean displacement outwards of the nodes at ``radius``."""
    plane = mesh.points[:, :2]
    at = np.abs(np.linalg.norm(plane, axis=1) - radius) <= 1e-6
    return float((u[at, :2] * plane[at]).sum(axis=1).mean() / radius)


@cache
def pressed_tube(pressures: tuple[float, ...]) -> tuple[Tube, Float]:
    """The reference, and the bore's displacements at the shares of `PRESSURE`."""
    tube, bore = Tube(STEEL, INNER, OUTER), []
    for share in pressures:
        tube.step(PRESSURE * share)
        bore.append(tube.u[0])
    return tube, np.array(bore)


def tube_under_pressure(part: Slice) -> dict[str, float]:
    """Largest relative errors of the bore's displacement at `PRESSURES`, and of the hoop stress
    that stays, against pressures in steps of a hundredth; of the axial stress that stays, which
    depends on the steps most, against the same steps."""
    mesh, given = sector(part)
    wall = FollowerPressure(select_faces(mesh, name="x_min"), PRESSURE)
    _, steps = part.solve(Model(mesh, law(STEEL), loads=[wall], **given), PRESSURES)
    up = np.arange(0.5, 1.001, 0.01)
    fine, exact = pressed_tube((*up, 0.5, 0.0))
    same, _ = pressed_tube(PRESSURES)
    taken = np.searchsorted(up, np.array(PRESSURES[:-2]) - 1e-6)
    found = np.array([radial(mesh, step.u, INNER) for step in steps])
    bore = found / np.append(exact[taken], exact[-2:]) - 1.0
    hoop, axial = (_stress_errors(part, mesh, steps[-1], tube) for tube in (fine, same))
    errors = {"bore": bore, "hoop stress left": hoop[:, 0], "axial stress left": axial[:, 1]}
    return {name: float(np.abs(values).max()) for name, values in errors.items()}


def _stress_errors(part: Slice, mesh: Mesh, step: LoadStep, tube: Tube) -> Float:
    """(cells,2) of hoop and axial stress, means over each ring of cells, over the greatest."""
    points, cauchy = part.points(mesh).reshape(-1, 3), tube.cauchy()
    radius, angle = np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
    assert step.stress is not None
    xx, yy, zz, xy = step.stress.points[part.kind].reshape(-1, 6)[:, :4].T
    hoop = xx * np.sin(angle) ** 2 + yy * np.cos(angle) ** 2 - xy * np.sin(2.0 * angle)
    ring = ((radius - INNER) / (OUTER - INNER) * part.cells).astype(np.int64)
    exact = [np.interp(radius, tube.middles, cauchy[:, axis]) for axis in (1, 2)]
    errors = [np.bincount(ring, one) for one in (hoop - exact[0], zz - exact[1])]
    return np.stack(errors, axis=1) / np.bincount(ring)[:, None] / np.abs(cauchy[:, 1]).max()


def widened_tube(part: Slice, steps: int = 6) -> float:
    """Relative error of the pressure at which a soft tube's bore is wider by `WIDENING`; the
    reference takes 60 steps."""
    mesh, given = sector(part)
    plane = mesh.points[:, :2]
    bore = np.abs(np.linalg.norm(plane, axis=1) - INNER) <= 1e-6
    outwards = np.zeros_like(mesh.points)
    outwards[bore, :2] = WIDENING * plane[bore] / INNER
    fixed = np.array(given["fixed"])
    fixed[bore] = True
    given["fixed"] = fixed
    model = Model(mesh, law(SOFT), prescribed=outwards, **given)
    _, taken = part.solve(model, np.arange(1, steps + 1) / steps)
    tube, pressure = Tube(SOFT, INNER, OUTER), 0.0
    for share in np.arange(1, 61) / 60:
        pressure = tube.step(bore=WIDENING * share)
    force = float((taken[-1].reactions[bore, :2] * plane[bore]).sum() / INNER)
    # what the neighbouring sectors exert on the bore's nodes isn't the pressure's
    area = (INNER + WIDENING) * _ANGLE * (OUTER - INNER) / part.cells
    return force / area / pressure - 1.0


def bent(part: Slice, plate: bool) -> Float:
    """Relative errors of the curvature at `PLATE_MOMENTS` of a plate that doesn't strain across, or
    at `MOMENTS` of a blade a hundredth as wide as high.

    One cell along, its upper half: sections stay flat, the middle one is at rest.
    """
    moments = PLATE_MOMENTS if plate else MOMENTS
    length = HEIGHT / part.cells
    width = length if plate else 0.01 * HEIGHT
    size = np.array([length, width, 0.5 * HEIGHT])
    block = unit_block(part.kind, (1, 1, part.cells))
    mesh = mapped(block, lambda unit: unit * size, straight=True)
    x, y, z = mesh.points.T
    fixed = np.stack([(x == 0.0) | (z == 0.0), (y == 0.0) | (z == 0.0) | plate, z < 0.0], axis=1)
    fixed[(x == 0.0) & (y == 0.0) & (z == 0.0), 2] = True
    end = np.flatnonzero((x >= length - 1e-9) & (z > 0.0))
    top = end[np.argmax(z[end] - y[end])]
    turned = [
        ([(node, "x", 1.0), (top, "x", -z[node] / z[top])], 0.0) for node in end if node != top
    ]
    forces = np.zeros_like(mesh.points)
    forces[top, 0] = width / HEIGHT  # a unit moment, half of it on this half
    model = Model(mesh, law(WEAK), fixed, forces, constraints=[equations(mesh, turned)])
    _, steps = part.solve(model, first_flow(plate) * np.array(moments))
    found = np.array([step.u[top, 0] for step in steps]) / (length * z[top])
    return np.asarray(found / curvatures(plate) - 1.0)


@cache
def curvatures(plate: bool) -> Float:
    """The reference's; that of a plate goes a quarter of a hundredth at a time."""
    reference, first, begin, result = Bent(WEAK, HEIGHT, plate), first_flow(plate), 1.0, []
    for moment in PLATE_MOMENTS if plate else MOMENTS:
        count = max(round((moment - begin) / 0.0025), 1) if plate else 1
        for share in np.linspace(begin, moment, 1 + count)[1:]:
            reference.step(float(share) * first)
        result.append(reference.curvature)
        begin = max(float(moment), 1.0)
    return np.array(result)


def first_flow(plate: bool) -> float:
    """Moment of a unit of width at which flow begins."""
    across = WEAK.nu if plate else 0.0
    stress = WEAK.Y / float(np.sqrt(1.0 - across + across**2))
    return stress * HEIGHT**2 / 6.0


def bar_errors(part: Slice, mesh: Mesh, strains: Sequence[float]) -> Float:
    """Relative errors of the force of a bar of `STEEL` of any mesh between x = 0 and 1, free to
    thin, pulled and pressed to logarithmic ``strains``."""
    low = np.abs(mesh.points) <= 1e-9
    end = mesh.points[:, 0] >= 1.0 - 1e-9
    fixed = low.copy()
    fixed[end, 0] = True
    given = np.where(end[:, None], [1.0, 0.0, 0.0], 0.0)
    stretch = np.exp(np.array(strains))
    _, steps = part.solve(Model(mesh, law(STEEL), fixed, prescribed=given), stretch - 1.0)
    area = float(np.ptp(mesh.points[:, 1]) * np.ptp(mesh.points[:, 2]))
    stress = np.array([step.reactions[end, 0].sum() for step in steps]) * stretch / area
    return np.asarray(stress / bar_stress(STEEL, strains) - 1.0)
