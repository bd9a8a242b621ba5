"""Markers over frames and cameras: what every kind that follows them shares.

They are found in each camera's first picture and followed into every other one; results have the
last frame's values, and histories over all frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.build.cameras import build_camera, build_sensor
from gpusim.pipeline.build.scene_objects import SceneObjects
from gpusim.pipeline.measurements.marker_detection import MarkerSet, collect_markers
from gpusim.pipeline.measurements.marker_tracking import MarkerTracks
from gpusim.pipeline.measurements.results import Crop, Result
from gpusim.pipeline.measurements.sources import Sources
from gpusim.report import Series
from gpusim.scene import Scene
from gpusim.scene.description import model as m
from gpusim.scene.frames import frame_word

__all__ = ["GOAL", "MarkerResult", "TrackedMarkers", "crops", "track_markers_of"]

Array = npt.NDArray[np.float64]
GOAL = 1e-3
"""Relative error up to which a measured displacement counts as good."""


@dataclass(frozen=True, eq=False)
class TrackedMarkers:
    """``marks`` in the pictures of ``cameras``; ``tracks``: of each camera one for each of the
    ``frames`` after the first."""

    marks: MarkerSet
    cameras: tuple[Camera, ...]
    frames: tuple[int, ...]
    tracks: tuple[tuple[MarkerTracks, ...], ...]

    def states(self) -> dict[str, npt.NDArray[Any]]:
        """Columns of the markers on bodies: their group, and in which frames there are clipped
        pixels within one (``saturated``), or it rests on correlation alone (``unrefined``)."""
        count = self.marks.count
        return {"group": np.array(self.marks.group_names[:count])} | {
            column: np.any(
                [[getattr(one, name)[:count] for one in tracks] for tracks in self.tracks], axis=0
            )
            for column, name in (("saturated", "clipped"), ("unrefined", "unrefined"))
        }


def track_markers_of(
    spec: m.MarkerMeasure, scene: Scene, objects: SceneObjects, sources: Sources
) -> TrackedMarkers:
    """The markers of ``spec`` in its cameras' pictures, every frame against the first.

    This needs no calibration. Raises InputError for a marker that is too small or behind a camera,
    GpusimError if none is found.
    """
    what = f"measure {spec.name!r}"
    marks = collect_markers(what, spec.groups, spec.static, scene, objects.bodies)
    by_name = {one.name: one for one in scene.cameras}
    cameras = tuple(build_camera(by_name[name], scene.input) for name in spec.views)
    frames = len(scene.analysis.load_factors)
    tracks = [
        sources.markers.track(
            spec.name, marks, camera, (sources.image(name, frame) for frame in range(frames)),
            subset=spec.subset, sensor=build_sensor(scene.sensor_of(name), by_name[name], 1.0),
        )
        for name, camera in zip(spec.views, cameras, strict=True)
    ]  # fmt: skip
    return TrackedMarkers(marks, cameras, tuple(range(1, frames)), tuple(map(tuple, tracks)))


@dataclass(frozen=True, eq=False)
class MarkerResult(Result):
    """What became of M markers between the first frame and every other one.

    Columns of the table, beside its numbers: ``group`` names, ``status`` names; ``saturated``:
    whether there are clipped pixels within the marker, ``unrefined``: whether it was measured by
    correlation alone, because its cross couldn't be fitted. Properties are of the last frame.
    """

    @property
    def marker(self) -> tuple[str, ...]:
        """Names (M,)."""
        return self.table.points

    @property
    def group(self) -> npt.NDArray[np.str_]:
        """Names (M,) of the paints that markers are of."""
        names: npt.NDArray[np.str_] = self.table["group"][-1]
        return names

    @property
    def status(self) -> tuple[str, ...]:
        """Names (M,) in the last frame."""
        return tuple(str(one) for one in self.table["status"][-1])

    @property
    def position_mm(self) -> Array:
        """(M, 3) on the unloaded structure."""
        return np.stack([self.table[f"{axis}_mm"][-1] for axis in "xyz"], axis=-1)

    @property
    def measured_mm(self) -> Array:
        """Displacements (M, K) in the last frame."""
        measured: Array = self.table.vectors("measured")[-1]
        return measured

    @property
    def true_mm(self) -> Array:
        """True displacements (M, K) in the last frame."""
        true: Array = self.table.vectors("true")[-1]
        return true

    @property
    def measured_count(self) -> str:
        """Such as "7 of 8 markers"."""
        return f"{sum(one == 'OK' for one in self.status)} of {len(self.status)} markers"

    def named(self, column: str) -> list[str]:
        """The markers for which a column is true in any frame."""
        return [self.marker[i] for i in np.flatnonzero(self.table[column].any(axis=0))]

    @property
    def warnings(self) -> list[str]:
        """Markers that were not measured, whose white is clipped, and that are less exact."""
        what = f"measure {self.name!r}"
        lost = ", ".join(self._lost())
        found = [f"{what}: not measured: {lost}"] if lost else []
        if clipped := self.named("saturated"):
            found.append(
                f"{what}: saturated pixels on {', '.join(clipped)}; a clipped edge moves its "
                "marker: lower [sensor] exposure"
            )
        if rough := self.named("unrefined"):
            found.append(
                f"{what}: by correlation alone, without a fit of the cross: {', '.join(rough)}; a "
                "sharp marker may be off by 0.02 px then (others: 0.003)"
            )
        return found

    def _lost(self) -> Iterator[str]:
        """Markers with the reason, and the last frame in which they were lost if others follow."""
        frames, states = self.table.frames, self.table["status"]
        for marker, status in zip(self.marker, states.T, strict=True):
            rows = np.flatnonzero(status != "OK")
            if rows.size:
                k = int(rows[-1])
                when = f" in frame {frames[k]}" if k < len(frames) - 1 else ""
                yield f"{marker} ({status[k]}{when})"

    def histories(self, scene: Scene, quantity: str, measured: Array, true: Array) -> list[Series]:
        """A series per marker of a ``quantity`` (F, M), mm, over the frames' load factors or times;
        none of a single frame."""
        if len(self.table.frames) < 2:
            return []
        instants = np.array([scene.analysis.load_factors[frame] for frame in self.table.frames])
        return [
            Series(
                name=f"{self.name}: {marker}, {quantity}",
                x=instants,
                y_measured=measured[:, i],
                y_truth=true[:, i],
                x_label=frame_word(scene).replace("_", " "),
                y_label=quantity,
                y_unit="mm",
                figure=f"{self.name}: {self.group[i]}, {quantity}",
            )
            for i, marker in enumerate(self.marker)
        ]


def crops(marker: Sequence[str], points: Array, moved: Array) -> list[Crop]:
    """The first, the middle and the last of the markers (M, 2) px that were followed."""
    ok = np.flatnonzero(np.isfinite(points + moved).all(axis=1))
    if not len(ok):
        return []
    shown = ok[np.unique(np.linspace(0, len(ok) - 1, 3).astype(int))]
    ends = (points + moved).tolist()
    return [(marker[i], *points[i].tolist(), *ends[i]) for i in shown]
