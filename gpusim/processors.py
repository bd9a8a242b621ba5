"""How many processors there are to share work out to."""

from __future__ import annotations

import os
from functools import cache

__all__ = ["processors"]


@cache
def processors() -> int:
    """Processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
