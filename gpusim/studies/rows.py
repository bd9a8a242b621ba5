"""Rows of samples: what became of each, appended by whoever makes it to a log of its own.

A sample is done if a row with its key lies in ``OUT/.gpusim/samples``. A row is plain data:
``key``, ``number``, ``status`` ("done", "refused", "failed" or "killed"), ``error``, ``seconds``,
``measurements`` ([name, unit, measured, truth, error] each) and ``made`` (results by stage).
A line ``{"begun": number}`` says that somebody has begun with a sample.
"""

from __future__ import annotations

import os
import secrets
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gpusim.files.output_folder import inside
from gpusim.graph.folder import INNER
from gpusim.graph.log import Log, read_log
from gpusim.studies.samples import Sample

Row = Mapping[str, Any]
FINAL = "done", "refused"
"""What another call doesn't try again."""


class RowLog:
    """Rows that this process adds to the study in ``out``; ``told`` is called after each."""

    def __init__(self, out: Path) -> None:
        self.told: Callable[[], None] = lambda: None
        name = f"{os.getpid()}-{secrets.token_hex(4)}.log"
        self._log = Log(inside(out, INNER, "samples", name))

    def begin(self, sample: Sample) -> None:
        """Say that a sample is begun with: whoever dies of it can't say so any more."""
        self._log.append({"begun": sample.number})

    def add(
        self,
        sample: Sample,
        status: str,
        error: str = "",
        seconds: float = 0.0,
        measurements: Sequence[Sequence[Any]] = (),
        made: Mapping[str, int] | None = None,
    ) -> None:
        """Say what has become of a sample."""
        self._log.append(
            {"key": sample.key, "number": sample.number, "status": status, "error": error,
             "seconds": seconds, "measurements": measurements, "made": made or {}}
        )  # fmt: skip
        self.told()

    def close(self) -> None:
        """Flush."""
        self._log.close()


class RowReader:
    """Reads what was appended to the logs of the study in ``out`` since it was last asked."""

    def __init__(self, out: Path) -> None:
        self._folder = inside(out, INNER, "samples")
        self._read_to: dict[Path, int] = {}

    def new(self) -> Iterator[Row]:
        """The lines that are new: rows, and what was begun."""
        for path in sorted(self._folder.glob("*.log")):
            lines, self._read_to[path] = read_log(path, self._read_to.get(path, 0))
            yield from lines


def read_rows(out: Path, samples: Sequence[Sample]) -> dict[int, Row]:
    """The row of each of the samples that has one, by number; of several the one that is final."""
    numbers = {sample.key: sample.number for sample in samples}
    found: dict[int, Row] = {}
    for line in RowReader(out).new():
        number = numbers.get(line.get("key", ""))
        if number is not None and found.get(number, {}).get("status") not in FINAL:
            found[number] = line
    return found
