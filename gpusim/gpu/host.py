"""The machine beside the device."""

from __future__ import annotations

import os

__all__ = ["available_memory", "host_memory"]


def available_memory() -> int | None:
    """Bytes of main memory that new work may take, by Linux; None elsewhere."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return int(line.split()[1]) * 1024
    except OSError:
        pass
    return None


def host_memory() -> int:
    """Free bytes of main memory, or a guess where the system doesn't tell."""
    available = available_memory()
    if available is not None:
        return available
    if hasattr(os, "sysconf") and "SC_AVPHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return 4 << 30
