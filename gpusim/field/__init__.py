"""Displacement fields that another program computed: read, interpolated in time, rendered.

In the order in which data passes:

- `field`: A mesh, growing times, and each node's displacement at them.
- `frd`: CalculiX result files.
- `read`: Reading fields, by the ending of their name.
"""

from gpusim.field.field import Field as Field
from gpusim.field.read import FIELD_SUFFIXES as FIELD_SUFFIXES
from gpusim.field.read import read_field as read_field
from gpusim.public_names import public_names as _public_names

__all__, __getattr__, __dir__ = _public_names(__name__)
