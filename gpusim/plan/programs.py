"""What the pictures in an output folder have asked the device for, so that the next run has it
ready."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from gpusim.errors import InputError
from gpusim.files.input_file import read_input
from gpusim.files.output_folder import inside
from gpusim.graph.folder import INNER

_NAME = "programs.json"
_SOLVER = "fem/"


def earlier_programs(out: Path) -> list[Any]:
    """What the last run into ``out`` asked for; [] for none, or if that can't be told."""
    with suppress(OSError, ValueError, RecursionError, InputError):
        programs = json.loads(read_input(inside(out, INNER, _NAME)).text())
        return programs if isinstance(programs, list) else []
    return []


def keep_programs(out: Path, asked: Iterable[Any]) -> None:
    """Keep what this run has asked for and those before it: what shows a solution, which is needed
    more often than what finds it."""
    from gpusim.files.atomic_files import write_text  # a plan reads only and stays quick

    shown = [one for one in asked if not str(one[0]).startswith(_SOLVER)]
    programs = [*earlier_programs(out), *json.loads(json.dumps(shown, default=float))]
    # threads ask in any order, which is no part of the result
    texts = sorted({json.dumps(one) for one in programs})
    write_text(inside(out, INNER, _NAME), f"[{', '.join(texts)}]")
