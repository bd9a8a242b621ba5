"""Words for what is missing in a correlation."""

from __future__ import annotations

from gpusim.report.correlation import _said, correlation_report


def test_statuses_are_words() -> None:
    assert [_said(s) for s in ("OK", "LOW_CORRELATION")] == ["measured", "low correlation"]


def test_a_picture_without_a_point_fails() -> None:
    """The page mustn't say "done"."""
    settings = {"reference": "a/before.png", "adapter": "none", "version": "1"}
    rows = [{"image": f"a/{k}.png", "measured": 12 * (k % 2), "points": 12} for k in range(4)]
    some = correlation_report(rows, settings, (), ())
    assert some.status == "failed"
    assert some.failure == "No point could be measured in a/0.png, a/2.png."
    assert correlation_report(rows[1:2], settings, (), ()).status == "done"
