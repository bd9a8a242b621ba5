"""How results and other objects with arrays show themselves at a prompt: by names and sizes."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from gpusim.printable import printable

_LONGEST = 160  # characters: two lines


def field_summary(self: Any) -> str:
    """A ``__repr__`` of dataclasses with arrays: fields that aren't at their default, and of arrays
    only dtype and shape. At most two lines.

    Examples
    --------
    >>> gs.measure.Triangulated(np.zeros((5, 3)), np.zeros((5, 3, 3)), np.zeros(5), np.zeros(5))
    Triangulated(points=float64 (5, 3), covariance=float64 (5, 3, 3), residual=float64 (5,), ...)
    """
    parts = [
        f"{field.name}={_value_summary(value)}"
        for field in sorted(dataclasses.fields(self), key=lambda one: one.kw_only is True)
        if not _is_default(value := getattr(self, field.name), field.default)
    ]
    text = f"{type(self).__name__}({', '.join(parts)})"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST].rpartition(', ')[0]}, ...)"


def _is_default(value: Any, default: Any) -> bool:
    if _is_array(value) or _is_array(default):
        return False
    return value is default or bool(type(value) is type(default) and value == default)


def _is_array(value: Any) -> bool:
    # NumPy isn't imported for this: the command line starts without
    return hasattr(value, "dtype") and hasattr(value, "shape")


def _value_summary(value: Any) -> str:
    if _is_array(value):
        return f"{value.dtype} {value.shape}"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping | list | tuple | frozenset):
        plain = all(isinstance(one, bool | int | float | str) for one in value)
        short = printable(repr(value)) if plain and not isinstance(value, Mapping) else ""
        if len(short) > 40 and all(isinstance(one, float) for one in value):
            short = f"({', '.join(f'{one:.4g}' for one in value)})"
        return short if 0 < len(short) <= 40 else f"<{len(value)}>"
    text = printable(repr(value))
    return text if len(text) <= 40 else f"{type(value).__name__}(...)"
