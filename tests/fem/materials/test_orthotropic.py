"""Orthotropic elasticity: stiffness by closed forms, rotation, thermal expansion, refusals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, Orthotropic, stress
from gpusim.mesh import box
from tests.support.fem_reference import direct

E, NU, G = (140.0, 10.0, 7.0), (0.3, 0.45, 0.015), (5.0, 3.5, 4.5)
CARBON = Orthotropic(E, NU, G, density=1.6, expansion=(-0.5e-6, 3e-5, 2e-5))


def rotation(axis: int, angle: float) -> npt.NDArray[np.float64]:
    """Rows are the turned axes."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, s, -s, c
    return matrix


def turned(axes: npt.NDArray[np.float64]) -> Orthotropic:
    return Orthotropic(E, NU, G, expansion=CARBON.expansion, axes=axes)  # type: ignore[arg-type]


def test_compliance_says_what_the_constants_mean() -> None:
    compliance = np.linalg.inv(CARBON.stiffness())
    # pulled along 1: extension 1/E1, contraction nu12/E1 along 2 and nu13/E1 = nu31/E3 along 3
    np.testing.assert_allclose(
        compliance[:, 0], [1 / 140, -0.3 / 140, -0.015 / 7, 0, 0, 0], rtol=1e-13, atol=1e-18
    )
    np.testing.assert_allclose(compliance[2, 1], -0.45 / 10, rtol=1e-13)
    np.testing.assert_allclose(np.diag(compliance)[3:], [1 / 5, 1 / 3.5, 1 / 4.5], rtol=1e-14)


def test_equal_constants_are_isotropic_in_any_axes() -> None:
    axes = rotation(2, 0.7) @ rotation(0, -1.1)
    shear = 210.0 / 2.6
    same = Orthotropic((210.0,) * 3, (0.3,) * 3, (shear,) * 3, expansion=(1e-5,) * 3, axes=axes)  # type: ignore[arg-type]
    steel = Isotropic(210.0, 0.3, expansion=1e-5)
    np.testing.assert_allclose(same.stiffness(), steel.stiffness(), rtol=0, atol=1e-12 * 210)
    np.testing.assert_allclose(same.expansion_strain(), steel.expansion_strain(), atol=1e-20)
    assert not steel.expansion_strain()[3:].any()


def test_turning_moves_the_axes() -> None:
    # by 90 degrees about z: material axis 1 along y, 2 along -x
    matrix = turned(rotation(2, np.pi / 2)).stiffness()
    order = [1, 0, 2, 3, 5, 4]
    np.testing.assert_allclose(matrix, CARBON.stiffness()[np.ix_(order, order)], atol=1e-13)
    expansion = turned(rotation(2, np.pi / 2)).expansion_strain()
    np.testing.assert_allclose(expansion, [3e-5, -0.5e-6, 2e-5, 0, 0, 0], atol=1e-20)


@pytest.mark.parametrize("angle", [0.2, np.pi / 4, 1.3])
def test_off_axis_modulus_and_shear_coupling(angle: float) -> None:
    """A bar pulled along x with fibres at an angle: the textbook's E_x, nu_xy and eta_xy,x."""
    material = turned(rotation(2, angle))
    mesh = box((2.0, 1.0, 1.0), (2, 2, 2))
    rng = np.random.default_rng(3)
    inner = np.abs(mesh.points - [1.0, 0.5, 0.5]).max(axis=1) < 0.1
    mesh = mesh.moved(np.where(inner[:, None], 0.1 * rng.random(mesh.points.shape), 0.0))
    c, s = np.cos(angle), np.sin(angle)
    e1, e2, nu12, g12 = E[0], E[1], NU[0], G[0]
    inverse = c**4 / e1 + s**4 / e2 + (1 / g12 - 2 * nu12 / e1) * (c * s) ** 2
    poisson = nu12 / e1 * (c**4 + s**4) - (1 / e1 + 1 / e2 - 1 / g12) * (c * s) ** 2
    coupling = (2 / e1 + 2 * nu12 / e1 - 1 / g12) * s * c**3
    coupling -= (2 / e2 + 2 * nu12 / e1 - 1 / g12) * s**3 * c
    strain = np.linalg.inv(material.stiffness())[:, 0]
    np.testing.assert_allclose(strain[[0, 1, 3]], [inverse, -poisson, coupling], rtol=1e-12)
    # and in the elements: the linear displacement of this strain on the surface, solved inside
    gradient = np.array(
        [[strain[0], strain[3], strain[5]], [0, strain[1], strain[4]], [0, 0, strain[2]]]
    )
    u = mesh.points @ gradient.T
    fixed = np.repeat(~inner[:, None], 3, axis=1)
    model = Model(mesh, [material], fixed, prescribed=np.where(fixed, u, 0.0))
    solved = direct(model)
    np.testing.assert_allclose(solved, u, rtol=0, atol=1e-14)
    found = stress(model, solved)
    np.testing.assert_allclose(found.nodal, [[1.0, 0, 0, 0, 0, 0]] * len(u), rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.strains, [strain] * len(u), rtol=0, atol=1e-14)


def test_wrong_constants_are_refused() -> None:
    good = {"E": E, "nu": NU, "G": G}
    left = np.diag([1.0, 1.0, -1.0])
    for words, change in {
        "E out of range": {"E": (1.0, -1.0, 1.0)},
        "G out of range; got 3.0": {"G": 3.0},
        "nu out of range": {"nu": (0.1, np.nan, 0.1)},
        r"nu31 makes the stiffness indefinite; got 0.3; expected a size below sqrt\(E3/E1\)": {
            "nu": (0.3, 0.3, 0.3)
        },
        "1 - nu12 nu21": {"E": (1.0, 1.0, 1.0), "nu": (0.6, 0.6, 0.6)},
        "density out of range": {"density": -1.0},
        "expansion out of range": {"expansion": (1.0, 2.0)},
        "axes are left-handed": {"axes": left},
        "axes are off orthonormal by": {"axes": 1.01 * np.eye(3)},
        "axes; got": {"axes": "xyz"},
    }.items():
        with pytest.raises(InputError, match=words):
            Orthotropic(**{**good, **change})  # type: ignore[arg-type]
    with pytest.raises(InputError, match="Orthotropic: G; got True; expected a number > 0"):
        Orthotropic(E=(1, 1, 1), nu=(0, 0, 0), G=(True, 1, 1))  # type: ignore[arg-type]


def test_slightly_rounded_axes_are_made_exact() -> None:
    rounded = np.round(rotation(1, 0.9), 7)
    axes = np.array(turned(rounded).axes)
    assert np.abs(axes @ axes.T - np.eye(3)).max() <= 1e-15
    assert 0.0 < np.abs(axes - rounded).max() <= 1e-7
