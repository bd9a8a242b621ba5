"""How fast this machine is: measured once in a moment, then learned from each run.

Kept in the user's cache folder, one entry per machine and backend. It is never needed: a file that
is missing, damaged or can't be written costs exactness of what ``gpusim plan`` estimates, no more.
``GPUSIM_NO_CACHE=1`` switches it off. Of two runs that end at once, one may be forgotten.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import sys
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gpusim._version import __version__
from gpusim.files.cache_files import cache_folder, open_cached
from gpusim.parallel.machine import all_processors

_VERSION = 1
_MOST_KNOWN = 500
_MOST_BYTES = 10_000_000
_LIMITS = 0.02, 50.0  # of a ratio: what is beyond is another fault than speed
_FASTER, _SLOWER = 0.7, 0.4  # weights of a new run: one that is slow may have had neighbours
_QUIET = 0.6  # share of the machine from which on a first run is believed
HOST_SECONDS = 0.036
"""`host_seconds` of the machine that the costs of `gpusim.scene.cost` were measured on."""


@dataclass(frozen=True)
class Workload:
    """All stages of one ``kind`` in a plan or a run.

    ``what`` says exactly how much it is; ``seconds`` by the reference costs, of which ``compiling``
    for shaders; ``compiled``: which.
    """

    kind: str
    what: str
    seconds: float
    compiling: float = 0.0
    compiled: tuple[str, ...] = ()

    @property
    def signature(self) -> str:
        """A short name of this much work."""
        text = f"{__version__}|{self.kind}|{self.what}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass
class Speed:
    """What is known of a machine.

    ``ratios``: kind of work -> seconds over those of the reference machine, "compile" for shaders;
    ``busy``: how much longer everything takes just now, because others work here too.
    ``known``: signature -> seconds of what has been done; ``compiled``: shaders that the driver has
    seen, by this version. ``host``: a ratio for what nothing is known of, None if nobody has
    measured it.
    """

    machine: str = ""
    adapter: str = ""
    host: float | None = None
    busy: float = 1.0
    ratios: dict[str, float] = field(default_factory=dict)
    known: dict[str, float] = field(default_factory=dict)
    compiled: set[str] = field(default_factory=set)

    @staticmethod
    def read(backend: str) -> Speed:
        """What the cache holds of this machine: nothing, if it is the first time.

        ``"auto"`` is the device, unless all that this machine has learned was by NumPy.
        """
        if backend != "auto":
            return Speed._read(backend)
        device, numpy = Speed._read("gpu"), Speed._read("numpy")
        return numpy if numpy.ratios and not device.ratios else device

    @staticmethod
    def _read(backend: str) -> Speed:
        machine = f"{platform.node()}, {all_processors()} processors, {backend}"
        try:
            entry = _content(_path())[machine]
            ratios = {str(k): _number(v, *_LIMITS) for k, v in entry["ratios"].items()}
            known = {str(k): _number(v, 1e-9, 1e9) for k, v in entry["known"].items()}
            compiled = set(map(str, entry["compiled"])) if entry["gpusim"] == __version__ else set()
            host = None if entry["host"] is None else _number(entry["host"], *_LIMITS)
            return Speed(
                machine, str(entry["adapter"]), host, ratios=ratios, known=known, compiled=compiled
            )
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return Speed(machine)

    def measured(self) -> Speed:
        """This, after a tenth of a second of measuring if that is still to be done (it is kept),
        and a look at who else works here now."""
        if self.host is None:
            self.host = min(max(host_seconds() / HOST_SECONDS, _LIMITS[0]), _LIMITS[1])
            self.save()
        self.busy = 1.0 + _others() / all_processors()
        return self

    def seconds(self, work: Workload) -> float:
        """What this work takes here: what it took, or the reference cost times the ratios."""
        if work.signature in self.known:
            return self.busy * self.known[work.signature]
        plain = (work.seconds - work.compiling) * self._ratio(work.kind)
        return self.busy * (plain + work.compiling * self._ratio("compile"))

    def _ratio(self, kind: str) -> float:
        return self.ratios.get(kind, 1.0 if self.host is None else self.host)

    def has_compiled(self, shaders: Iterable[str]) -> bool:
        """Whether the driver has compiled these before, as far as is known, and not lost them."""
        return set(shaders) <= self.compiled and _driver_keeps()

    def learn(self, done: Mapping[Workload, float], adapter: str) -> None:
        """Take in the seconds that works took, less what others working here have cost."""
        if adapter and self.adapter and adapter != self.adapter:
            self.ratios, self.known, self.compiled = {}, {}, set()
        self.adapter = adapter or self.adapter
        alone = _share_had()
        quiet = alone >= _QUIET
        for work, wall in done.items():
            seconds = alone * wall
            if not (math.isfinite(seconds) and seconds > 1e-9 and work.seconds > 0.0):
                continue
            before = self.known.pop(work.signature, None)  # the latest are last
            if before is not None or quiet:
                self.known[work.signature] = seconds if before is None else _blend(before, seconds)
            self.compiled |= set(work.compiled)
            # a work teaches what most of it was
            plain = work.seconds - work.compiling
            parts = {work.kind: plain, "compile": work.compiling}
            kind = max(parts, key=lambda part: parts[part])
            (other,) = set(parts) - {kind}
            rest = seconds - parts[other] * self._ratio(other)
            ratio = max(rest, 0.1 * seconds) / parts[kind]
            first = quiet and kind not in self.ratios
            ratio = ratio if first else _blend(self._ratio(kind), ratio)
            self.ratios[kind] = min(max(ratio, _LIMITS[0]), _LIMITS[1])
        for signature in list(self.known)[: max(0, len(self.known) - _MOST_KNOWN)]:
            del self.known[signature]

    def save(self) -> None:
        """Keep it, if that can be done."""
        path = _path()
        if path is None:
            return
        try:
            from gpusim.files.atomic_files import (
                write_text,  # the planner reads only and stays quick
            )

            try:
                machines = _content(path)
            except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
                machines = {}
            machines[self.machine] = {
                "gpusim": __version__,
                "adapter": self.adapter,
                "host": self.host,
                "ratios": self.ratios,
                "known": {key: float(f"{value:.4g}") for key, value in self.known.items()},
                "compiled": sorted(self.compiled),
            }
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, json.dumps({"version": _VERSION, "machines": machines}, indent=1))
        except (OSError, ValueError):
            return


def _blend(old: float, new: float) -> float:
    weight = _FASTER if new < old else _SLOWER
    return math.exp((1.0 - weight) * math.log(old) + weight * math.log(new))


def _share_had() -> float:
    """Of the processors' time in the last minute, what a run had that uses them all."""
    try:
        return all_processors() / max(all_processors(), os.getloadavg()[0])
    except (OSError, AttributeError):  # no such number on this system
        return 1.0


def _others() -> float:
    """How many others want a processor now: a mean over a tenth of a second, 0 if unknown."""
    found = []
    for _ in range(10):
        try:
            running = Path("/proc/loadavg").read_text(encoding="ascii").split()[3]
            found.append(max(int(running.split("/")[0]) - 1, 0))
        except (OSError, ValueError, IndexError):
            return 0.0
        time.sleep(0.01)
    return sum(found) / len(found)


def host_seconds() -> float:
    """Processor time (s) of a fixed piece of work like what stages do: Python, and NumPy on one
    core: the median of five, as machines are quicker by starts. A sixth of a second."""
    import numpy as np

    found = []
    for _ in range(5):
        start = time.process_time()
        values = np.linspace(0.1, 1.0, 200_000)
        for _ in range(12):
            values = np.sqrt(values * values + 0.5) - 0.25
        np.sort(values[::-1])
        names = {str(k): k % 7 for k in range(40_000)}
        sum(names[str(k)] for k in range(40_000))
        found.append(time.process_time() - start)
    return float(np.median(found))


def _path() -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / "speed.json"


def _content(path: Path | None) -> dict[str, Any]:
    """Machines by name. Raises OSError, ValueError, KeyError or TypeError for no such file."""
    if path is None:
        raise FileNotFoundError
    with open_cached(path, _MOST_BYTES) as stream:
        content = json.loads(stream.read().decode())
    if content["version"] != _VERSION:
        raise ValueError
    machines = content["machines"]
    if not isinstance(machines, dict):
        raise TypeError
    return machines


def _number(value: Any, low: float, high: float) -> float:
    number = float(value)
    if not low <= number <= high:
        raise ValueError
    return number


def _driver_keeps() -> bool:
    """Whether a driver's cache of compiled shaders may be there; Mesa's is known."""
    if os.environ.get("MESA_SHADER_CACHE_DISABLE", "").lower() in ("1", "true", "yes"):
        return False
    try:
        base = os.environ.get("MESA_SHADER_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
        folder = Path(base) if base else Path.home() / ".cache"
        nvidia = (Path.home() / ".nv").is_dir() or (folder / "nvidia").is_dir()
    except RuntimeError:
        return False
    mesa = any(any(found.iterdir()) for found in folder.glob("mesa_shader_cache*"))
    return mesa or nvidia or sys.platform in ("win32", "darwin")
