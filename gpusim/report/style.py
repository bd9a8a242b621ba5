"""One look for all figures; series colours that colour-blind readers can tell apart.

The series colours are those of Okabe & Ito (2008), in the variant that keeps a contrast of 3 : 1 on
white. On a dark page the report's style sheet inverts the lightness of plots and keeps their hues,
so that one file serves both.
"""

from __future__ import annotations

__all__ = ["BAD", "DPI", "GOOD", "GRID", "MEASURED", "MUTED", "PAGE", "TEXT", "TRUTH"]

DPI = 200
PAGE = "#ffffff"
TEXT = "#16202b"
MUTED = "#5b6876"
GRID = "#e3e8ee"
TRUTH = "#0072b2"
MEASURED = "#d55e00"
GOOD = "#0b8f6a"
BAD = "#c2321b"
