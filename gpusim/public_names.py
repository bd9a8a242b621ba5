"""The public names of a package: those that its ``__init__`` imports, at once or when asked for."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

Lookup = tuple[list[str], Callable[[str], Any], Callable[[], list[str]]]


def public_names(package: str, later: Mapping[str, str] | None = None) -> Lookup:
    """A package's ``__all__``, ``__getattr__`` and ``__dir__``, asked for at the end of it.

    Names without an underscore in front are public; modules of its own aren't, but those that are
    asked for. ``later``: names that take time to import, by the module that has them.
    """
    home_of = {name: home for home, names in (later or {}).items() for name in names.split()}
    here = {
        name for name, value in vars(sys.modules[package]).items()
        if not name.startswith("_")
        and not (isinstance(value, ModuleType) and value.__name__ == f"{package}.{name}")
    }  # fmt: skip
    public = sorted(here | home_of.keys())

    def attribute(name: str) -> Any:
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        if home_of[name] == package:
            return importlib.import_module(f"{package}.{name}")
        return getattr(importlib.import_module(home_of[name]), name)

    return public, attribute, lambda: public
