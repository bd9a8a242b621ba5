"""Thin shells at large displacements as solids (Sze, Liu & Lo, Finite Elem. Anal. Des. 40 (2004)
1551), units as published."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic, Model, face_force, nodal_force
from gpusim.mesh import Mesh, select_faces
from tests.support.nonlinear_cases import NonlinearCase
from tests.support.verification_models import mapped, unit_block

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

SZE = "Sze, Liu & Lo, Finite Elem. Anal. Des. 40 (2004) 1551"


def _shell(
    kind: str, divisions: Sequence[int], place: Callable[[Float], Float]
) -> tuple[Mesh, Float, Float, Float]:
    """A mapped unit cube, and the coordinates in it."""
    block = unit_block(kind, tuple(divisions))
    return mapped(block, place, straight=False), *block.points.T


def _at(values: Float, value: float) -> Bool:
    return np.asarray(np.abs(values - value) <= 1e-9)


def slit_annulus(
    kind: str, divisions: Sequence[int], factors: Sequence[float] = (1.0,)
) -> NonlinearCase:
    """Flat ring, slit; one lip is clamped, the other lifted by 0.8 per length. Judged by how far
    the inner and the outer end of that are lifted."""

    def place(unit: Float) -> Float:
        angle, r = 2.0 * np.pi * unit[:, 0], 6.0 + 4.0 * unit[:, 1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.03 * (0.5 - unit[:, 2])], axis=1)

    mesh, along, across, _ = _shell(kind, divisions, place)
    lip = _at(along, 1.0)
    forces = face_force(mesh, select_faces(mesh, name="x_max"), (0.0, 0.0, 3.2))
    model = Model(mesh, Isotropic(21e6, 0.0), np.repeat(_at(along, 0.0)[:, None], 3, 1), forces)
    inner, outer = lip & _at(across, 0.0), lip & _at(across, 1.0)
    return NonlinearCase(
        "slit annulus", model, np.array(factors),
        lambda u: np.array([u[inner, 2].mean(), u[outer, 2].mean()]),
        np.array([[13.891, 17.528]]), SZE,
    )  # fmt: skip


def holed_hemisphere(
    kind: str, divisions: Sequence[int], factors: Sequence[float] = (1.0,)
) -> NonlinearCase:
    """Hemisphere with a hole of 18 degrees, pulled and pressed by 400 at its edge, a quarter of it.
    Judged by the ways of the loaded points, outwards and inwards."""

    def place(unit: Float) -> Float:
        turn, lift = 0.5 * np.pi * unit[:, 0], np.radians(72.0) * unit[:, 1]
        r = 10.0 + 0.04 * (unit[:, 2] - 0.5)
        return np.stack([r * np.cos(lift) * np.cos(turn), r * np.cos(lift) * np.sin(turn),
                         r * np.sin(lift)], axis=1)  # fmt: skip

    mesh, along, up, _ = _shell(kind, divisions, place)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[_at(along, 1.0), 0], fixed[_at(along, 0.0), 1] = True, True
    edge = _at(up, 0.0)
    outwards, inwards = edge & _at(along, 0.0), edge & _at(along, 1.0)
    fixed[np.argmin(np.abs(along - 0.5) + up), 2] = True
    forces = nodal_force(mesh, np.flatnonzero(outwards), (200.0, 0.0, 0.0))
    forces += nodal_force(mesh, np.flatnonzero(inwards), (0.0, -200.0, 0.0))
    return NonlinearCase(
        "hemisphere with hole", Model(mesh, Isotropic(6.825e7, 0.3), fixed, forces),
        np.array(factors),
        lambda u: np.array([u[outwards, 0].mean(), -u[inwards, 1].mean()]),
        np.array([[4.067, 8.178]]), SZE,
    )  # fmt: skip


def pulled_cylinder(
    kind: str, divisions: Sequence[int], factors: Sequence[float] = (1.0,)
) -> NonlinearCase:
    """Open cylinder, pulled apart by two forces of 40,000 in its middle, an eighth of it. Judged by
    the way of the loaded point."""

    def place(unit: Float) -> Float:
        angle, r = 0.5 * np.pi * unit[:, 0], 4.953 + 0.094 * (unit[:, 2] - 0.5)
        return np.stack([r * np.sin(angle), 0.5 * 10.35 * unit[:, 1], r * np.cos(angle)], axis=1)

    mesh, around, along, _ = _shell(kind, divisions, place)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    top, side, middle = _at(around, 0.0), _at(around, 1.0), _at(along, 0.0)
    fixed[top, 0], fixed[side, 2], fixed[middle, 1] = True, True, True
    loaded = top & middle
    forces = nodal_force(mesh, np.flatnonzero(loaded), (0.0, 0.0, 1e4))
    return NonlinearCase(
        "pull-out cylinder", Model(mesh, Isotropic(10.5e6, 0.3125), fixed, forces),
        np.array(factors), lambda u: u[loaded, 2].mean(keepdims=True), np.array([[2.768]]), SZE,
    )  # fmt: skip
