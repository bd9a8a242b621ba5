"""Numbers as a reader sees them (significant digits, true minus signs, dashes for "no value") and
as JSON has them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np


def plain_data(value: Any) -> Any:
    """Plain data for JSON, with None for numbers that aren't finite, which it doesn't know.

    A dataclass is what its ``content()`` says, else its fields.
    """
    if dataclasses.is_dataclass(value):
        content = getattr(value, "content", None)
        return plain_data(content() if content else vars(value))
    if isinstance(value, Mapping):
        return {key: plain_data(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain_data(one) for one in value]
    if isinstance(value, np.ndarray):
        return plain_data(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def number(value: float, digits: int = 6) -> str:
    """Return ``value`` with ``digits`` significant digits, or a dash for NaN and infinity.

    Trailing zeros stay (32.700 says more than 32.7); beyond 1e-5 … 1e7 a power of ten is split off.
    """
    if not math.isfinite(value):
        return "\N{EN DASH}"
    if value == 0.0:
        return "0"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = int(exponent)
    if -5 <= power < max(digits, 7):
        text = f"{value:.{max(0, digits - 1 - power)}f}"
    else:
        raised = str(power).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        text = f"{mantissa}\N{MULTIPLICATION SIGN}10{raised}"
    return text.replace("-", "\N{MINUS SIGN}")


def uncertain(value: float, sigma: float) -> str:
    """A value as far as two digits of its standard uncertainty say: 62.92466 ± 0.00014."""
    if not 0 < sigma < math.inf:
        return number(value)
    digits = max(1 - math.floor(math.log10(sigma)), 0)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def percent(value: float, digits: int = 3) -> str:
    """Return a fraction as per cent, or a dash for NaN."""
    if not math.isfinite(value):
        return "\N{EN DASH}"
    return f"{number(100.0 * value, digits)}\N{NARROW NO-BREAK SPACE}%"


def signed_percent(value: float, digits: int = 3) -> str:
    """Return a fraction as per cent with its sign, or a dash for NaN."""
    return f"{'+' if value > 0.0 else ''}{percent(value, digits)}"


def duration(seconds: float) -> str:
    """Return a time as a reader says it: 12 ms, 3.40 s, 2 min 05 s, 1 h 10 min."""
    space = "\N{NARROW NO-BREAK SPACE}"
    if not math.isfinite(seconds):
        return "\N{EN DASH}"
    if seconds < 0.9995:
        milliseconds = seconds * 1000.0
        return f"{milliseconds:.0f}{space}ms" if milliseconds >= 1.0 else f"<{space}1{space}ms"
    if seconds < 9.95:
        return f"{seconds:.2f}{space}s"
    if seconds < 99.95:
        return f"{seconds:.1f}{space}s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60}{space}h{space}{minutes % 60:02d}{space}min"
    return f"{minutes}{space}min{space}{rest:02d}{space}s"
