"""The turned linear element: its stress, strain, heat and stability."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.fem import Isotropic, Orthotropic, thermal
from gpusim.fem.elements.corotational import Corotational
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.element_response import ElementBlock, Want
from gpusim.mesh import Mesh, box
from tests.support.element_meshes import mesh_of
from tests.support.element_responses import (
    FORMS,
    ROTATION,
    Body,
    E,
    Matrices,
    SaintVenantKirchhoff,
    elements,
    single,
    tensors,
)
from tests.support.stability_block import lowest_of_pressed_block

Form = tuple[str, str, str]
TURNED = [form for form in FORMS if form[0] == "corotational"]
ONE = np.array([0])
STRETCH = np.array([[1.02, 0.01, 0.0], [0.01, 0.97, -0.005], [0.0, -0.005, 1.01]])


@pytest.mark.parametrize("form", TURNED)
def test_point_values_of_an_even_strain(form: Form) -> None:
    nodes = single(form[1])
    own = elements(form, nodes, np.arange(len(nodes))[None])
    u = nodes @ (ROTATION @ STRETCH).T + [1.0, 2.0, 3.0] - nodes
    values = own.point_values(ONE, u)
    biot = STRETCH - np.eye(3)
    voigt = np.array([*np.diag(biot), *(2.0 * biot[i, j] for i, j in ((0, 1), (1, 2), (2, 0)))])
    stress = tensors(SaintVenantKirchhoff().stiffness() @ voigt)
    np.testing.assert_allclose(
        tensors(values.piola)[0],
        np.broadcast_to(stress, (*values.piola.shape[1:2], 3, 3)),
        atol=1e-10,
    )
    cauchy = ROTATION @ stress @ ROTATION.T
    np.testing.assert_allclose(tensors(values.cauchy)[0] - cauchy, 0.0, atol=1e-10)
    green = 0.5 * (STRETCH @ STRETCH - np.eye(3))
    np.testing.assert_allclose(tensors(values.strain, 0.5)[0] - green, 0.0, atol=1e-14)
    extent = np.abs(np.linalg.eigvalsh(STRETCH) - 1.0).max()
    assert own.strain_extent(ONE, u) == pytest.approx([extent], rel=1e-9)
    rule = ELEMENTS[form[1]].rule(form[2])
    assert values.volume.shape == (1, len(rule.weight))


@pytest.mark.parametrize("form", TURNED)
def test_heat_turns_with_the_material(form: Form) -> None:
    material = Orthotropic(
        E=(900.0, 400.0, 600.0), nu=(0.2, 0.25, 0.1), G=(250.0, 200.0, 300.0),
        expansion=(1e-3, 4e-3, -2e-3), axes=tuple(map(tuple, ROTATION)),
    )  # fmt: skip
    mesh = mesh_of(form[1], (2, 1, 1), amount=0.05, bulge=0.02)
    cells = mesh.cells[form[1]].astype(np.int32)
    rule = ELEMENTS[form[1]].rule(form[2])
    free = np.ones((len(cells), len(rule.weight), 1)) * material.expansion_strain()
    block = ElementBlock(form[1], form[2], mesh.points, cells, Linear(material))
    own = Corotational(block, Matrices(block))
    own.free_strain = free
    # warm and held it is the linear element
    body = Body(mesh, own, np.ones_like(mesh.points, dtype=bool))
    held, _ = body.dense(np.zeros_like(mesh.points))
    linear = thermal(mesh, [material], 1.0, formulation={form[1]: form[2]})
    assert np.abs(held + linear).max() <= 1e-12 * np.abs(linear).max()
    # free to expand, and turned, it has no stress
    values = tensors(material.expansion_strain(), 0.5)
    u = mesh.points @ (ROTATION @ (np.eye(3) + values)).T - mesh.points
    which = np.arange(len(cells))
    assert np.abs(own.response(which, u, Want.FORCES)[0]).max() <= 1e-12 * E
    assert np.abs(own.point_values(which, u).cauchy).max() <= 1e-11 * E
    # cold again
    own.free_strain = None
    assert np.abs(own.response(which, u, Want.FORCES)[0]).max() >= 1e-4 * E


class Linear(SaintVenantKirchhoff):
    """With the stiffness of a material."""

    def __init__(self, material: Isotropic | Orthotropic) -> None:
        object.__setattr__(self, "material", material)

    def stiffness(self) -> np.ndarray:
        return self.material.stiffness()  # type: ignore[attr-defined,no-any-return]


@pytest.mark.parametrize("aspect", [20, 100])
def test_a_block_pressed_through_its_thickness_is_stable(aspect: int) -> None:
    form = "corotational", "hex8", "incompatible"
    for strain in (0.003, 0.03, 0.15, 0.3):
        assert lowest_of_pressed_block(form, aspect, strain) >= -1e-7 * E


def test_stress_of_a_bent_strip_is_the_beams() -> None:
    """A strip rolled into an arc of 90 degrees: stress E y / r at the points, in its own axes."""
    length, height, count = 10.0, 0.1, 40
    mesh = strip(length, height, count)
    law = SaintVenantKirchhoff(0.0)
    own = elements(("corotational", "hex8", "incompatible"), mesh.points, mesh.cells["hex8"], law)
    radius = length / (0.5 * np.pi)
    angle = mesh.points[:, 0] / radius
    out = radius - mesh.points[:, 2]
    bent = np.stack([out * np.sin(angle), mesh.points[:, 1], radius - out * np.cos(angle)], axis=1)
    values = own.point_values(np.arange(count), bent - mesh.points)
    bending = 0.5 * height / np.sqrt(3.0) / radius * E
    # nodes on the arc: cells are chords of it
    chord = -((length / count / radius) ** 2) / 24.0 * E
    stress = np.sort(values.piola[..., 0], axis=1)
    expected = np.repeat([chord - bending, chord + bending], 4)
    np.testing.assert_allclose(stress - expected, 0.0, atol=2e-4 * bending)
    assert np.abs(values.piola[..., 1:]).max() <= 0.05 * bending
    axis = angle.reshape(2, 2, count + 1)[0, 0]
    middle = 0.5 * (axis[1:] + axis[:-1])
    tangent = np.stack([np.cos(middle), 0.0 * middle, np.sin(middle)], axis=1)
    along = np.einsum("mi,mqij,mj->mq", tangent, tensors(values.cauchy), tangent)
    np.testing.assert_allclose(np.sort(along, axis=1), stress, atol=1e-9 * bending)


def strip(length: float, height: float, count: int) -> Mesh:
    return box((length, 1.0, height), (count, 1, 1), origin=(0.0, 0.0, -0.5 * height))
