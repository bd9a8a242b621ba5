"""How numbers are written for readers."""

# ruff: noqa: RUF001  (typographic signs are what is tested)
from __future__ import annotations

import math

import pytest

from gpusim.report.html import aligned
from gpusim.report.model import Measurement
from gpusim.report.text import duration, number, percent, signed_percent


def plain(text: str) -> str:
    """Narrow no-break spaces as ordinary ones."""
    assert " " not in text
    return text.replace("\u202f", " ")


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (32.7, 6, "32.7000"),
        (-32.70124, 4, "−32.70"),
        (9.9999, 3, "10.0"),
        (0.00012345, 3, "0.000123"),
        (1e-6, 2, "1.0×10⁻⁶"),
        (-1.5e12, 2, "−1.5×10¹²"),
        (100.0, 2, "100"),
        (0.0, 6, "0"),
        (math.nan, 6, "–"),
        (-math.inf, 6, "–"),
    ],
)
def test_number(value: float, digits: int, text: str) -> None:
    assert number(value, digits) == text


def test_percent() -> None:
    assert plain(percent(0.001, 2)) == "0.10 %"
    assert plain(signed_percent(0.0004678)) == "+0.0468 %"
    assert plain(signed_percent(-0.0004678, 2)) == "−0.047 %"
    assert plain(signed_percent(0.0)) == "0 %"
    assert plain(signed_percent(math.nan)) == "–"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "< 1 ms"),
        (0.0123, "12 ms"),
        (0.9996, "1.00 s"),
        (3.456, "3.46 s"),
        (59.94, "59.9 s"),
        (125.2, "2 min 05 s"),
        (4210.0, "1 h 10 min"),
        (math.nan, "–"),
    ],
)
def test_duration(seconds: float, text: str) -> None:
    assert plain(duration(seconds)) == text


def test_aligned_shows_the_error_to_three_digits() -> None:
    item = Measurement.compare("tip", "mm", -32.6859, -32.7012)
    assert aligned(item) == ("−32.6859", "−32.7012", "0.0153")
    assert aligned(Measurement.compare("a", "mm", math.nan, 1.5)) == ("–", "1.50000", "–")
    assert aligned(Measurement.compare("a", "mm", 1.5, 1.5)) == ("1.50000", "1.50000", "0")
    close = Measurement.compare("mode", "Hz", 62.9246587, 62.9246998)
    assert aligned(close) == ("62.9247", "62.9247", "−0.0000411")
    assert aligned(Measurement.compare("a", "mm", 2000.0, 1000.0)) == ("2000.00", "1000.00", "1000")
