"""Words for what is missing in a correlation."""

from __future__ import annotations

from gpusim.report.correlation import _said


def test_statuses_are_words() -> None:
    assert [_said(s) for s in ("OK", "LOW_CORRELATION")] == ["measured", "low correlation"]
