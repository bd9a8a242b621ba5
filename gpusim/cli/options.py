"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["Backend", "BackendOption", "Json", "Output", "Quiet", "folder_name"]


def folder_name(text: str) -> Path:
    """The folder of an option; an empty name isn't the working folder."""
    if not str(text):
        raise typer.BadParameter("no name of a folder; got ''")
    return Path(text)


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
Output = Annotated[
    Path,
    typer.Option("-o", "--output", metavar="OUT", help="Output folder.", parser=folder_name),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Print errors only.")]
