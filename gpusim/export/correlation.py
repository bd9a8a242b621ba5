"""Measured displacements and strains as CSV, NPZ and HDF5.

Every table has one row per point. What couldn't be measured is an empty field (CSV) or NaN, with
the reason in ``status``. Columns of CSV carry their unit (``U_mm``), datasets of HDF5 have it as an
attribute ``unit``, and NPZ as ``unit_U``; what has none in its name is a pure number.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.export.field_catalogue import PICTURE, SPACE, STRAIN, catalogue_of
from gpusim.files.atomic_files import PathLike, atomic_path, atomic_stream, write_text
from gpusim.files.hdf5_file import writing_hdf5
from gpusim.measure import DicResult, Status, StereoResult, StrainResult
from gpusim.printable import printable

FORMATS = ("csv", "npz", "h5")
UNITS = {name: one.unit for fields in (PICTURE, SPACE, STRAIN) for name, one in fields.items()}
UNITS |= {"time": "s"}
PICTURE_FRAME = "pixels of the reference image, x right, y down"
RIG_FRAME = "x, y: pixels of the left picture; X, Y, Z: left camera, x right, y down, z forward"


def result_columns(
    result: DicResult | StereoResult, strain: StrainResult | None = None
) -> dict[str, npt.NDArray[Any]]:
    """The columns of a table, (M,) each: position, displacement, quality, strain; ``status``."""
    columns = {
        name: one.values(table)
        for table in (result, strain)
        if table is not None
        for name, one in catalogue_of(table).fields.items()
        if name != "magnitude"
    }
    return columns | {"status": result.status}


def write_correlation(
    path: PathLike,
    result: DicResult | StereoResult,
    strain: StrainResult | None = None,
    attributes: Mapping[str, str | float | int] | None = None,
) -> Path:
    """Write a result in the format that the suffix names: ``.csv``, ``.npz`` or ``.h5``.

    Lengths in space are in mm. In CSV ``status`` is a word, in the others a number; their names
    come with the file. Attributes (settings, versions) go into comment lines or the file's own
    attributes.
    """
    notes: dict[str, str | float | int] = {"subset_px": result.subset}
    if strain is not None:
        notes |= {"strain": strain.kind, "strain_gauge_px": strain.gauge_px}
    notes |= dict(attributes or {})
    return write_columns(path, result_columns(result, strain), notes, frame_of(result))


def frame_of(result: DicResult | StereoResult) -> str:
    """What the lengths of a result's columns count from."""
    return RIG_FRAME if isinstance(result, StereoResult) else PICTURE_FRAME


def write_columns(
    path: PathLike,
    columns: Mapping[str, npt.NDArray[Any]],
    notes: Mapping[str, str | float | int],
    frame: str,
) -> Path:
    """Write columns by their names, as `write_correlation` does; ``frame``: of lengths."""
    # names of files among them
    notes = {k: printable(v) if isinstance(v, str) else v for k, v in notes.items()}
    target = Path(path)
    suffix = target.suffix.lower().lstrip(".")
    if suffix == "csv":
        return _write_csv(target, columns, notes)
    names = np.array([status.name for status in Status])
    if suffix == "npz":
        arrays: dict[str, Any] = {**columns, "status_names": names}
        arrays |= {f"unit_{name}": np.array(unit_of(name)) for name in columns}
        arrays |= {f"note_{key}": np.array(value) for key, value in notes.items()}
        with atomic_stream(target) as stream:
            np.savez_compressed(stream, **arrays)
        return target
    if suffix == "h5":
        with atomic_path(target) as part, writing_hdf5(part) as file:
            for name, values in columns.items():
                data = file.create_dataset(name, data=values, compression="gzip")
                data.attrs["unit"] = unit_of(name)
            file.attrs["status_names"] = [str(name) for name in names]
            file.attrs["frame"] = frame
            file.attrs.update(notes)
        return target
    raise InputError(f"{target}: unknown format; expected a name ending in one of {FORMATS}")


def unit_of(column: str) -> str:
    """The unit of a column: px, mm or 1."""
    return UNITS.get(column, "1")


def csv_names(columns: Iterable[str]) -> list[str]:
    """Names of columns as CSV has them, with their unit."""
    return [name if unit_of(name) == "1" else f"{name}_{unit_of(name)}" for name in columns]


def _write_csv(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], notes: Mapping[str, str | float | int]
) -> Path:
    """Comment lines, names, rows."""
    texts: list[list[str]] = []
    for name, values in columns.items():
        if name == "status":
            words = {int(status): status.name for status in Status}
            texts.append([words[int(value)] for value in values])
        elif values.dtype.kind == "f":
            texts.append(["" if value != value else f"{value:.9g}" for value in values.tolist()])
        else:
            texts.append([str(value) for value in values.tolist()])
    lines = [f"# {key} = {value}" for key, value in notes.items()]
    lines.append(",".join(csv_names(columns)))
    lines.extend(",".join(row) for row in zip(*texts, strict=True))
    return write_text(path, "\n".join(lines) + "\n")
