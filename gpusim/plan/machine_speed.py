"""How fast this machine is, as its last runs have shown.

Work that was done before takes what it took then; other work takes what the reference machine
(`gpusim.scene.cost`) takes, times a ratio for its kind, which the last run of that kind has shown.

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
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gpusim._version import __version__
from gpusim.files.atomic_files import write_text
from gpusim.files.cache_files import cache_folder, open_cached
from gpusim.parallel.machine import all_processors

_VERSION = 2
_MOST_KNOWN = 500
_MOST_BYTES = 10_000_000
_LIMITS = 0.02, 50.0  # of a ratio: what is beyond is another fault than speed
_DAMAGED = OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError


@dataclass(frozen=True)
class Workload:
    """All stages of one ``kind`` in a plan or a run.

    ``what`` says exactly how much it is; ``seconds`` by the reference costs, of which ``compiling``
    for shaders.
    """

    kind: str
    what: str
    seconds: float
    compiling: float = 0.0

    @property
    def signature(self) -> str:
        """A short name of this much work."""
        text = f"{__version__}|{self.kind}|{self.what}"
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass
class Speed:
    """What is known of a machine.

    ``ratios``: kind of work -> seconds over those of the reference machine; ``known``: signature ->
    seconds of what has been done; ``adapter``: the device that it was done on; ``busy``: how much
    longer everything takes just now, because others work here too.
    """

    machine: str = ""
    adapter: str = ""
    busy: float = 1.0
    ratios: dict[str, float] = field(default_factory=dict)
    known: dict[str, float] = field(default_factory=dict)

    @staticmethod
    def read(backend: str) -> Speed:
        """What the cache holds of this machine: nothing, if it is the first time.

        ``"auto"`` is the device, unless all that this machine has learned was by NumPy.
        """
        if backend != "auto":
            return Speed._read(backend)
        device, numpy = Speed._read("gpu"), Speed._read("numpy")
        return numpy if numpy.known and not device.known else device

    @staticmethod
    def _read(backend: str) -> Speed:
        machine = f"{platform.node()}, {all_processors()} processors, {backend}"
        try:
            entry = _content(_path())[machine]
            ratios = {str(k): _number(v, *_LIMITS) for k, v in entry["ratios"].items()}
            known = {str(k): _number(v, 1e-9, 1e9) for k, v in entry["known"].items()}
            return Speed(machine, str(entry["adapter"]), ratios=ratios, known=known)
        except _DAMAGED:
            return Speed(machine)

    def measured(self) -> Speed:
        """This, after a look at who else works here now."""
        self.busy = 1.0 + _others() / all_processors()
        return self

    def seconds(self, work: Workload) -> float:
        """What this work takes here: what it took, or the reference cost times the ratio."""
        known = self.known.get(work.signature)
        if known is None:
            plain = work.seconds - work.compiling
            known = work.compiling + plain * self.ratios.get(work.kind, 1.0)
        return self.busy * known

    def learn(self, done: Mapping[Workload, float], adapter: str) -> None:
        """Take in the seconds that works took, less what others working here have cost."""
        if adapter and self.adapter and adapter != self.adapter:
            self.ratios, self.known = {}, {}
        self.adapter = adapter or self.adapter
        alone = _share_had()
        for work, wall in done.items():
            seconds = alone * wall
            if not (math.isfinite(seconds) and seconds > 1e-9):
                continue
            self.known.pop(work.signature, None)  # the latest are last
            self.known[work.signature] = seconds
            plain = work.seconds - work.compiling
            if plain > work.compiling:  # else it says little of what isn't compiled
                ratio = max(seconds - work.compiling, 0.1 * seconds) / plain
                self.ratios[work.kind] = min(max(ratio, _LIMITS[0]), _LIMITS[1])
        for signature in list(self.known)[: max(0, len(self.known) - _MOST_KNOWN)]:
            del self.known[signature]

    def save(self) -> None:
        """Keep it, if that can be done."""
        path = _path()
        if path is None:
            return
        try:
            machines = _content(path)
        except _DAMAGED:
            machines = {}
        machines[self.machine] = {
            "adapter": self.adapter,
            "ratios": self.ratios,
            "known": {key: float(f"{value:.4g}") for key, value in self.known.items()},
        }
        with suppress(OSError, ValueError):
            write_text(path, json.dumps({"version": _VERSION, "machines": machines}, indent=1))


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
