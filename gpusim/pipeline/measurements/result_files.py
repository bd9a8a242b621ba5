"""Results of measurements as they are kept in the output folder: JSON with everything, and tables.

What the results of every kind that follows markers share is here, too.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt

from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.input_file import Reader, read_input
from gpusim.files.output_folder import inside
from gpusim.report.text import plain_data

__all__ = ["MarkerResult", "csv_text", "unrefined_text", "write_result"]


def csv_text(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table; texts stay, and numbers that aren't finite are empty cells."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow(
            [v if isinstance(v, str) else f"{v:.7g}" if np.isfinite(v) else "" for v in row]
        )
    return stream.getvalue()


def write_result(folder: Path, name: str, tables: Mapping[str, str], content: Any) -> list[Path]:
    """``<name><ending>.csv`` of each table for people, ``<name>.json`` with the ``content``."""
    stem = safe_name(name)
    text = json.dumps(plain_data(content), indent=1, allow_nan=False) + "\n"
    files = [
        write_text(inside(folder, f"{stem}{ending}.csv"), table) for ending, table in tables.items()
    ]
    return [*files, write_text(inside(folder, f"{stem}.json"), text)]


def unrefined_text(name: str, markers: Sequence[str]) -> list[str]:
    """The warning, if any, for markers that correlation alone has measured."""
    if not markers:
        return []
    return [
        f"measure {name!r}: by correlation alone, without a fit of the cross: "
        f"{', '.join(markers)}; a sharp marker may be off by 0.02 px then (others: 0.003)"
    ]


class MarkerResult:
    """Base of the dataclasses of what became of M markers between a first and a last image.

    ``marker`` and ``group`` names, ``status`` names (M,); ``saturated``: markers with clipped
    pixels; ``unrefined``: markers measured by correlation alone, because their cross couldn't be
    fitted.
    """

    name: str
    marker: tuple[str, ...]
    group: tuple[str, ...]
    status: tuple[str, ...]
    saturated: tuple[str, ...]
    unrefined: tuple[str, ...]
    empty: ClassVar[Mapping[str, tuple[int, ...]]] = {}
    """Shapes of arrays of no rows, which JSON doesn't tell; others are (0,)."""

    def tables(self) -> dict[str, str]:
        """CSV texts by the ending of the file's name."""
        raise NotImplementedError

    def shapes(self) -> dict[str, tuple[int, ...]]:
        """What shapes arrays have to have."""
        raise NotImplementedError

    def misfits(self) -> list[str]:
        """What else doesn't belong together, by name."""
        return []

    @property
    def measured_count(self) -> str:
        """Such as "7 of 8 markers"."""
        return f"{sum(status == 'OK' for status in self.status)} of {len(self.status)} markers"

    def marker_warnings(self) -> list[str]:
        """Markers that were not measured, whose white is clipped, and that are less exact."""
        what = f"measure {self.name!r}"
        pairs = zip(self.marker, self.status, strict=True)
        lost = [f"{marker} ({status})" for marker, status in pairs if status != "OK"]
        found = [f"{what}: not measured: {', '.join(lost)}"] if lost else []
        if self.saturated:
            found.append(
                f"{what}: saturated pixels on {', '.join(self.saturated)}; a clipped edge moves "
                "its marker: lower [sensor] exposure"
            )
        return found + unrefined_text(self.name, self.unrefined)

    def write(self, folder: Path) -> list[Path]:
        """Tables for people, JSON with everything."""
        return write_result(folder, self.name, self.tables(), vars(self))

    @classmethod
    def read(cls, folder: Path, name: str, read: Reader = read_input) -> Self:
        """What an earlier run wrote; ``read``: how. Raises InputError, ValueError for damage."""
        values = json.loads(read(str(inside(folder, f"{safe_name(name)}.json"))).data)
        items: Sequence[Field[Any]] = fields(cls)  # type: ignore[arg-type]
        result = cls(**{item.name: cls.field_of(item, values[item.name]) for item in items})
        count = len(result.marker)
        wrong = [
            key for key, shape in result.shapes().items() if getattr(result, key).shape != shape
        ]
        wrong += [key for key in ("group", "status") if len(getattr(result, key)) != count]
        wrong += result.misfits()
        if wrong or not count:
            raise ValueError(f"of another shape than its {count} markers: {', '.join(wrong)}")
        return result

    @classmethod
    def field_of(cls, item: Field[Any], value: Any) -> Any:
        """The value of a field from what JSON made of it."""
        if item.type == "Array":
            array: npt.NDArray[np.float64] = np.array(value, dtype=np.float64)
            return array if array.size else np.zeros(cls.empty.get(item.name, (0,)))
        if isinstance(value, list):
            return tuple(value)
        return float("nan") if value is None else value
