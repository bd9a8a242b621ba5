"""Histories: between their instants, as superpositions, in files."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.fem.model import history as histories
from gpusim.fem.model.history import State, Superposition, interpolated
from tests.support.vibrating_bar import greatest, vibrating_bar

TIMES = np.linspace(0.0, 2.0, 21)
LOADS = np.cos(np.outer(TIMES, [1.0, 2.0]))


def test_cubics_are_exact_of_cubic_motions() -> None:
    def state(t: float) -> State:
        value = np.array(
            [[2.0 + t - 3.0 * t**2 + t**3], [1.0 - 6.0 * t + 3.0 * t**2], [-6.0 + 6.0 * t]]
        )
        return State(t, *value, np.zeros(2))

    found, expected = interpolated(state(0.2), state(1.4), 0.25), state(0.5)
    for got, value in zip(found, (expected.u, expected.v, expected.a), strict=True):
        assert np.allclose(got, value, rtol=1e-12)


def test_superpositions_index_as_arrays_do() -> None:
    rng = np.random.default_rng(3)
    one = Superposition(rng.standard_normal((5, 4)), rng.standard_normal((4, 7, 3)))
    whole = np.einsum("tn,nij->tij", one.amplitudes, one.shapes)
    assert one.shape == whole.shape and len(one) == 5
    keys = (2, slice(1, 4), [0, 3], (slice(None), 5), (1, slice(2, 4), 0), (slice(0, 2), 6, 1))
    inner = ((..., 2), (3, ..., 0), (..., 4, 1), (slice(None), ...), (..., slice(0, 2)), ...)
    for key in (*keys, *inner, ([0, 3], 6), (slice(None), [1, 5], [0, 2])):
        assert np.allclose(one[key], whole[key], rtol=1e-13, atol=1e-14)
    assert np.allclose(np.asarray(one), whole) and np.allclose(2.0 * np.asarray(one), 2.0 * whole)
    # arrays would take these two by two
    with pytest.raises(InputError, match="history: index"):
        one[[0, 1], [3, 4]]


def test_between_instants_it_goes_on() -> None:
    model, ramp = vibrating_bar(), gs.Record([0.0, 2.0], [[0.0, 0.0], [2.0, 0.0]])
    coarse, fine = (
        gs.transient(model, times=times, loads=ramp, method="newmark", step=0.0125)
        for times in (TIMES, np.linspace(0.0, 2.0, 161))
    )
    found = [coarse.at(float(time)) for time in fine.times]
    assert greatest(np.array([u for u, _ in found]) - fine.u, fine.u) <= 1e-3
    assert greatest(np.array([v for _, v in found]) - fine.v, fine.v) <= 2e-2
    assert np.array_equal(coarse.at(2.0)[0], coarse.u[-1])
    for time in (-1e-9, 2.0001, np.nan):
        with pytest.raises(InputError, match=r"History\.at: time"):
            coarse.at(time)


@pytest.mark.parametrize("method", ["newmark", "modal"])
def test_a_file_holds_the_same(method: str, tmp_path: Path) -> None:
    model, path = vibrating_bar(), tmp_path / "history.h5"
    inside, streamed = (
        gs.transient(model, times=TIMES, loads=LOADS, method=method, file=file)
        for file in (None, path)
    )
    for name in "uva":
        data = getattr(streamed, name)
        assert isinstance(data, h5py.Dataset) and data.shape == (21, 16, 3)
        assert greatest(data[:] - np.asarray(getattr(inside, name)), data[:]) <= 1e-12
    assert np.array_equal(streamed.at(0.123)[1], inside.at(0.123)[1])
    assert np.array_equal(streamed.energy.kinetic, inside.energy.kinetic)
    with h5py.File(path, "r") as file:
        assert np.array_equal(file["times"][:], TIMES)
        assert np.array_equal(file["dissipated"][:], inside.energy.dissipated)
    assert list(tmp_path.iterdir()) == [path]


def test_what_memory_does_not_hold_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(histories, "host_memory", lambda: 10_000)
    with pytest.raises(InputError, match="file="):
        gs.transient(vibrating_bar(), times=TIMES, loads=LOADS, method="newmark")
    # modes need no more than themselves
    assert gs.transient(vibrating_bar(), times=TIMES, loads=LOADS).u.shape == (21, 16, 3)


def test_drift_is_what_is_missing() -> None:
    energy = gs.fem.EnergyHistory(*np.array([[0.0, 3.0], [1.0, 2.0], [0.0, 5.0], [0.0, 0.5]]))
    assert energy.imbalance.tolist() == [0.0, -0.5]
    assert energy.drift == 0.1
