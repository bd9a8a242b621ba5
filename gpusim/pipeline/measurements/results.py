"""Results of measurements: a table over frames and points, kept in the output folder and told in
the report.

``<name>.csv`` is for people and other programs, ``<name>.npz`` for the next run: it holds every
number as it was measured, however many frames there are, and is read without another library.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from math import isfinite
from pathlib import Path
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.files.atomic_files import safe_name, write_text
from gpusim.files.input_file import InputFile, Reader, read_input
from gpusim.files.output_folder import inside
from gpusim.graph.stage import Output
from gpusim.report import Drawing, Link, Measurement, Overlay, Series, Table
from gpusim.scene import Scene

MM = 1e3
"""Of a metre: tables tell lengths in mm."""
Columns = Mapping[str, npt.NDArray[Any]]
Crop = tuple[str, float, float, float, float]


@dataclass(frozen=True, eq=False)
class PointTable:
    """Columns (F, P) over F frames and P points.

    ``frames``: the numbers of the frames that were measured, as the run has them. ``points``: their
    names, of things called ``what`` ("marker"). ``columns``: floats with the unit at the end of the
    name (``measured_x_mm``) and NaN where nothing was measured, words, or booleans.
    """

    what: str
    frames: tuple[int, ...]
    points: tuple[str, ...]
    columns: Columns

    def __post_init__(self) -> None:
        shape = len(self.frames), len(self.points)
        wrong = [name for name, one in self.columns.items() if one.shape != shape]
        if wrong or not all(shape):
            expected = f"columns of {shape[0]} frames and {shape[1]} {self.what}s"
            found = ", ".join(wrong) or "empty"
            raise InputError(f"table of measurements: {found}; expected {expected}")

    @staticmethod
    def of(what: str, points: Sequence[str], frames: Mapping[int, Columns]) -> PointTable:
        """From the columns (P,) of each of the ``frames``."""
        names = next(iter(frames.values()))
        columns = {name: np.array([one[name] for one in frames.values()]) for name in names}
        return PointTable(what, tuple(frames), tuple(points), columns)

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        """A column."""
        return self.columns[name]

    def vectors(self, quantity: str) -> Float:
        """(F, P, K): the K columns whose names begin with a ``quantity``, as "measured"."""
        names = [name for name in self.columns if name.startswith(f"{quantity}_")]
        return np.stack([self[name] for name in names], axis=-1)

    def last(self, quantity: str) -> Float:
        """(P, K): `vectors` in the last frame."""
        return np.asarray(self.vectors(quantity)[-1])

    def lost(self) -> Iterator[str]:
        """Points whose "status" isn't "OK", with the reason, and the last frame in which they were
        lost if others follow."""
        for point, status in zip(self.points, self["status"].T, strict=True):
            for k in np.flatnonzero(status != "OK")[-1:]:
                when = f" in frame {self.frames[k]}" if k < len(self.frames) - 1 else ""
                yield f"{point} ({status[k]}{when})"

    def csv(self, until: str = "") -> str:
        """One row for each point, frame after frame; a column "frame" if there are several.

        ``until``: the last column that is written; "" for all of them.
        """
        names = list(self.columns)
        names = names[: names.index(until) + 1] if until else names
        several = len(self.frames) > 1
        frames = [str(frame) for frame in self.frames for _ in self.points]
        # column by column: there may be 100,000 points
        texts = [
            *([frames] if several else []), [*self.points] * len(self.frames),
            *(_cells(self[name].ravel()) for name in names),
        ]  # fmt: skip
        head = [*(["frame"] if several else []), self.what, *names]
        return csv_text(head, list(zip(*texts, strict=True)))


def _cells(column: npt.NDArray[Any]) -> list[str]:
    """The cells of a column (N,), as `csv_text` has them."""
    if column.dtype.kind == "U":
        return [str(value) for value in column.tolist()]
    return [f"{value:.7g}" if isfinite(value) else "" for value in column.tolist()]


def vector_columns(name: str, components: Sequence[str], values: Float) -> dict[str, Float]:
    """``values`` (..., K) as K columns: ``{}`` in their ``name`` stands for a component."""
    return {name.format(one): values[..., k] for k, one in enumerate(components)}


def csv_text(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table; texts stay, and numbers that aren't finite are empty cells."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        writer.writerow(
            [v if isinstance(v, str) else f"{v:.7g}" if isfinite(v) else "" for v in row]
        )
    return stream.getvalue()


def rms(values: Float) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    return float(np.sqrt(mean(values**2)))


def mean(values: Float) -> float:
    """Mean of what is finite; NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else float("nan")


@dataclass(frozen=True)
class Reported:
    """What a measurement says in the report; figures are to be drawn. Those of one title that
    follow each other and name their frame (`gpusim.report.Figure`) are one with a slider.

    ``crops``: camera -> places in its first and last picture (`gpusim.report.FramePair`).
    ``links``: to files of a comparison of variants; of others every table has one. ``tables`` stand
    before all else that was measured.
    """

    measurements: Sequence[Measurement] = ()
    series: Sequence[Series] = ()
    overlays: Sequence[Overlay] = ()
    figures: Sequence[Drawing] = ()
    crops: Mapping[str, Sequence[Crop]] = field(default_factory=dict)
    links: Sequence[Link] = ()
    tables: Sequence[Table] = ()


_REST = "rest"


@dataclass(frozen=True, eq=False)
class Result:
    """What became of one measurement. Kinds add fields (arrays, mappings of equally large arrays by
    name, texts, numbers, tuples) and say more of it."""

    name: str
    table: PointTable

    @property
    def note(self) -> str:
        """What became of it, in a few words."""
        points, frames = len(self.table.points), len(self.table.frames)
        what = f"{self.table.what}{'s' * (points > 1)}"
        return f"{points} {what} in {frames} frame{'s' * (frames > 1)}"

    @property
    def warnings(self) -> list[str]:
        """What was not well measured, for the report: points that were lost."""
        lost = ", ".join(self.table.lost()) if "status" in self.table.columns else ""
        return [f"measure {self.name!r}: not measured: {lost}"] if lost else []

    def instants(self, scene: Scene) -> tuple[Float, str]:
        """Load factors or times (F,) of the frames, or their numbers where modes are shown, and
        what they are called."""
        if scene.analysis.word == "phase_deg":
            return np.array(self.table.frames), "frame"
        factors, word = scene.analysis.frame_values, scene.analysis.word.replace("_", " ")
        return np.array([factors[frame] for frame in self.table.frames]), word

    def tables(self) -> dict[str, str]:
        """CSV texts by the ending of the file's name."""
        return {"": self.table.csv()}

    def report(self, scene: Scene, out: Path) -> Reported:
        """What it says in the report of ``scene``'s run into ``out``. The first measurement, named
        ``<name>: ...``, is its main number, and one with "RMS error" in its name its accuracy."""
        return Reported()

    def measurements(self, scene: Scene) -> Sequence[Measurement]:
        """Those of its `report`, for who wants nothing else."""
        return self.report(scene, Path()).measurements

    def contents(self) -> dict[str, Output]:
        """Its files by their names: ``<name><ending>.csv`` of each table for people, ``<name>.npz``
        with everything."""
        arrays, rest = dict(self.table.columns), dict[str, Any]()
        for item in fields(self)[2:]:
            value = getattr(self, item.name)
            if isinstance(value, Mapping):  # the names go with the texts, its arrays as one
                rest[item.name], value = [*value], np.array([*value.values()])
            (arrays if isinstance(value, np.ndarray) else rest)[item.name] = value
        table = [self.table.what, self.table.frames, self.table.points, [*self.table.columns]]
        arrays[_REST] = np.array(json.dumps([table, rest]))
        stream, stem = io.BytesIO(), safe_name(self.name)
        np.savez(stream, allow_pickle=False, **arrays)
        files: dict[str, Output] = {f"{stem}.npz": stream.getvalue()}
        return files | {f"{stem}{end}.csv": text.encode() for end, text in self.tables().items()}

    def write_tables(self, folder: Path) -> list[Path]:
        """The CSV files alone."""
        stem, tables = safe_name(self.name), self.tables().items()
        return [write_text(inside(folder, f"{stem}{ending}.csv"), text) for ending, text in tables]

    @classmethod
    def read(cls, folder: Path, name: str, read: Reader = read_input) -> Self:
        """What an earlier run wrote; ``read``: how. Raises InputError, or what a damaged file
        makes NumPy and JSON raise."""
        table, rest = stored_table(read(str(inside(folder, f"{safe_name(name)}.npz"))))
        return cls(name, table, **rest)


def stored_table(file: InputFile) -> tuple[PointTable, dict[str, Any]]:
    """The table of a result's file, and what else its kind has kept. Raises as `Result.read`."""
    with np.load(file.stream(), allow_pickle=False) as stored:
        arrays = dict(stored)
    (what, frames, points, columns), rest = json.loads(str(arrays.pop(_REST)))
    columns = {column: arrays.pop(column) for column in columns}
    rest = {key: tuple(v) if isinstance(v, list) else v for key, v in rest.items()}
    for key in rest.keys() & arrays.keys():
        rest[key] = dict(zip(rest[key], arrays.pop(key), strict=True))
    return PointTable(what, tuple(frames), tuple(points), columns), rest | arrays
