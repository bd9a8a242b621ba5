"""How many hostile inputs are tried, and from which seed.

Environment: ``SEED`` (other inputs than those of every day) and ``HOSTILE_SHARE`` (1, the default:
all of them; CI takes a twentieth).
"""

from __future__ import annotations

import os

__all__ = ["SEED", "SHARE", "share"]

SEED = int(os.environ.get("SEED") or 34)
SHARE = float(os.environ.get("HOSTILE_SHARE") or 1.0)


def share(whole: int) -> int:
    """How many of ``whole`` inputs to try now, at least one."""
    return max(1, round(whole * SHARE))
