"""Every kernel's twin check is able to fail: one corrupted value, or one NaN, turns it red."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gpusim.errors import TwinMismatch
from gpusim.gpu import Device, compare, twin_checks
from tests.support.shader_stages import stages


def test_every_stage_is_listed() -> None:
    assert {
        "fem/device/stiffness",
        "fem/krylov/cg",
        "optics/shading/forward_pass",
        "measure/correlation/icgn",
    } <= set(twin_checks())
    assert set(twin_checks()) == set(stages())


@pytest.mark.parametrize("stage", sorted(twin_checks()))
def test_one_wrong_value_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch, stage: str
) -> None:
    seen = []

    def damaged(what: str, got: Any, want: Any, *rest: Any, **options: Any) -> float:
        values = np.array(got, np.float64)
        middle = values.size // 2
        wrong = values.reshape(-1)[middle] + 1.0 + 0.01 * np.abs(values).max()
        seen.append(what)
        values.reshape(-1)[middle] = np.nan
        with pytest.raises(TwinMismatch, match="finite"):
            compare(what, values, want, *rest, **options)
        values.reshape(-1)[middle] = wrong
        return compare(what, values, want, *rest, **options)

    monkeypatch.setattr("gpusim.gpu.twin.compare", damaged)
    with pytest.raises(TwinMismatch, match=r"values? off|finite"):
        twin_checks()[stage](device)
    assert len(seen) == 1, "the first comparison should have failed"
