"""The block Davidson iteration on matrices whose eigenvalues are known."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from gpusim.errors import NotConverged
from gpusim.fem.eigenvalues.davidson import Apply, Eigenpairs, Pencil, davidson

Float = npt.NDArray[np.float64]
COUNT = 10


class Known:
    """K and M of given eigenvalues lambda (n,), and the vectors (n,n) as rows."""

    def __init__(self, values: Float, seed: int = 4) -> None:
        rng, size = np.random.default_rng(seed), len(values)
        turn = np.linalg.qr(rng.standard_normal((size, size)))[0]
        root = np.eye(size) + np.tril(rng.standard_normal((size, size)), -1) / size
        self.values, self.order = values, np.sort(values)
        self.mass = root @ root.T
        self.stiffness = root @ turn @ np.diag(values) @ turn.T @ root.T
        self.vectors = np.linalg.solve(root.T, turn).T
        # half of a cycle's work is done wrong, at random
        wrong = np.linalg.qr(rng.standard_normal((size, size)))[0]
        spread = wrong @ np.diag(rng.uniform(0.5, 1.0, size)) @ wrong.T
        back = self.vectors.T / np.sqrt(values)
        self.nearly = back @ spread @ back.T

    def pencil(self, exact: bool, **other: object) -> Pencil:
        inverse = np.linalg.inv(self.stiffness) if exact else self.nearly
        parts: dict[str, object] = {
            "energy": lambda x: x @ self.stiffness,
            "inertia": lambda x: x @ self.mass,
            "solve": lambda r: r @ inverse,
            "unknown": np.ones(len(self.values), dtype=bool),
            "known": np.zeros((0, len(self.values))),
            "weakest": 1.0 if exact else 0.5,
        }
        return Pencil(**{**parts, **other})  # type: ignore[arg-type]


def agree(found: Eigenpairs, known: Known, tolerance: float = 1e-8) -> None:
    count = len(found.values)
    error = np.abs(found.values * known.order[:count] - 1.0)
    assert found.converged
    assert (error <= tolerance).all()
    # and the rounding of the matrices themselves
    assert (error <= found.error + 1e-10).all()
    gram = found.vectors @ known.stiffness @ found.vectors.T
    assert np.abs(gram - np.eye(count)).max() <= 1e-10


SQUARES = np.arange(1.0, 301.0) ** 2
TRIPLE, CLUSTER = SQUARES.copy(), SQUARES.copy()
TRIPLE[3:6] = TRIPLE[4]
CLUSTER[1:12] = 4.0 * (1.0 + 5e-4 * np.arange(11))


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("values", [SQUARES, TRIPLE, CLUSTER, (50.0 + np.arange(300)) ** 2])
def test_values_vectors_and_errors(values: Float, exact: bool) -> None:
    known = Known(values)
    pencil = known.pencil(exact)
    found = davidson(pencil, COUNT, 1e-8, pencil.random(8, 0))
    agree(found, known)
    # vectors to the root: what lies outside of the span of the true ones, and their cluster's
    inside = known.vectors[values <= 1.02 * known.order[COUNT - 1]]
    flat = found.vectors * np.sqrt(found.values)[:, None] ** -1
    shares = flat @ known.mass @ inside.T
    assert (1.0 - (shares**2).sum(axis=1) <= 1e-8).all()


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("hidden", [0, 3, 9])
def test_what_a_start_lacks_is_found(exact: bool, hidden: int) -> None:
    values = (1.0 + np.arange(300.0) / 50.0) ** 2
    known = Known(values)
    pencil, mode = known.pencil(exact), known.vectors[hidden]
    if not exact:
        # a solver that would never bring it in, either
        part = known.nearly - np.outer(mode, mode @ known.mass @ known.nearly)
        part = part - np.outer(part @ known.mass @ mode, mode)
        part += 0.7 / values[hidden] * np.outer(mode, mode)
        pencil = known.pencil(False, solve=lambda r: r @ part)
    start = pencil.random(8, 0)
    start -= np.outer(start @ known.mass @ mode, mode)
    agree(davidson(pencil, COUNT, 1e-8, start), known)


@pytest.mark.parametrize(("size", "count"), [(1, 1), (12, 12), (40, 39), (40, 40)])
def test_all_of_a_small_space(size: int, count: int) -> None:
    known = Known(SQUARES[:size])
    pencil = known.pencil(True)
    agree(davidson(pencil, count, 1e-8, pencil.random(8, 0)), known)


def test_known_vectors_are_left_out() -> None:
    known = Known(SQUARES)
    first = known.vectors[:6] / np.sqrt(SQUARES[:6, None])
    pencil = known.pencil(False, known=first)
    found = davidson(pencil, 4, 1e-8, pencil.random(8, 0))
    assert np.abs(found.values * SQUARES[6:10] - 1.0).max() <= 1e-8
    assert np.abs(found.vectors @ known.stiffness @ first.T).max() <= 1e-10


def test_of_both_signs_the_greatest_are_wanted() -> None:
    """B indefinite, as the geometric stiffness is: 1/mu are load factors."""
    known = Known(SQUARES)
    factors = np.where(np.arange(300) % 3 == 0, -SQUARES, SQUARES)
    inertia = known.mass @ known.vectors.T @ np.diag(SQUARES / factors) @ known.vectors @ known.mass
    pencil = known.pencil(True, inertia=lambda x: x @ inertia)
    found = davidson(pencil, 5, 1e-8, pencil.random(8, 0))
    assert np.abs(found.values * SQUARES[[1, 2, 4, 5, 7]] - 1.0).max() <= 1e-8
    assert -1.0 <= found.least <= -0.99
    # all negative: none is looked for
    pencil = known.pencil(True, inertia=lambda x: -x @ known.mass, negligible=1e-4)
    assert (davidson(pencil, 5, 1e-8, pencil.random(8, 0)).values < 0.0).all()


def test_an_inner_solve_that_isnt_definite_never_counts_as_converged() -> None:
    known = Known(SQUARES)
    exact = np.linalg.inv(known.stiffness)
    calls = 0

    def turned(r: Float) -> Float:
        nonlocal calls
        calls += 1
        return r @ exact * (1.0 if calls < 4 else -1e-3)

    pencil = known.pencil(True, solve=turned)
    found = davidson(pencil, COUNT, 1e-8, pencil.random(8, 0))
    assert not found.converged
    assert np.isinf(found.error).any()


def test_no_more_than_half_of_the_solves_are_overhead() -> None:
    """Ten modes by an exact solver took 41 solves in the study that chose it."""
    known, solved = Known(SQUARES), 0
    exact = np.linalg.inv(known.stiffness)

    def solve(r: Float) -> Float:
        nonlocal solved
        solved += len(r)
        return r @ exact

    pencil = known.pencil(True, solve=solve)
    agree(davidson(pencil, COUNT, 1e-8, pencil.random(8, 0)), known)
    assert solved <= 70


def broken(energy: Apply) -> None:
    pencil = Known(SQUARES).pencil(True, energy=energy)
    davidson(pencil, COUNT, 1e-8, pencil.random(8, 0))


def test_stiffnesses_that_arent_positive_definite_are_told() -> None:
    sign = np.where(np.arange(300) % 2, 1.0, -1.0)
    with pytest.raises(NotConverged, match="energy isn't positive"):
        broken(lambda x: x * sign)
    with pytest.raises(NotConverged, match="aren't finite"):
        broken(lambda x: x * np.nan)
