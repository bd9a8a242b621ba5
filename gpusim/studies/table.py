"""The table of samples: parameters, and every measurement beside the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gpusim.errors import InputError, nearest_name
from gpusim.export.columns import Column, column_files, column_of
from gpusim.files.atomic_files import write_bytes
from gpusim.files.output_folder import inside
from gpusim.studies.rows import Row
from gpusim.studies.samples import Sample
from gpusim.studies.study_tables import Study

_KINDS = "measured", "truth", "error"


class SampleTable:
    """What became of the samples of a study; ``table["column"]`` is a column (N,) over samples.

    Columns: "sample", "repeat", each parameter by its label, "status", "error", "seconds", and of
    each measurement "<name> measured [unit]", "<name> truth [unit]" and "<name> error [unit]"
    (NaN where there is none). ``parameters``: their labels; ``quantities``: (name, unit) of what
    was measured.

    Examples
    --------
    >>> import numpy as np
    >>> from gpusim.studies.table import SampleTable
    >>> table = SampleTable({"sample": np.arange(2), "f": np.array([25.0, 35.0])}, ("f",), ())
    >>> len(table), table["f"].max()
    (2, 35.0)
    """

    def __init__(
        self,
        columns: Mapping[str, Column],
        parameters: Sequence[str],
        quantities: Sequence[tuple[str, str]],
    ) -> None:
        self.columns = dict(columns)
        self.parameters, self.quantities = tuple(parameters), tuple(quantities)

    def __len__(self) -> int:
        return len(self.columns["sample"])

    def __getitem__(self, name: str) -> Column:
        """A column. Raises InputError for one that there isn't."""
        if name not in self.columns:
            near = nearest_name(name, self.columns)
            raise InputError(f"table of samples: no column {name!r}; expected another{near}")
        return self.columns[name]

    def __repr__(self) -> str:
        return f"SampleTable of {len(self)} samples, {len(self.columns)} columns"

    def of(self, quantity: tuple[str, str], kind: str = "error") -> Column:
        """The "measured", "truth" or "error" column of one of the `quantities`."""
        return self[column_name(quantity, kind)]

    @staticmethod
    def from_rows(study: Study, samples: Sequence[Sample], rows: Mapping[int, Row]) -> SampleTable:
        """Of the rows by the number of their sample; samples without one have status ""."""
        parameters = [*(samples[0].values if samples else ())]
        columns: dict[str, Column] = {
            "sample": np.array([one.number for one in samples]),
            "repeat": np.array([one.repeat for one in samples]),
            **{name: column_of([one.values[name] for one in samples]) for name in parameters},
        }
        for name, missing in (("status", ""), ("error", ""), ("seconds", np.nan)):
            values = [rows.get(one.number, {}).get(name, missing) for one in samples]
            columns[name] = np.array(values)
        quantities: dict[tuple[str, str], None] = {}
        for place, sample in enumerate(samples):
            for name, unit, *numbers in rows.get(sample.number, {}).get("measurements", ()):
                quantities[name, unit] = None
                for kind, number in zip(_KINDS, numbers, strict=True):
                    key = column_name((name, unit), kind)
                    if key not in columns:
                        columns[key] = np.full(len(samples), np.nan)
                    columns[key][place] = number
        return SampleTable(columns, parameters, tuple(quantities))

    def write(self, out: Path) -> list[Path]:
        """Write samples.csv and, where pyarrow is installed (``gpusim[study]``), samples.parquet
        into ``out``; returns their paths."""
        files = column_files("samples", self.columns)
        return [write_bytes(inside(out, name), data) for name, data in files.items()]


def column_name(quantity: tuple[str, str], kind: str) -> str:
    """What the column of a measured quantity is called."""
    name, unit = quantity
    return f"{name} {kind} [{unit}]" if unit else f"{name} {kind}"
