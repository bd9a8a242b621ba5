"""The tables of ``[[measure]]`` that correlate pictures: what all of them say, and those that
follow a few places over frames (extensometer, gauge, line and point)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from gpusim.choices import LensModel, SurfaceStrain
from gpusim.scene.tables.table import (
    Length,
    Listed,
    Name,
    Names,
    Pair,
    PositivePair,
    Vector,
    Words,
    fault,
)

from .analysis.analysis_table import frame_count
from .measure_table import MeasureFault, MeasureTable

Step = Annotated[int, Field(ge=1, le=1000)]


class CorrelationTable(MeasureTable):
    """Subsets of one camera's first picture, or of a pair's, found again in later ones."""

    references: ClassVar[Mapping[str, str]] = {"camera": "camera", "cameras": "camera"}
    correlates = True

    camera: Name | None = None
    """The one that measures; or give cameras."""
    cameras: Annotated[tuple[Name, ...], Listed(2, 2, different=True)] | None = None
    """A pair; the reference picture is the first one's."""
    subset_px: Annotated[int, Field(ge=5, le=255)] = 31
    """Side of the square subsets, odd."""
    shape: Literal["affine", "quadratic"] = "affine"
    """How a subset deforms."""
    start: Literal["auto", "search", "features"] = "auto"
    """How the first points are found: by a search nearby, from matched features for any distance
    and rotation, or features where the search fails."""
    search_px: Annotated[int, Field(ge=1, le=1000)] = 20
    """How far is searched."""
    blur_px: Annotated[float, Field(ge=0, le=10)] = 0.0
    """Standard deviation of a Gaussian over the pictures before they are correlated."""
    min_zncc: Annotated[float, Field(ge=-1, le=1)] = 0.8
    """Matches below are lost."""
    frames: Annotated[tuple[Annotated[int, Field(ge=1)], ...], Listed(1, different=True)] | None = (
        None
    )
    """Numbers of the frames that are measured against the first one, 0; by default all after it."""
    reference: Literal["first", "updated"] = "first"
    """"updated": against a frame before where the first one no longer matches, and steps added up:
    for large strains and turns."""
    mm_per_px: Length | None = None
    """Scale of one camera's picture, if there is one."""
    plane_pose: Annotated[int, Field(ge=0)] | None = None
    """Number of the pose of [calibration], from 0, whose target lies on the surface: one camera
    then measures in mm on that plane, with the lens undone."""
    lens: LensModel = "brown"
    """What the calibration is to find."""
    calibration: str | None = None
    """The pair's calibration file (OpenCV, Kalibr, MatchID, VIC, DICe), cameras known by their
    names or else in this order, in place of the images of [calibration]; or "true": the cameras as
    they are."""

    @property
    def uses_calibration(self) -> bool:
        """Pairs without a calibration do, and one camera on the plane of a pose."""
        pair = self.cameras is not None and self.calibration is None
        return pair or self.plane_pose is not None

    def pictures(self, frames: int) -> list[tuple[str, int]]:
        """The first frame, and those that are measured."""
        return [(camera, frame) for camera in self.views for frame in (0, *self.measured(frames))]

    def measured(self, frames: int) -> tuple[int, ...]:
        """Numbers of the frames that are measured, of so many."""
        return tuple(range(1, frames)) if self.frames is None else tuple(sorted(self.frames))

    def seconds(self, markers: int, pixels: int, frames: int) -> float:
        """What is done with every pixel; few subsets take no time."""
        return 3e-6 * len(self.views) * pixels * frames

    @model_validator(mode="after")
    def _check(self) -> CorrelationTable:
        if (self.camera is None) == (self.cameras is None):
            got = Words("neither" if self.camera is None else "both")
            raise fault("camera", "how many cameras measure", got, "camera or cameras")
        for key in ("subset_px", "strain_window"):
            if getattr(self, key, 1) % 2 == 0:
                raise fault(key, "even", getattr(self, key), "an odd number")
        for key in ("mm_per_px", "plane_pose"):
            if self.cameras is not None and getattr(self, key) is not None:
                raise fault(key, "of one camera, but cameras are given", getattr(self, key), "none")
        if self.mm_per_px is not None and self.plane_pose is not None:
            expected = "mm_per_px or plane_pose"
            raise fault("mm_per_px", "lengths are told twice", self.mm_per_px, expected)
        if self.calibration is not None and self.cameras is None:
            raise fault("calibration", "of a pair, but one camera is given", self.calibration,
                        "cameras, or none")  # fmt: skip
        return self

    @classmethod
    def faults(
        cls, entry: Mapping[str, Any], document: Mapping[str, Any]
    ) -> Iterator[MeasureFault]:
        """A calibration where one is needed, with that pose; frames that there are."""
        calibration, pose = document.get("calibration"), entry.get("plane_pose")
        pair = "cameras" in entry and "calibration" not in entry
        if (pair or pose is not None) and calibration is None:
            key = () if pair else ("plane_pose",)
            yield (
                key, "needs images of a target", Words("no [calibration]"),
                "[calibration] of a checker or charuco"
                + ", or calibration, a file" * pair,
            )  # fmt: skip
        poses = calibration.get("pose") if isinstance(calibration, dict) else None
        if isinstance(poses, list) and isinstance(pose, int) and not pose < len(poses):
            yield ("plane_pose",), "no such pose", pose, f"less than {len(poses)}"
        yield from _missing_frames(entry, document)


class SeriesTable(CorrelationTable):
    """A few places of a surface over frames: in the reference picture, x right and y down, or in
    space on the unloaded structure, as the (first) camera sees it."""

    package = "series"
    places: ClassVar[Sequence[str]] = ()
    """Keys that are given in px or in mm."""

    @model_validator(mode="after")
    def _check_places(self) -> SeriesTable:
        for key in self.places:
            given = [getattr(self, f"{key}_{unit}") is not None for unit in ("px", "mm")]
            if sum(given) != 1:
                got = Words("both" if all(given) else "neither")
                raise fault(f"{key}_px", "where it is", got, f"{key}_px or {key}_mm")
        return self


class ExtensometerTable(SeriesTable):
    """An optical extensometer: the length between two ends, and its engineering strain.

    Example::

        name = "extension"
        type = "extensometer"
        camera = "front"
        ends_mm = [[20.0, 0.0, 5.0], [70.0, 0.0, 5.0]]
    """

    type: Literal["extensometer"]
    places = ("ends",)

    ends_px: Annotated[tuple[Pair, ...], Listed(2, 2)] | None = None
    """Both ends in the reference picture."""
    ends_mm: Annotated[tuple[Vector, ...], Listed(2, 2)] | None = None
    """Both ends on the unloaded structure."""
    width_px: Annotated[float, Field(ge=0, le=10_000)] = 0.0
    """Each end is a line so long, at right angles to the length, with subset beside subset, of
    which the mean counts; 0: a point."""


class GaugeTable(SeriesTable):
    """A virtual strain gauge: the mean strain of a rectangle, from planes fitted to its subsets.

    Example::

        name = "root"
        type = "gauge"
        cameras = ["left", "right"]
        center_mm = [20.0, 0.0, 5.0]
        size_mm = [8.0, 4.0]
    """

    type: Literal["gauge"]
    places = "center", "size"

    center_px: Pair | None = None
    """Its middle in the reference picture."""
    center_mm: Vector | None = None
    """Its middle on the unloaded structure."""
    size_px: PositivePair | None = None
    """Along the picture's x and y, whole subsets."""
    size_mm: PositivePair | None = None
    """Along the picture's x and y, on the surface."""
    step_px: Step = 5
    """Distance of its subsets."""
    strain: SurfaceStrain = "green-lagrange"
    """Which strain."""


class LineMeasureTable(SeriesTable):
    """Displacements and strains along a straight line: a deflection line without markers.

    Example::

        name = "deflection-line"
        type = "line"
        camera = "side"
        start_mm = [5.0, 0.0, 5.0]
        end_mm = [235.0, 0.0, 5.0]
        count = 60
        frames = [1, 2]
    """

    type: Literal["line"]
    places = "start", "end"

    start_px: Pair | None = None
    """Where it begins in the reference picture."""
    start_mm: Vector | None = None
    """Where it begins on the unloaded structure."""
    end_px: Pair | None = None
    """Where it ends in the reference picture."""
    end_mm: Vector | None = None
    """Where it ends on the unloaded structure."""
    count: Annotated[int, Field(ge=2, le=10_000)] = 50
    """Points, evenly spaced."""
    step_px: Step = 5
    """Distance of the subsets around a point from which its strain is taken."""
    strain: Literal["green-lagrange", "hencky", "none"] = "green-lagrange"
    """Which strain."""
    strain_window: Annotated[int, Field(ge=3, le=101)] = 5
    """Subsets across the square around a point, odd."""


class PointMeasureTable(SeriesTable):
    """Displacements of points.

    Example::

        name = "tip"
        type = "point"
        camera = "side"
        points_mm = [[235.0, 0.0, 5.0]]
        names = ["tip"]
    """

    type: Literal["point"]
    places = ("points",)

    points_px: Annotated[tuple[Pair, ...], Listed(1)] | None = None
    """Places in the reference picture."""
    points_mm: Annotated[tuple[Vector, ...], Listed(1)] | None = None
    """Places on the unloaded structure."""
    names: Names = ()
    """Of the points, in their order; by default p1, p2, ..."""

    @model_validator(mode="after")
    def _check_names(self) -> PointMeasureTable:
        count = len(self.points_px or self.points_mm or ())
        if self.names and len(self.names) != count:
            raise fault("names", "one for each point", len(self.names), f"{count}, or none")
        return self


def _missing_frames(
    entry: Mapping[str, Any], document: Mapping[str, Any]
) -> Iterator[MeasureFault]:
    """Frames of a measure that the analysis doesn't have."""
    analysis, frames = document.get("analysis", {}), entry.get("frames")
    if not isinstance(analysis, Mapping) or not isinstance(frames, list):
        return
    count = frame_count(analysis)
    for place, frame in enumerate(frames):
        if count is not None and isinstance(frame, int) and not frame < count:
            yield ("frames", place), "no such frame", frame, f"from 1 to {count - 1}"
