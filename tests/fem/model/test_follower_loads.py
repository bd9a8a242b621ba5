"""Pressure that goes with the body: its forces, their derivative, and what is refused."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import InputError
from gpusim.fem import FollowerPressure, Isotropic, Model, pressure, solve
from gpusim.mesh import Mesh, boundary_faces, box, quadratic, select_faces
from tests.support.element_meshes import linear_mesh

Float = npt.NDArray[np.float64]


def bent(points: Float) -> Float:
    """Displacements that turn and stretch."""
    x, y, z = points.T
    return np.stack([0.3 * z * x, 0.2 * x * y - 0.1 * z, 0.4 * x + 0.1 * y * z], axis=1)


MESHES = {
    "quad4": lambda: box((1.0, 0.8, 0.6), (2, 2, 2)),
    "quad8": lambda: quadratic(box((1.0, 0.8, 0.6), (2, 2, 2))),
    "tri3": lambda: linear_mesh("tet4", (2, 2, 2)),
    "tri6": lambda: quadratic(linear_mesh("tet4", (2, 2, 2))),
}


@pytest.mark.parametrize("name", MESHES)
def test_on_the_undeformed_body_it_is_the_dead_pressure(name: str) -> None:
    mesh = MESHES[name]()
    faces = boundary_faces(mesh)[np.arange(5)]
    forces = FollowerPressure(faces, 3.0).forces(mesh.points)
    assert np.abs(forces - pressure(mesh, faces, 3.0)).max() <= 1e-14


@pytest.mark.parametrize("name", MESHES)
def test_forces_stay_normal_and_add_up(name: str) -> None:
    # all around the body they are in balance, however it is deformed
    mesh = MESHES[name]()
    forces = FollowerPressure(boundary_faces(mesh), 2.0).forces(mesh.points + bent(mesh.points))
    moments = np.cross(mesh.points + bent(mesh.points), forces)
    assert np.abs(forces.sum(axis=0)).max() <= 1e-13
    assert np.abs(moments.sum(axis=0)).max() <= 1e-13


def stiffness(mesh: Mesh, load: FollowerPressure, points: Float) -> Float:
    """(3N,3N) by its parts."""
    total = np.zeros((points.size, points.size))
    for part in load.parts:
        matrices = part.stiffness(np.arange(len(part.cells)), points)
        for cell, matrix in zip(part.cells, matrices, strict=True):
            at = (3 * cell[:, None] + np.arange(3)).ravel()
            total[np.ix_(at, at)] += matrix
    return total


@pytest.mark.parametrize("name", MESHES)
def test_stiffness_is_minus_the_derivative_where_there_is_a_potential(name: str) -> None:
    mesh = MESHES[name]()
    load = FollowerPressure(boundary_faces(mesh), 2.0)
    place = mesh.points + bent(mesh.points)
    motion = np.random.default_rng(5).normal(size=place.shape)
    # forces are of third order in positions at most: central differences of two steps are exact
    step = 0.05
    first, second = (
        (load.forces(place + h * motion) - load.forces(place - h * motion)) / (2.0 * h)
        for h in (step, 2.0 * step)
    )
    derivative = (4.0 * first - second) / 3.0
    found = (stiffness(mesh, load, place) @ motion.ravel()).reshape(-1, 3)
    assert np.abs(found + derivative).max() <= 1e-10 * np.abs(derivative).max()
    assert np.abs(found - derivative).max() > 0.1 * np.abs(derivative).max()


def test_linear_statics_takes_the_forces_of_the_undeformed_body() -> None:
    mesh = box((1.0, 0.2, 0.2), (5, 1, 1))
    fixed = np.repeat(mesh.points[:, :1] < 1e-9, 3, axis=1)
    top = select_faces(mesh, name="z_max")
    dead = Model(mesh, Isotropic(1e6, 0.3), fixed, pressure(mesh, top, 10.0))
    follower = Model(mesh, Isotropic(1e6, 0.3), fixed, loads=[FollowerPressure(top, 10.0)])
    u = solve(dead).u
    assert np.abs(solve(follower).u - u).max() <= 1e-12 * np.abs(u).max()
    assert solve(follower).reactions.sum(axis=0)[2] == pytest.approx(2.0)


def test_a_renumbered_load_is_the_same() -> None:
    mesh = quadratic(box((1.0, 0.8, 0.6), (2, 2, 2)))
    load = FollowerPressure(boundary_faces(mesh), 2.0)
    order = np.random.default_rng(1).permutation(mesh.node_count)
    place = np.empty(len(order), dtype=np.int32)
    place[order] = np.arange(len(order))
    other = load.renumbered(place, mesh.points[order])
    assert np.abs(other.forces(mesh.points[order]) - load.forces(mesh.points)[order]).max() <= 1e-14


def test_wrong_loads_are_refused() -> None:
    mesh, other = box((1, 1, 1), (1, 1, 1)), box((1, 1, 1), (2, 1, 1))
    faces = select_faces(mesh, name="x_max")
    with pytest.raises(InputError, match="FollowerPressure: value"):
        FollowerPressure(faces, np.nan)
    with pytest.raises(InputError, match="at least one"):
        FollowerPressure(faces[np.zeros(0, int)], 1.0)
    with pytest.raises(InputError, match=r"loads\[0\].case.*got 1"):
        Model(mesh, Isotropic(1.0, 0.3), loads=[FollowerPressure(faces, 1.0, case=1)])
    with pytest.raises(InputError, match="another mesh"):
        Model(other, Isotropic(1.0, 0.3), loads=[FollowerPressure(faces, 1.0)])
    with pytest.raises(InputError, match=r"loads\[0\].*got ndarray"):
        Model(mesh, Isotropic(1.0, 0.3), loads=[pressure(mesh, faces, 1.0)])


@pytest.mark.parametrize("given", ["x", None, [1.0, 2.0], np.nan, True])
def test_a_pressure_is_one_number(given: object) -> None:
    faces = boundary_faces(box((1.0, 1.0, 1.0), (1, 1, 1)))
    with pytest.raises(InputError, match="FollowerPressure: value"):
        FollowerPressure(faces, given)  # type: ignore[arg-type]
    assert type(FollowerPressure(faces, 2).value) is float


@pytest.mark.parametrize("case", ["x", None, 0.5, True])
def test_a_load_case_has_a_whole_number(case: object) -> None:
    faces = boundary_faces(box((1.0, 1.0, 1.0), (1, 1, 1)))
    with pytest.raises(InputError, match="FollowerPressure: case"):
        FollowerPressure(faces, 1.0, case)  # type: ignore[arg-type]


def test_faces_of_a_mesh_with_as_many_nodes_are_refused() -> None:
    mesh, other = box((1.0, 1.0, 1.0), (2, 1, 1)), box((2.0, 1.0, 1.0), (2, 1, 1))
    steel, load = Isotropic(1.0, 0.3), FollowerPressure(boundary_faces(other), 1.0)
    with pytest.raises(InputError, match=r"Model\.loads\[0\]; got faces of another mesh"):
        Model(mesh, [steel], loads=[load])
    assert Model(other, [steel], loads=[load]).loads == (load,)
    for given in (None, 3):
        with pytest.raises(InputError, match=r"Model.loads; got .*; expected .*FollowerPressure"):
            Model(mesh, [steel], loads=given)  # type: ignore[arg-type]
        with pytest.raises(InputError, match=r"Model.constraints; got .*; expected .*Equations"):
            Model(mesh, [steel], constraints=given)  # type: ignore[arg-type]
