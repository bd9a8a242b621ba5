"""Displacement fields that another program computed: read, interpolated in time, rendered.

In the order in which data passes:

- `field`: A mesh, growing times, and each node's displacement at them.
- `frd`: CalculiX result files.
- `read`: Reading fields, by the ending of their name.
"""

from __future__ import annotations

from gpusim.field.field import Field
from gpusim.field.read import FIELD_SUFFIXES, read_field

__all__ = ["FIELD_SUFFIXES", "Field", "read_field"]


def __dir__() -> list[str]:
    return sorted(__all__)
