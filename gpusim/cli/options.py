"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from gpusim.errors import InputError

__all__ = ["Backend", "BackendOption", "Json", "Output", "Quiet", "check_folder"]


class Backend(StrEnum):
    """Where the numbers are made."""

    gpu = "gpu"
    numpy = "numpy"


BackendOption = Annotated[Backend, typer.Option(help="gpu: any Vulkan device; numpy: none.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Output = Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Output folder.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]


def check_folder(folder: Path | None) -> None:
    """Raise InputError if the output folder is something else."""
    if folder is not None and folder.exists() and not folder.is_dir():
        raise InputError(f"-o: not a folder; got {folder}; expected a folder, or a new name")
