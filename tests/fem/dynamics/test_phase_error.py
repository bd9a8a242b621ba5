"""Phase errors against closed forms, and the lag of a body that vibrates freely for long."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.fem.dynamics.phase_error import stepped_frequency
from gpusim.fem.dynamics.time_integration import Scheme

BAR = gs.mesh.box(size=(1.0, 0.1, 0.1), divisions=(6, 1, 1))
STEEL = gs.Isotropic(210e9, 0.3, density=7850.0)
HELD = np.isclose(BAR.points[:, :1], 0.0).repeat(3, axis=1)


def test_newmark_turns_by_twice_the_arc_of_half_the_tangent() -> None:
    """tan(turn' / 2) = turn / 2 of the trapezoidal rule."""
    scheme = Scheme.named("newmark", 1.0)
    for turn in (1e-2, 0.3, 2.0):
        assert stepped_frequency(scheme, turn) == pytest.approx(2.0 * np.arctan(turn / 2.0), 1e-9)


@pytest.mark.parametrize("method", ["newmark", "hht", "generalized-alpha"])
def test_the_lag_of_a_free_vibration(method: str) -> None:
    """Of the first mode, let go: from where its stepped amplitude passes zero for the last time."""
    model = gs.Model(BAR, STEEL, HELD)
    mode = gs.modes(model, 1)
    period, cycles, per_cycle = 1.0 / mode.frequencies[0], 10, 24
    times = np.linspace(0.0, cycles * period, cycles * per_cycle + 1)
    found = gs.transient(
        model, times=times, method=method, step=times[1],
        initial=(mode.shapes[0], np.zeros((BAR.node_count, 3))),
    )  # fmt: skip
    node, axis = np.unravel_index(np.abs(mode.shapes[0]).argmax(), BAR.points.shape)
    u = np.asarray(found.u)[:, node, axis]
    last = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))[-1]
    crossed = np.interp(0.0, u[last : last + 2], times[last : last + 2]) / period
    (said,) = [text for text in found.warnings if "of a cycle" in text]
    stated = float(found.message.split("; ")[1].split()[0])
    # it should have been at three quarters of the last cycle
    assert stated * (cycles - 0.25) / cycles == pytest.approx(crossed - (cycles - 0.25), rel=0.03)
    assert float(said.split()[2]) == pytest.approx(mode.frequencies[0], rel=0.01)


def test_what_hardly_lags_is_no_warning() -> None:
    """Pushed once: many modes, of which the first moves the body."""
    push = np.zeros(BAR.points.shape)
    push[-1, 2] = 1e3
    model = gs.Model(BAR, STEEL, HELD, push)
    period = 1.0 / gs.modes(model, 1).frequencies[0]
    found = gs.transient(
        model, times=np.linspace(0.0, 2.0 * period, 41), method="newmark", step=period / 200
    )
    assert float(found.message.split("; ")[1].split()[0]) == pytest.approx(1.65e-4, rel=0.1)
    assert not any("of a cycle" in text for text in found.warnings)
    rests = gs.transient(
        model,
        times=[0.0, 50.0 * period],
        method="newmark",
        step=period,
        initial=gs.fem.solve(model),
    )
    assert "; 0.0e+00 cycles late" in rests.message and rests.warnings == ()
