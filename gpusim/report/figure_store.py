"""Figures that a folder has from an earlier report: what shows the same isn't drawn again.

A figure's key is the hash of all that it is drawn from: the function, its arguments, and what the
files hold that these name.
"""

from __future__ import annotations

import hashlib
import io
import json
import pickle
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gpusim._version import __version__
from gpusim.errors import InputError
from gpusim.files.atomic_files import write_text
from gpusim.files.input_file import read_input
from gpusim.report.model import Drawing, Figure

KEYS = ".figures.json"
"""File of the folder."""


class FigureStore:
    """Figures of a ``folder``, by their keys."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._earlier: dict[str, Any] = {}
        self._figures: dict[str, Figure] = {}
        with suppress(InputError, ValueError, RecursionError):
            known = json.loads(read_input(folder / KEYS, "a list of figures").data)
            self._earlier = known if isinstance(known, dict) else {}

    def figure(self, drawing: Drawing) -> Figure:
        """The figure; drawn, unless an earlier report has it."""
        key = self._key(drawing)
        if key not in self._figures:
            self._figures[key] = self._found(key) or drawing()
        return self._figures[key]

    def keep(self) -> None:
        """Note what there is, when all are drawn."""
        kept = {}
        for key, figure in self._figures.items():
            said = asdict(figure)
            path = said.pop("path")
            if path.parent == self._folder and path.is_file():
                kept[key] = said | {"file": path.name, "sha256": _hash(path.read_bytes())}
        if kept:
            write_text(self._folder / KEYS, json.dumps(kept))

    def _found(self, key: str) -> Figure | None:
        """A figure of an earlier report, if nobody has changed its file."""
        with suppress(KeyError, TypeError, InputError):
            said = dict(self._earlier[key])
            path = self._folder / Path(said.pop("file")).name
            if said.pop("sha256") == _hash(read_input(path, "a figure").data):
                return Figure(path, **said)
        return None

    def _key(self, drawing: Drawing) -> str:
        text = io.BytesIO()
        _Content(self._folder, text).dump((__version__, drawing))
        return _hash(text.getvalue())


class _Content(pickle.Pickler):
    """Has what files hold in place of their paths, and of those in ``folder`` their names: they are
    what is drawn."""

    def __init__(self, folder: Path, file: io.BytesIO) -> None:
        super().__init__(file)
        self._folder = folder

    def persistent_id(self, thing: Any) -> Any:
        if not isinstance(thing, Path):
            return None
        inside = thing.parent == self._folder
        return thing.name, "" if inside or not thing.is_file() else _hash(thing.read_bytes())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
