"""Changes of slope and the notches that they belong to."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim import measure
from gpusim.pipeline.measurements.damage.comparison import NO_CHANGES, DamageLine, DamageResult
from gpusim.pipeline.measurements.results import PointTable

X = np.linspace(0.0, 100.0, 41)


def line(notches_mm: tuple[float, ...], found: measure.SlopeChanges) -> DamageLine:
    curve = 0.02 * np.maximum(X - 31.0, 0.0) + 0.01 * np.maximum(X - 74.0, 0.0)
    return DamageLine("cut", "side", "x", "+z", X, curve, curve, curve, curve, 0.1, notches_mm,
                      found, found)  # fmt: skip


def rows(one: DamageLine) -> list[list[str]]:
    table = PointTable("state", (1,), ("cut",), {"position_mm": np.zeros((1, 1))})
    text = DamageResult("damage", table, "whole", 1.0, (one,)).tables()["-breaks"]
    return [row.split(",") for row in text.splitlines()[1:]]


def test_a_change_belongs_to_the_nearest_notch() -> None:
    found = measure.slope_changes(X, line((), NO_CHANGES).difference_mm)
    cut = line((30.0, 77.0, 95.0), found)
    assert cut.nearest(30.0) == pytest.approx((31.0, 31.0), abs=1e-6)
    assert cut.nearest(77.0)[0] == pytest.approx(74.0, abs=1e-6)
    assert np.isnan(cut.nearest(95.0)).all()
    assert [row[-2:] for row in rows(cut)] == [["30", "31"], ["77", "74"]]
    assert [float(row[4]) for row in rows(cut)] == pytest.approx([20.0, 10.0], rel=1e-6)


def test_changes_without_any_notch_have_none_beside_them() -> None:
    found = measure.slope_changes(X, line((), NO_CHANGES).difference_mm)
    assert [row[-2:] for row in rows(line((), found))] == 2 * [["", ""]]
    assert rows(line((), NO_CHANGES)) == []
    assert np.isnan(line((), NO_CHANGES).fitted_mm).all()
