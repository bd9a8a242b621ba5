"""Numbers as report.json writes them."""

from __future__ import annotations

import math

__all__ = ["json_number"]


def json_number(value: float) -> float | None:
    """A plain float, or None for NaN and infinity, which JSON doesn't know."""
    return float(value) if math.isfinite(value) else None
