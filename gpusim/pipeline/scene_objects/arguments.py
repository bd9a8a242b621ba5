"""Arguments of a function, or of a class, that a scene's table has under their names."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any


def arguments_of(function: Callable[..., Any], table: object) -> dict[str, Any]:
    """By name, in SI; what the table leaves open is for the function to say."""
    names = inspect.signature(function).parameters
    found = {name: getattr(table, name, None) for name in names}
    return {name: value for name, value in found.items() if value is not None}
