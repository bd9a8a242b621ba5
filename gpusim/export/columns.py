"""Columns of a table as CSV and Parquet."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

Column = npt.NDArray[Any]


def column_files(name: str, columns: Mapping[str, Column]) -> dict[str, bytes]:
    """The contents of <name>.csv and, where pyarrow is installed, of <name>.parquet.

    Examples
    --------
    >>> from gpusim.export.columns import column_files
    >>> column_files("table", {"f": np.array([25.0, np.nan])})["table.csv"]
    b'f\\n25.0\\n\\n'
    """
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(map(_cell, one.tolist()) for one in columns.values()), strict=True))
    files = {f"{name}.csv": stream.getvalue().encode()}
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return files
    plain = {
        key: one if one.dtype.kind != "O" else [json.dumps(value) for value in one]
        for key, one in columns.items()
    }
    file = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(plain), file)
    return files | {f"{name}.parquet": file.getvalue().to_pybytes()}


def column_of(values: Sequence[Any]) -> Column:
    """Numbers, texts or booleans as such; anything else, lists too, as objects.

    Examples
    --------
    >>> from gpusim.export.columns import column_of
    >>> column_of([1, 2.5]).dtype.kind, column_of([[1], [2, 3]]).shape
    ('f', (2,))
    """
    kinds = {type(one) for one in values}
    if kinds <= {int, float} or (len(kinds) == 1 and kinds <= {str, bool}):
        return np.array(values)
    column = np.empty(len(values), dtype=object)
    column[:] = values
    return column


def _cell(value: Any) -> Any:
    """In a CSV file: an empty cell for NaN, JSON for a list."""
    if isinstance(value, float) and value != value:
        return ""
    return json.dumps(value) if isinstance(value, list | dict) else value
