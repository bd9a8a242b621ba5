"""Maps of a correlation: values that can be read, and words for what is missing."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.export.field_catalogue import FieldMap
from gpusim.report.correlation import _readable, _said


@pytest.mark.parametrize(
    ("values", "title", "want"),
    [
        ([2e-4, -1e-5], "exx, hencky", "exx, hencky (10$^{-4}$)"),
        ([0.02, np.nan, 0.01], "u (px, to the right)", "u (px, to the right)"),
        ([3.4e6, 1.0], "Z (mm, from the left camera)", "Z (10$^{6}$ mm, from the left camera)"),
        ([np.nan, np.nan], "sigma (px)", "sigma (px)"),
        ([0.0, 0.0], "sigma (px)", "sigma (px)"),
    ],
)
def test_powers_of_ten_stand_in_the_title(values: list[float], title: str, want: str) -> None:
    shown = _readable(FieldMap(np.array(values), title))
    assert shown.title == want
    power = float(want.split("{")[1].split("}")[0]) if "{" in want else 0.0
    assert np.allclose(shown.values, np.array(values) / 10.0**power, rtol=1e-12, equal_nan=True)


def test_statuses_are_words() -> None:
    assert [_said(s) for s in ("OK", "LOW_CORRELATION")] == ["measured", "low correlation"]
