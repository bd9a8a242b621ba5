"""Processors to share work out to, and main memory that new work may take.

That memory is the least of what the system has free, what a container or job may take (control
groups 2 and 1) and what the process may map (``ulimit -v``).
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

_own = threading.local()
_GROUPS = Path("/sys/fs/cgroup")
_SHARE = 0.8  # of the machine's memory, that one file may take


@cache
def all_processors() -> int:
    """Processors this process may use; GPUSIM_PROCESSORS in the environment says so, too."""
    if told := os.environ.get("GPUSIM_PROCESSORS", ""):
        return max(int(told), 1) if told.isdecimal() else 1
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def processors() -> int:
    """Processors this thread may share its work out to: all of them, unless it is `limited`."""
    limit: int | None = getattr(_own, "limit", None)
    return all_processors() if limit is None else limit


@contextmanager
def limited(count: int) -> Iterator[None]:
    """This thread shares its work out to ``count`` processors meanwhile."""
    before: int | None = getattr(_own, "limit", None)
    _own.limit = count
    try:
        yield
    finally:
        _own.limit = before


def share_nothing() -> None:
    """This thread does its work alone from now on."""
    _own.limit = 1


def available_memory() -> int | None:
    """Bytes of main memory that new work may take, by Linux; None elsewhere."""
    free = _table(Path("/proc/meminfo")).get("MemAvailable")
    if free is None:
        return None
    return max(min(1024 * free, _left_to_map(), *_left_to_groups()), 0)


def host_memory() -> int:
    """Free bytes of main memory, or a guess where the system doesn't tell."""
    available = available_memory()
    if available is not None:
        return available
    if hasattr(os, "sysconf") and "SC_AVPHYS_PAGES" in os.sysconf_names:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return 4 << 30


def memory_limit() -> int:
    """Bytes that one file may take in memory: 80 % of the machine's, if it tells."""
    if not hasattr(os, "sysconf"):
        return sys.maxsize
    return int(_SHARE * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))


def _left_to_map() -> int:
    """Bytes of address space that the process may still map."""
    import resource  # not on Windows

    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if limit == resource.RLIM_INFINITY:
        return sys.maxsize
    return limit - 1024 * _table(Path("/proc/self/status")).get("VmSize", 0)


def _left_to_groups() -> Iterator[int]:
    """Bytes that each control group of the process may still take; the system takes back what
    holds files that were not used for long."""
    try:
        lines = Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, name = line.split(":", 2)
        if controllers == "":
            files, old = ("memory.max", "memory.current"), "inactive_file"
            top = _GROUPS
        elif "memory" in controllers.split(","):
            files, old = ("memory.limit_in_bytes", "memory.usage_in_bytes"), "total_inactive_file"
            top = _GROUPS / "memory"
        else:
            continue
        # inside of a container its own group is the top of what it sees
        own = top / name.lstrip("/")
        for group in [*(g for g in (own, *own.parents) if top in g.parents), top]:
            try:
                most, taken = (int((group / file).read_text(encoding="ascii")) for file in files)
            except (OSError, ValueError):  # no such group here, or no limit: "max"
                continue
            yield most - taken + _table(group / "memory.stat").get(old, 0)


def _table(path: Path) -> dict[str, int]:
    """Numbers by their names, of a file of the kernel; empty where there is none."""
    try:
        lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return {}
    words = [line.replace(":", " ").split() for line in lines]
    return {one[0]: int(one[1]) for one in words if len(one) > 1 and one[1].isdigit()}


@cache
def keep_freed_memory() -> None:
    """Let glibc keep blocks of some MB that are freed, in place of asking for each again.

    Work in parts frees and takes such blocks all the time, and new pages cost as much as what is
    done with them. Its threshold rises to the size of the largest block that was ever freed (32 MB
    at most; mallopt(3), M_MMAP_THRESHOLD): one that nobody writes to costs nothing.
    """
    # those who ask for processors alone needn't wait for it
    import numpy as np

    np.empty(31 << 20, dtype=np.uint8)
