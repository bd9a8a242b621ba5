"""Rigid-body modes: motions that cost no energy, known exactly before any other mode."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.assembly.equation_of_motion import EquationOfMotion
from gpusim.fem.model.supports import FreeMotions, axis_name, free_motions

# products of inertia below this share of the moments are none: the axes are principal ones
_PRINCIPAL = 1e-9


@dataclass(frozen=True, eq=False)
class RigidBodyModes:
    """Rows (k,3N) of x, orthonormal in the equation's mass, and their names; ``value``: about the
    lowest elastic eigenvalue of the bodies that have them, 0 where there are none."""

    rows: Float
    names: tuple[str, ...]
    value: float


def rigid_body_modes(equation: EquationOfMotion) -> RigidBodyModes:
    """Of all bodies that aren't held: translations, and rotations about principal axes through the
    body's centre of mass; of a mechanism, whatever it leaves free."""
    every = list(free_motions(equation.model))
    if not every:
        return RigidBodyModes(np.zeros((0, len(equation.unknown))), (), 0.0)
    rows, names = [], []
    for number, free in enumerate(every, 1):
        modes, own = _of_body(equation, free)
        rows.append(modes)
        names += own if len(every) == 1 else [f"{name} of body {number}" for name in own]
    value = min(_elastic_value(equation, free) for free in every)
    return RigidBodyModes(np.concatenate(rows), tuple(names), value)


def _of_body(equation: EquationOfMotion, free: FreeMotions) -> tuple[Float, list[str]]:
    x = equation.unknowns(free.displacements(equation.model.mesh.points))
    if not free.as_one:
        return _orthonormal(equation, x), [f"motion {k + 1} of a mechanism" for k in range(len(x))]
    body = free.motions[int(np.argmax(np.abs(free.motions).sum(axis=(1, 2))))]
    turning = np.flatnonzero(np.abs(body[3:]).max(axis=0) > 1e-6)
    first = int(turning[0]) if len(turning) else len(x)
    still, turned = _orthonormal(equation, x[:first]), x[first:]
    turned = turned - (turned @ equation.inertia(still).T) @ still
    inertia = turned @ equation.inertia(turned).T
    spins = body[3:, first:]
    off = inertia - np.diag(np.diag(inertia))
    if len(turned) and np.abs(off).max() > _PRINCIPAL * np.abs(inertia).max():
        axes = np.linalg.eigh(inertia)[1]
        turned, spins = axes.T @ turned, spins @ axes
    names = [f"translation {axis_name(one)}" for one in body[:3, :first].T]
    names += [f"rotation about {axis_name(one)}" for one in spins.T]
    return np.concatenate([still, _orthonormal(equation, turned)]), names


def _orthonormal(equation: EquationOfMotion, x: Float) -> Float:
    """In the mass, each row less its shares of those before it."""
    gram = x @ equation.inertia(x).T
    return np.asarray(np.linalg.solve(np.linalg.cholesky(gram), x))


def _elastic_value(equation: EquationOfMotion, free: FreeMotions) -> float:
    """About the square of the lowest frequency of a plate or bar of a body's length and thickness:
    (c t / L^2)^2, which is a third of it for a cube and a fortieth for a slender bar."""
    points = equation.model.mesh.points[np.unique(free.node)]
    spread = points - points.mean(axis=0)
    sides = np.sqrt(12.0 / len(points) * np.maximum(np.linalg.eigvalsh(spread.T @ spread), 0.0))
    model = equation.model
    assert model.material_of_cell is not None
    used = [model.materials[number] for number in np.unique(model.material_of_cell)]
    speed = min(one.stiffness()[3, 3] / one.density for one in used)
    return float(speed * (sides[0] / sides[2] ** 2) ** 2)
