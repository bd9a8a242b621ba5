"""How fast this machine is, as its last runs have shown.

Work that was done before takes what it took then; other work takes what the reference machine
(`gpusim.scene.cost`) takes, times a ratio for its kind, which the last run of that kind has shown.

Kept in the user's cache folder, one entry per machine and backend. It is never needed: a file that
is missing, damaged or can't be written costs exactness of what ``gpusim plan`` estimates, no more.
``GPUSIM_NO_CACHE=1`` switches it off. Of two runs that end at once, one may be forgotten.
"""

from __future__ import annotations

import hashlib
import math
import platform
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, Field

from gpusim._version import __version__
from gpusim.files.atomic_files import write_text
from gpusim.files.cache_files import cache_folder, open_cached
from gpusim.parallel.machine import all_processors

_MOST_KNOWN = 500
_MOST_BYTES = 10_000_000
_LIMITS = 0.02, 50.0  # of a ratio: what is beyond is another fault than speed


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


class Speed(BaseModel):
    """What is known of a machine.

    ``ratios``: kind of work -> seconds over those of the reference machine; ``known``: signature ->
    seconds of what has been done; ``adapter``: the device that it was done on.
    """

    machine: str = ""
    adapter: str = ""
    ratios: dict[str, Annotated[float, Field(ge=_LIMITS[0], le=_LIMITS[1])]] = {}
    known: dict[str, Annotated[float, Field(ge=1e-9, le=1e9)]] = {}

    @staticmethod
    def read(backend: str) -> Speed:
        """What the cache holds of this machine: nothing, if it is the first time.

        ``"auto"`` is the device, unless all that this machine has learned was by NumPy.
        """
        if backend == "auto":
            device, numpy = Speed.read("gpu"), Speed.read("numpy")
            return numpy if numpy.known and not device.known else device
        machine = f"{platform.node()}, {all_processors()} processors, {backend}"
        return _read(_path()).get(machine, Speed(machine=machine))

    def seconds(self, work: Workload) -> float:
        """What this work takes here: what it took, or the reference cost times the ratio."""
        plain = work.seconds - work.compiling
        guess = work.compiling + plain * self.ratios.get(work.kind, 1.0)
        return self.known.get(work.signature, guess)

    def learn(self, done: Mapping[Workload, float], adapter: str) -> None:
        """Take in the seconds that works took."""
        if adapter and self.adapter and adapter != self.adapter:
            self.ratios, self.known = {}, {}
        self.adapter = adapter or self.adapter
        for work, seconds in done.items():
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
        if path is not None:
            kept = _SpeedFile(version=3, machines=_read(path) | {self.machine: self})
            with suppress(OSError, ValueError):
                write_text(path, kept.model_dump_json(indent=1))


class _SpeedFile(BaseModel):
    version: Literal[3]
    machines: dict[str, Speed]


def _path() -> Path | None:
    folder = cache_folder()
    return None if folder is None else folder / "speed.json"


def _read(path: Path | None) -> dict[str, Speed]:
    """Machines by name; none of a file that isn't there, or isn't one of these."""
    with suppress(OSError, ValueError):
        if path is not None:
            with open_cached(path, _MOST_BYTES) as stream:
                return _SpeedFile.model_validate_json(stream.read()).machines
    return {}
