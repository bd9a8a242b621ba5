"""Subsets of a few places followed over frames, and what a kind makes of them.

The pictures are correlated as those of the kind "dic". Displacements are compared with its truth;
lengths and strains with what really happens to the material in space, so that what one camera reads
of motion towards it counts as error. Lengths in px are compared with the picture's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim import measure
from gpusim.arrays.array_types import Float, Long
from gpusim.pipeline.measurements.dic.field_columns import STRAINS
from gpusim.pipeline.measurements.dic.measuring import measured_at, unloaded_motion
from gpusim.pipeline.measurements.dic.point_fields import PointFields
from gpusim.pipeline.measurements.dic.true_field import TrueField
from gpusim.pipeline.measurements.kinds import Kind, Unloaded, register
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.results import MM, Columns, PointTable
from gpusim.pipeline.measurements.series.placing import PlacedSubsets, ReferencePicture
from gpusim.pipeline.measurements.series.result import SeriesResult
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.tables.table import name_and_unit

ANCHOR_STEP = 2
"""Subsets from one to the next of those by which a calibrated rig is laid on the structure."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Subsets in a frame, measured or true: ``places`` (N, D) in the first picture and how far they
    ``moved`` (N, D), in ``unit``, NaN where lost."""

    subsets: PlacedSubsets
    places: Float
    moved: Float
    unit: str


@dataclass(frozen=True)
class SeriesKind:
    """``what`` is measured, as rows are called; ``patches``: pixels of the subsets of each place;
    ``quantities``: what is made of them; ``moves``: displacements of the places are told, too;
    ``joined``: all places make one row."""

    what: str
    patches: Callable[[Any, ReferencePicture], Mapping[str, Float]]
    quantities: Callable[[Any, Sample], Columns] = lambda *_: {}
    moves: bool = False
    joined: bool = False

    def measure(
        self, spec: m.SeriesTable, scene: Scene, objects: SceneObjects, sources: Sources
    ) -> SeriesResult:
        """Every frame against the first one. Raises InputError for a place that isn't seen, and
        what `gpusim.pipeline.measurements.dic.measure_dic` raises."""
        picture = ReferencePicture(spec, TrueMotion(objects))
        subsets = picture.placed(self.patches(spec, picture))
        common = {key: getattr(spec, key) for key in m.CorrelationTable.model_fields}
        rest = {"type": "dic", "strain": "none", "step_px": ANCHOR_STEP * spec.subset_px}
        dic, points = m.DicTable.model_construct(**common | rest), subsets.pixels
        if spec.cameras is not None or spec.plane_pose is not None:
            points = np.concatenate([points, picture.anchors(dic)])
        region = picture.region(points)
        field = TrueField.of(picture.motion, spec.views[0], region, points)
        found = measured_at(field, dic, scene, sources)
        tracks = _SubsetTracks(subsets, field, found)
        frames = {
            frame: self._columns(spec, tracks, k) for k, frame in enumerate(found.table.frames)
        }
        names = (self.what,) if self.joined else subsets.names
        shown = subsets.middle if self.moves else np.arange(len(subsets.pixels))
        shift = field.shift(found.table.frames[-1]) + found.raw_px[-1, 0]
        return SeriesResult(
            spec.name, PointTable.of(self.what, names, frames), spec.views, found.axes,
            points[shown], shift[shown],
        )  # fmt: skip

    def _columns(self, spec: m.SeriesTable, tracks: _SubsetTracks, k: int) -> Columns:
        """Of the ``k``-th frame."""
        subsets, table = tracks.subsets, tracks.table(k)
        measured = dict(self.quantities(spec, tracks.picture(k, "measured")))
        true = dict(self.quantities(spec, tracks.space(k)))
        if tracks.unit == "px":
            seen = self.quantities(spec, tracks.picture(k, "true"))
            true |= {name: column for name, column in seen.items() if name.endswith("_px")}
        if self.moves:
            moved = tracks.found.displacements
            own = [{one: table[f"{kind}_{one}"][subsets.middle] for one in moved}
                   for kind in ("measured", "true")]  # fmt: skip
            measured, true = own[0] | measured, own[1] | true
        row = 0 * subsets.place if self.joined else subsets.place
        columns = _status(table, row, np.isfinite(next(iter(measured.values()))))
        columns |= tracks.places(k, self.what == "place") if self.moves else {}
        for name, column in measured.items():
            columns |= {f"measured_{name}": column, f"true_{name}": true[name],
                        f"difference_{name}": column - true[name]}  # fmt: skip
        return columns

    def checks(self, spec: m.SeriesTable, scene: Scene, unloaded: Unloaded) -> list[str]:
        """There is something to measure; raises InputError if not."""
        motion = unloaded_motion(spec, scene, unloaded)
        if motion is not None:
            picture = ReferencePicture(spec, motion)
            picture.placed(self.patches(spec, picture))
        return []


@dataclass(frozen=True, eq=False)
class _SubsetTracks:
    """``subsets`` as they were ``found`` in all frames, before other points of the ``field``."""

    subsets: PlacedSubsets
    field: TrueField
    found: PointFields

    @property
    def unit(self) -> str:
        """Of displacements."""
        return name_and_unit(self.found.displacements[0])[1]

    def table(self, k: int) -> Columns:
        """Columns (N,) of the ``k``-th frame."""
        count = len(self.subsets.pixels)
        return {name: column[k, :count] for name, column in self.found.table.columns.items()}

    def picture(self, k: int, kind: str) -> Sample:
        """The subsets as the pictures show them, displacements "measured" or "true"."""
        table = self.table(k)
        places = np.column_stack([table[name] for name in self.found.places])
        moved = np.column_stack([table[f"{kind}_{name}"] for name in self.found.displacements])
        return Sample(self.subsets, places, moved, self.unit)

    def space(self, k: int) -> Sample:
        """What really happens to their material, mm."""
        motion, material = self.field.motion, self.field.material[: len(self.subsets.pixels)]
        moved = motion.displacement(material, self.found.table.frames[k])
        return Sample(self.subsets, MM * motion.position(material, 0), MM * moved, self.unit)

    def places(self, k: int, along: bool) -> dict[str, Any]:
        """Columns of where the middles are, how far ``along`` a line if they are on one, and of
        uncertainties."""
        table, middle = self.table(k), self.subsets.middle
        columns = {name: table[name][middle] for name in ("x_px", "y_px")}
        if along:
            one = self.picture(k, "true") if self.unit == "px" else self.space(k)
            steps = np.linalg.norm(np.diff(one.places[middle], axis=0), axis=1)
            columns[f"along_{self.unit}"] = np.cumsum([0.0, *steps])
        return columns | {n: c[middle] for n, c in table.items() if n.startswith("sigma_")}


def _status(table: Columns, row: Long, measured: Any) -> dict[str, Any]:
    """Columns that say whether rows were ``measured``, or the reason why not, and which share of
    their subsets was followed."""
    words = np.where(table["hidden"], "HIDDEN", table["status"])
    lost = table["status"] != "OK"
    status = []
    for number, known in enumerate(measured):
        reasons = words[lost & (row == number)]
        status.append("OK" if known else str(reasons[0]) if len(reasons) else "FEW_SUBSETS")
    return {"status": np.array(status), "followed": np.bincount(row, ~lost) / np.bincount(row)}


def mean_strains(spec: Any, sample: Sample) -> Columns:
    """exx, eyy, exy of each place, from planes fitted to its subsets."""
    subsets = sample.subsets
    each = [subsets.place == number for number in range(len(subsets.names))]
    tensors = np.array([
        measure.gauge(subsets.pixels[one], sample.places[one], sample.moved[one], spec.strain)
        for one in each
    ])  # fmt: skip
    return {name: tensors[:, i, j] for name, (i, j) in STRAINS.items()}


def register_series(table: type[m.SeriesTable], kind: SeriesKind) -> None:
    """Let scenes have it."""
    register(Kind(table, SeriesResult, kind.measure, kind.checks))
