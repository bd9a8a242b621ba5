"""Tables of samples as studies have them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gpusim.studies.table import SampleTable, column_name

Columns = Mapping[tuple[str, str], Any]


def table_of(
    parameters: Mapping[str, np.ndarray], errors: Columns, measured: Columns | None = None
) -> SampleTable:
    """With ``errors`` of what is 1, and what was ``measured`` and has no truth."""
    count = len(next(iter(parameters.values())))
    columns: dict[str, np.ndarray] = {"sample": np.arange(count), **parameters}
    columns |= {"status": np.full(count, "done"), "error": np.full(count, "")}
    columns["seconds"] = np.ones(count)
    for quantity, values in errors.items():
        columns[column_name(quantity, "measured")] = 1.0 + np.asarray(values)
        columns[column_name(quantity, "truth")] = np.ones(count)
        columns[column_name(quantity, "error")] = np.asarray(values)
    for quantity, values in (measured or {}).items():
        columns[column_name(quantity, "measured")] = np.asarray(values, dtype=float)
        for kind in ("truth", "error"):
            columns[column_name(quantity, kind)] = np.full(count, np.nan)
    return SampleTable(columns, [*parameters], [*errors, *(measured or {})])
