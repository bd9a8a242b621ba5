"""Markers over frames and cameras: what every kind that follows them shares.

They are found in each camera's first picture and followed into every other one; results have the
last frame's values, and histories over all frames.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.measurements.marker_set import MarkerSet, collect_markers
from gpusim.pipeline.measurements.marker_tracking import FirstPicture, MarkerTracks
from gpusim.pipeline.measurements.results import Columns, Crop, Result, vector_columns
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.pictures.file_names import image_path
from gpusim.pipeline.scene_objects.cameras import build_camera, build_sensor
from gpusim.pipeline.scene_objects.moving_bodies import SceneObjects
from gpusim.report import Measurement, Overlay, Series
from gpusim.scene import Scene
from gpusim.scene.description import model as m

GOAL = 1e-3
"""Relative error up to which a measured displacement counts as good."""


@dataclass(frozen=True, eq=False)
class TrackedMarkers:
    """``marks`` in the pictures of ``cameras``; ``frames``: the number of each frame after the
    first, with the tracks from there in every camera."""

    marks: MarkerSet
    cameras: tuple[Camera, ...]
    frames: dict[int, tuple[MarkerTracks, ...]]

    def places(self, seen: Sequence[MarkerTracks], least: int) -> Columns:
        """Columns that a table of markers on bodies begins with: whether ``least`` cameras followed
        one, or why the first of them didn't, and where it is on the unloaded structure."""
        states = np.array([one.status[: self.marks.count] for one in seen])
        lost = states != "OK"
        first = np.take_along_axis(states, lost.argmax(axis=0)[None], axis=0)[0]
        status = np.where(np.count_nonzero(~lost, axis=0) >= least, "OK", first)
        place = 1e3 * self.marks.position[: self.marks.count]
        return {"status": status, **vector_columns("{}_mm", "xyz", place)}

    def flags(self, seen: Sequence[MarkerTracks]) -> Columns:
        """Columns that it ends with: groups, clipped pixels within a marker (``saturated``), and
        whether it rests on correlation alone (``unrefined``) in any camera."""
        count = self.marks.count
        return {
            "group": np.array(self.marks.group_names[:count]),
            "saturated": np.any([one.clipped[:count] for one in seen], axis=0),
            "unrefined": np.any([one.unrefined[:count] for one in seen], axis=0),
        }


def track_markers(
    spec: m.MarkerMeasureTable, scene: Scene, objects: SceneObjects, sources: Sources
) -> TrackedMarkers:
    """The markers of ``spec`` in its cameras' pictures, every frame against the first.

    This needs no calibration. Raises InputError for a marker that is too small or behind a camera,
    GpusimError if none is found.
    """
    marks = collect_markers(spec, scene, objects.bodies)
    by_name = {one.name: one for one in scene.cameras}
    cameras = tuple(build_camera(by_name[name], scene.input) for name in spec.views)
    frames = range(len(scene.analysis.frame_values))
    tracks = []
    for name, camera in zip(spec.views, cameras, strict=True):
        sensor = build_sensor(scene.sensor_of(name), by_name[name], 1.0)
        first = FirstPicture.of(
            f"measure {spec.name!r}", marks, camera, sources.image(name, 0), sensor
        )
        tracks.append(
            [first.follow(sources.image(name, frame), spec.subset) for frame in frames[1:]]
        )
    return TrackedMarkers(
        marks, cameras, dict(zip(frames[1:], zip(*tracks, strict=True), strict=True))
    )


@dataclass(frozen=True, eq=False)
class MarkerResult(Result):
    """What became of M markers between the first frame and every other one; columns of the table
    are those of `TrackedMarkers`, and more. Properties are of the last frame."""

    @property
    def marker(self) -> tuple[str, ...]:
        """Names (M,)."""
        return self.table.points

    @property
    def group(self) -> tuple[str, ...]:
        """Names (M,) of the paints that markers are of."""
        return tuple(self.table["group"][-1].tolist())

    @property
    def status(self) -> tuple[str, ...]:
        """Names (M,)."""
        return tuple(self.table["status"][-1].tolist())

    @property
    def position_mm(self) -> Float:
        """(M, 3) on the unloaded structure."""
        return np.stack([self.table[f"{axis}_mm"][-1] for axis in "xyz"], axis=-1)

    @property
    def measured_mm(self) -> Float:
        """Displacements (M, K)."""
        return self.table.last("measured")

    @property
    def true_mm(self) -> Float:
        """True displacements (M, K)."""
        return self.table.last("true")

    @property
    def measured_count(self) -> str:
        """Such as "7 of 8 markers"."""
        return f"{self.status.count('OK')} of {len(self.status)} markers"

    def named(self, column: str) -> str:
        """The markers for which a column is true in any frame."""
        return ", ".join(self.marker[i] for i in np.flatnonzero(self.table[column].any(axis=0)))

    @property
    def warnings(self) -> list[str]:
        """Markers that were not measured, whose white is clipped, and that are less exact."""
        what, found = f"measure {self.name!r}", super().warnings
        if clipped := self.named("saturated"):
            found.append(
                f"{what}: saturated pixels on {clipped}; a clipped edge moves its marker: lower "
                "[sensor] exposure"
            )
        if rough := self.named("unrefined"):
            found.append(
                f"{what}: by correlation alone, without a fit of the cross: {rough}; a sharp "
                "marker may be off by 0.02 px then (others: 0.003)"
            )
        return found

    def rms_error(self) -> list[Measurement]:
        """Of all markers that were measured, if there are any."""
        error = self.measured_mm - self.true_mm
        fine = np.isfinite(error).all(axis=1)
        if not fine.any():
            return []
        rms = float(np.sqrt(np.mean(np.sum(error[fine] ** 2, axis=1))))
        return [Measurement.noise(f"{self.name}: RMS error of all markers", "mm", rms)]

    def histories(self, scene: Scene, quantity: str, measured: Float, true: Float) -> list[Series]:
        """A series per marker of a ``quantity`` (F, M), mm, over the frames' load factors or times;
        none of a single frame."""
        (instants, x_label), name = self.instants(scene), self.name
        if len(instants) < 2:
            return []
        return [
            Series(
                f"{name}: {marker}, {quantity}", instants, one, other, x_label, quantity, "mm",
                figure=f"{name}: {group}, {quantity}", label=marker,
            )
            for marker, group, one, other in zip(
                self.marker, self.group, measured.T, true.T, strict=True
            )
        ]  # fmt: skip

    def pictured(
        self,
        scene: Scene,
        out: Path,
        views: Mapping[str, tuple[Float, Float]],
        mm_per_px: float | None = None,
    ) -> tuple[list[Overlay], dict[str, list[Crop]]]:
        """Overlays and crops of each camera's markers (M, 2) px and how far they moved."""
        several = len(views) > 1
        overlays = [
            Overlay(
                f"{self.name}: tracked markers{f', {camera}' if several else ''}",
                image_path(scene, out, camera, 0),
                np.where(np.isfinite(points), points, 0.0),
                moved,
                mm_per_px,
            )
            for camera, (points, moved) in views.items()
        ]
        return overlays, {camera: self._crops(*view) for camera, view in views.items()}

    def _crops(self, points: Float, moved: Float) -> list[Crop]:
        """The first, the middle and the last of the markers that were followed."""
        ok = np.flatnonzero(np.isfinite(points + moved).all(axis=1))
        shown = ok[np.unique(np.linspace(0, len(ok) - 1, 3).astype(int))] if len(ok) else ok
        ends = (points + moved).tolist()
        return [(self.marker[i], *points[i].tolist(), *ends[i]) for i in shown]
