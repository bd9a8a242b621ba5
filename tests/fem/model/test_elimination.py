"""Equations resolved: u = T v + g obeys them all, whatever v is."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.fem import Equations, Isotropic, Model
from gpusim.fem.model.elimination import Elimination, eliminate
from gpusim.mesh import box
from tests.support.tied_blocks import blocks, joined

MESH = box((4.0, 1.0, 1.0), (4, 1, 1))
Row = tuple[list[int], list[float], float]


def model(rows: list[Row], held: dict[int, float] | None = None) -> Model:
    fixed = np.zeros(MESH.points.size, dtype=bool)
    prescribed = np.zeros(MESH.points.size)
    for unknown, value in (held or {}).items():
        fixed[unknown], prescribed[unknown] = True, value
    shape = MESH.points.shape
    return Model(
        MESH, Isotropic(1.0, 0.3), fixed=fixed.reshape(shape),
        prescribed=prescribed.reshape(shape), constraints=Equations.build(rows, fixed.size),
    )  # fmt: skip


def resolved(model: Model, rank: int) -> Elimination:
    """Checked: as many given up as there are independent equations, which hold for any v."""
    found = eliminate(model)
    assert found is not None and model.fixed is not None
    assert found.given_up.sum() == rank
    assert not (found.given_up & model.fixed).any()
    v = np.random.default_rng(5).normal(size=(2, *model.mesh.points.shape))
    v = np.where(model.fixed, model.prescribed_cases, v)
    v = np.where(found.given_up, found.offset, v)
    u = found.displacements(v)
    # what isn't given up is v itself
    np.testing.assert_array_equal(u[:, ~found.given_up], v[:, ~found.given_up])
    for one in model.constraints:
        open_ = one.matrix @ u.reshape(2, -1).T - one.right[:, None]
        size = abs(one.matrix) @ np.abs(u.reshape(2, -1)).T + np.abs(one.right)[:, None]
        assert (np.abs(open_) <= 1e-12 * size).all()
    forces = np.random.default_rng(6).normal(size=v.shape)
    # forces do the same work on u and v
    np.testing.assert_allclose(
        (found.forces(forces) * v).sum(axis=(1, 2)), (forces * u).sum(axis=(1, 2)), rtol=1e-12
    )
    return found


def test_a_chain_is_resolved_link_by_link() -> None:
    """Each follows the next two, and the last ones are fixed or free."""
    rows: list[Row] = [([k, k + 1, k + 2], [1.0, -0.75, -0.25], 0.01 * k) for k in range(30)]
    found = resolved(model(rows, {31: 0.5}), 30)
    assert np.flatnonzero(found.given_up.ravel()).tolist() == list(range(30))


def test_ties_give_up_the_nodes_that_follow() -> None:
    mesh = blocks((2, 2, 1), (3, 3, 1))
    tied = Model(mesh, Isotropic(1.0, 0.3), constraints=joined(mesh))
    found = resolved(tied, 48)
    following = np.flatnonzero(found.given_up.any(axis=1))
    assert (following >= 18).all() and len(following) == 16
    # four nodes with shares at most
    assert np.diff(found.matrix.indptr).max() <= 5


def test_fixed_followers_hold_what_they_follow() -> None:
    """All of one side held: nine equations an axis for three open nodes, the others repeat them."""
    mesh = blocks((2, 2, 1), (4, 4, 1))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[18:, :] = True
    tied = Model(mesh, Isotropic(1.0, 0.3), fixed=fixed, constraints=joined(mesh))
    found = resolved(tied, 27)
    assert found.given_up[9:18].all()


def test_coupled_equations_part_by_part() -> None:
    """Pairs of equations on three unknowns each, one pair said twice in other words."""
    rows: list[Row] = []
    for k in range(0, 30, 3):
        rows += [
            ([k, k + 1, k + 2], [1.0, 2.0, 3.0], 1.0),
            ([k, k + 1, k + 2], [3.0, -1.0, 1.0], float(k)),
        ]
    rows.append(([0, 1, 2], [4.0, 1.0, 4.0], 1.0))
    resolved(model(rows), 20)


def test_equations_of_any_scale_and_terms_of_rounding() -> None:
    rows: list[Row] = [
        ([0, 4], [1e9, -1e9], 0.0),
        ([1, 5], [1e-9, -1e-9], 3e-9),
        # one fixed term, and rounding beside it: says nothing new
        ([20, 8], [1.0, 1e-17], 0.25),
        ([2, 2, 6], [1.0, 1.0, -1.0], 0.0),
    ]
    found = resolved(model(rows, {20: 0.25}), 3)
    assert not found.given_up.ravel()[8]
    # a number that is given up is never found by way of a tiny factor
    assert np.abs(found.matrix.data).max() <= 2.0


def test_redundant_equations_are_legal_contradictions_are_not() -> None:
    twice: list[Row] = [([0, 4], [1.0, -1.0], 0.5), ([4, 0], [3.0, -3.0], -1.5)]
    resolved(model(twice), 1)
    loop: list[Row] = [
        ([0, 4], [1.0, -1.0], 0.5), ([4, 8], [1.0, -1.0], 0.5), ([0, 8], [1.0, -1.0], 1.0),
    ]  # fmt: skip
    resolved(model(loop), 2)
    wrong = [*loop[:2], ([0, 8], [1.0, -1.0], 1.0 + 1e-6)]
    with pytest.raises(InputError, match="contradict each other or the supports"):
        eliminate(model(wrong))
    held = {0: 0.5, 4: 0.25}
    assert eliminate(model([([0, 4], [1.0, -2.0], 0.0)], held)) is not None
    with pytest.raises(InputError, match="contradict each other or the supports"):
        eliminate(model([([0, 4], [1.0, -1.0], 0.0)], held))


def test_contradictions_in_a_later_load_case_are_found() -> None:
    one = model([([0, 4], [1.0, -1.0], 0.0)], {0: 0.5, 4: 0.5})
    assert one.prescribed is not None
    cases = np.stack([one.prescribed, one.prescribed])
    cases[1, 0, 0] = 0.75
    with pytest.raises(InputError, match="contradict"):
        eliminate(
            Model(MESH, one.materials, one.fixed, prescribed=cases, constraints=one.constraints)
        )


def test_a_long_equation_that_would_fill_the_stiffness_is_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    mean: list[Row] = [(list(range(0, 60, 3)), [1.0] * 20, 0.0)]
    resolved(model(mean), 1)
    monkeypatch.setattr("gpusim.fem.model.elimination._MOST_FILL", 300.0)
    with pytest.raises(InputError, match="terms in the stiffness; got 4e"):
        eliminate(model(mean))


def test_too_many_coupled_equations_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gpusim.fem.model.elimination._MOST_COUPLED", 2)
    pair: list[Row] = [([0, 1, 2], [1.0, 2.0, 3.0], 1.0), ([0, 1, 2], [3.0, -1.0, 1.0], 0.0)]
    far: list[Row] = [([3, 4, 5], *one[1:]) for one in pair]
    resolved(model([*pair, *far]), 4)
    more: list[Row] = [*pair, ([0, 1, 2], [0.0, 1.0, 1.0], 0.0)]
    with pytest.raises(InputError, match="3 that share all; expected at most 2"):
        eliminate(model(more))


def test_no_constraints() -> None:
    assert eliminate(Model(MESH, Isotropic(1.0, 0.3))) is None
