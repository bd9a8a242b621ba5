"""Options that several commands share."""

from __future__ import annotations

import os
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gpusim.errors import InputError

__all__ = ["Backend", "BackendOption", "Json", "Output", "Quiet", "check_folder"]


class Backend(StrEnum):
    """Where the numbers are made."""

    auto = "auto"
    gpu = "gpu"
    numpy = "numpy"


BackendOption = Annotated[
    Backend,
    typer.Option(help="auto: a Vulkan device, else NumPy; gpu: a device or an error; numpy: none."),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Output folder.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


def check_folder(folder: Path | None) -> None:
    """Refuse an output folder that is a file, lies in one, or can't be written to (InputError)."""
    if folder is None:
        return
    existing = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not existing.is_dir():
        raise InputError(f"-o: not a folder; got {existing}; expected a folder, or a new name")
    if not os.access(existing, os.W_OK | os.X_OK):
        raise InputError(f"-o: can't be written to; got {existing}; expected a folder of yours")
