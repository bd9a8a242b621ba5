"""Linear materials as laws: ours, and those of users who say their stiffness alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model
from gpusim.fem.materials.linear_elasticity import law_of
from gpusim.mesh import box
from tests.support.law_checks import check_law, strains


class Custom:
    """A user's own material."""

    density = 1.0

    def __init__(self, matrix: Float) -> None:
        self.matrix = matrix

    def stiffness(self) -> Float:
        return self.matrix

    def expansion_strain(self) -> Float:
        return np.array([1e-5, 2e-5, 0.0, 0.0, 0.0, 0.0])


def test_a_users_own_material_is_checked() -> None:
    mesh = box((1.0, 1.0, 1.0), (1, 1, 1))
    matrix = Isotropic(1.0, 0.3).stiffness()
    assert Model(mesh, [Custom(matrix)]).densities.tolist() == [1.0]
    skew = matrix.copy()
    skew[0, 1] += 0.1
    with pytest.raises(InputError, match="isn't symmetric"):
        Model(mesh, [Custom(skew)])
    with pytest.raises(InputError, match=r"materials\[1\]: stiffness\(\) isn't positive definite"):
        Model(mesh, [Custom(matrix), Custom(matrix - 2.0 * np.eye(6))])
    with pytest.raises(InputError, match=r"wrong shape; got \(3, 3\)"):
        Model(mesh, [Custom(matrix[:3, :3])])
    with pytest.raises(InputError, match="aren't finite"):
        Model(mesh, [Custom(matrix * np.nan)])
    with pytest.raises(
        InputError, match=r"materials\[0\]; got str; expected Isotropic, Orthotropic or another law"
    ):
        Model(mesh, ["steel"])  # type: ignore[list-item]


def test_a_material_without_an_update_is_a_linear_law() -> None:
    matrix = gs.Orthotropic((140.0, 10.0, 7.0), (0.3, 0.45, 0.015), (5.0, 3.5, 4.5)).stiffness()
    law = law_of(Custom(matrix), "materials[0]")
    check_law(law, strains(0.1))
    assert (law.density, law.state_size, law.finite_strain) == (1.0, 0, False)
    assert law.expansion_strain()[1] == 2e-5
    strain = strains(0.1)
    np.testing.assert_allclose(
        law.update(strain, None, moduli=False).stress,
        np.einsum("ab,pb->pa", matrix, strain),
        rtol=1e-14,
        atol=1e-13,
    )


def test_what_is_a_law_stays_itself() -> None:
    for law in (Isotropic(1.0, 0.3), gs.NeoHookean(1.0, 0.3), gs.J2(Isotropic(1.0, 0.3), 1e-3)):
        assert law_of(law, "materials[0]") is law


@dataclass
class Flawed:
    """A law that answers one thing wrong."""

    changes: dict[str, Any]
    density: float = 1.0
    state_size: int = 2
    finite_strain: bool = True

    def stiffness(self) -> Float:
        return np.eye(6)

    def expansion_strain(self) -> Float:
        return np.zeros(6)

    def update(self, strain: Float, state: Float | None, *, moduli: bool) -> gs.fem.Update:
        answers = {"stress": strain, "moduli": np.eye(6), "state": state}
        return gs.fem.Update(**{**answers, **self.changes})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"stress": np.zeros(6)}, r"shapes of update\(\)'s stress and moduli; got \(\(6,\), \(6"),
        ({"moduli": None}, r"shapes .*, \(\)\); expected \(2, 3, 6\), and \(6, 6\) or \(2, 3, 6"),
        ({"state": None}, r"shape of update\(\)'s state; got None; expected \(2, 3, 2\)"),
        ({"state": np.zeros((2, 3))}, r"shape of .*; got \(2, 3\); expected \(2, 3, 2\)"),
        ({"stress": np.ones((2, 3, 6))}, "stress without strain; got 1.0; expected 0"),
        ({"stress": np.full((2, 3, 6), np.nan)}, r"update\(\); got values that aren't finite"),
        ({"moduli": 1.1 * np.eye(6)}, r"moduli of update\(\) at rest are off .*; got a diff.* 0.1"),
        ({"moduli": np.full((6, 6), np.nan)}, r"update\(\); got values that aren't finite"),
    ],
)
def test_a_flawed_law_is_refused(changes: dict[str, Any], words: str) -> None:
    law_of(Flawed({}), "materials[3]")
    with pytest.raises(InputError, match=r"^materials\[3\]: " + words):
        law_of(Flawed(changes), "materials[3]")


def test_results_of_a_wrong_shape_are_refused() -> None:
    law = Flawed({})
    law.results = lambda strain, state: {"damage": state[0]}  # type: ignore[attr-defined]
    words = r"^m: shape of results\(\)'s 'damage'; got \(3, 2\); expected \(2, 3\) or \(2, 3, 'c'\)"
    with pytest.raises(InputError, match=words):
        law_of(law, "m")


def test_a_law_with_members_missing_is_refused() -> None:
    class Half(Custom):
        state_size = 0

        def update(self) -> None: ...

    with pytest.raises(InputError, match=r"m: no law; got update\(\) without finite_strain; exp"):
        law_of(Half(np.eye(6)), "m")
