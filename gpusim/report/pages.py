"""Templates of the reports' pages: read and compiled once in a process."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from gpusim.printable import printable
from gpusim.report.pictures import file_uri, photo_uri
from gpusim.report.text import aligned, duration, number, percent, signed_percent

if TYPE_CHECKING:
    from jinja2 import Environment, Template

__all__ = ["page_template"]


@cache
def page_template(name: str) -> Template:
    """The template ``name`` of the folder ``page``; what it is given goes to its ``render``."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # at the end of a run

    environment = Environment(
        loader=PackageLoader("gpusim.report", "page"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_shown,
    )
    environment.filters["number"] = number
    environment.filters["percent"] = percent
    environment.filters["signed_percent"] = signed_percent
    environment.filters["aligned"] = aligned
    environment.filters["duration"] = duration
    environment.filters["uri"] = file_uri
    environment.filters["photo_uri"] = photo_uri
    environment.filters["link"] = _link
    return environment


def _shown(value: object) -> object:
    """What a template's expression becomes: texts that other people wrote made printable."""
    if value is None:
        return ""
    if isinstance(value, str) and not hasattr(value, "__html__"):
        return printable(value, keep="\n\t")
    return value


def _link(path: Path, folder: Path) -> str:
    """Return a URL of ``path`` relative to ``folder``."""
    relative = os.path.relpath(Path(path).resolve(), Path(folder).resolve())
    return quote(Path(relative).as_posix())
