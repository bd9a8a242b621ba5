"""The tables of gpusim's own kinds of ``[[measure]]``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from .loads import WhereTable
from .measure_table import TABLES, AnyKind, MeasureFault, MeasureTable
from .table import (
    Length,
    Listed,
    Name,
    Names,
    Pair,
    SeveralNames,
    SignedAxis,
    Table,
    Vector,
    Words,
    fault,
    norm,
    tables_of,
)

LensModel = Literal[
    "pinhole", "radial", "radial3", "radtan", "brown", "rational", "prism", "tilted"
]
"""What a calibration is to find: no distortion, k1 k2, + k3, + p1 p2, + k4..k6, + s1..s4, + tau."""


class PublishedTable(Table):
    """What somebody else reached; the report sets it beside this run's error.

    Example::

        error_percent = 0.26
        source = "Zdziebko & Holak, Sensors 2021, 21(18), 6046"
    """

    error_percent: Annotated[float, Field(ge=0)]
    """Relative error of the measure's main number: the last marker's displacement."""
    source: Annotated[str, Field(min_length=1)]
    """Where it is written."""


class MarkerMeasureTable(MeasureTable):
    """Markers tracked from frame 0 to every other one."""

    references: ClassVar[Mapping[str, str]] = {
        "groups": "markers paint on a body",
        "static": "markers paint on a prop",
    }

    groups: SeveralNames
    """Paints of markers on bodies, in order from the clamp."""
    static: Names = ()
    """Paints of markers on props: what they move is the motion of the camera, or of the rig."""
    subset_px: Annotated[int, Field(ge=5, le=1001)] | None = None
    """Side of the tracked square, odd; without it as large as the marker allows."""
    published: PublishedTable | None = None
    """A result of somebody else, for the report to compare with."""

    def seconds(self, markers: int, pixels: int, frames: int) -> float:
        """Each frame is compared with the first."""
        return (0.01 * markers + 2e-8 * pixels) * (frames - 1)

    @model_validator(mode="after")
    def _check(self) -> MarkerMeasureTable:
        if self.subset_px is not None and self.subset_px % 2 == 0:
            raise fault("subset_px", "even", self.subset_px, "an odd number of pixels")
        return self


class DeflectionTable(MarkerMeasureTable):
    """The deflection line of every frame, in the image of one camera.

    Example::

        name = "deflection"
        type = "deflection"
        camera = "side"
        groups = ["side-markers"]
        static = ["wall-markers"]
        direction = "-z"
    """

    type: Literal["deflection"]
    references = {"camera": "camera", **MarkerMeasureTable.references}

    camera: Name
    """Name of the [[camera]] in whose pictures it is measured."""
    direction: SignedAxis
    """Of the deflection that counts as positive."""

    @classmethod
    def faults(
        cls, entry: Mapping[str, Any], document: Mapping[str, Any]
    ) -> Iterator[MeasureFault]:
        """One camera can't measure along its own axis."""
        direction = entry.get("direction")
        for _, camera in tables_of(document, "camera"):
            if camera.get("name") != entry.get("camera"):
                continue
            ends = [_numbers(camera.get(key)) for key in ("position_mm", "target_mm")]
            if not (ends[0] and ends[1]) or direction not in ("+x", "-x", "+y", "-y", "+z", "-z"):
                continue
            view = [b - a for a, b in zip(*ends, strict=True)]
            if abs(view["xyz".index(direction[1])]) > 0.7 * norm(view):
                yield (
                    ("direction",), "is along the camera's view", direction,
                    "a direction that its image shows",
                )  # fmt: skip


class StereoTable(MarkerMeasureTable):
    """Points in space from two or more cameras that are calibrated from images alone.

    The cameras' calibration comes from the images of [calibration], which has to show a checker;
    the markers' displacement between frame 0 and every other one from triangulation.

    Example::

        name = "space"
        type = "stereo"
        cameras = ["left", "right"]
        groups = ["markers"]
        lens = "radtan"
    """

    type: Literal["stereo"]
    references = {"cameras": "camera", **MarkerMeasureTable.references}

    cameras: Annotated[tuple[Name, ...], Listed(2, different=True)]
    """The first one's coordinates are the rig's."""
    lens: LensModel = "brown"
    """What the calibration is to find: no distortion, k1 k2, + k3, + p1 p2, + k4..k6, + s1..s4,
    + tau."""

    @property
    def uses_calibration(self) -> bool:
        """Always."""
        return True

    @classmethod
    def faults(
        cls, entry: Mapping[str, Any], document: Mapping[str, Any]
    ) -> Iterator[MeasureFault]:
        """Without a target no camera is calibrated."""
        if "calibration" not in document:
            yield (
                (), "needs images of a target", Words("no [calibration]"),
                "[calibration] of a checker or charuco",
            )  # fmt: skip


class RegionTable(Table):
    """The part of a picture that is measured: pixels for which everything given here holds.

    Example::

        paint = "speckle"
        polygon_px = [[100.0, 80.0], [900.0, 80.0], [900.0, 600.0], [100.0, 600.0]]
    """

    paint: Name | None = None
    """Where the camera sees this paint, of a body or of a prop."""
    where: WhereTable | None = None
    """Where it sees such faces of bodies; lengths are those of the unloaded shape."""
    polygon_px: Annotated[tuple[Pair, ...], Listed(3)] | None = None
    """Corners x, y in the reference picture (of the first camera)."""
    polygon_mm: Annotated[tuple[Vector, ...], Listed(3)] | None = None
    """Corners in space, seen through the camera; edges between them are straight in space."""


ADVISED = "subset_px", "step_px", "shape", "blur_px", "strain_window"
"""Keys that ``settings = "best"`` chooses."""


class DicTable(MeasureTable):
    """Digital image correlation: displacements and strains of a surface, point by point.

    One ``camera`` measures in px, and in mm with a scale or on the plane of a calibration target;
    two ``cameras``, calibrated from the images of [calibration], measure shape and displacement in
    space.

    Example::

        name = "field"
        type = "dic"
        cameras = ["left", "right"]
        roi = { paint = "speckle" }
        subset_px = 21
        step_px = 7
    """

    type: Literal["dic"]
    references: ClassVar[Mapping[str, str]] = {
        "camera": "camera", "cameras": "camera", "roi.paint": "paint",
    }  # fmt: skip
    correlates = True

    camera: Name | None = None
    """The one that measures; or give cameras."""
    cameras: Annotated[tuple[Name, ...], Listed(2, 2, different=True)] | None = None
    """A pair; the reference picture is the first one's."""
    roi: RegionTable | None = None
    """What is measured; by default what is painted with speckle or a picture, else all bodies."""
    settings: Literal["best"] | None = None
    """"best": subset, step, shape, blur and strain window by the advice of ``gpusim dic --advise``
    on the reference picture (of the first camera) within the region, in place of those below."""
    subset_px: Annotated[int, Field(ge=5, le=255)] = 31
    """Side of the square subsets, odd."""
    step_px: Annotated[int, Field(ge=1, le=1000)] = 10
    """Distance of the points."""
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
    strain: Literal["green-lagrange", "hencky", "small", "none"] = "green-lagrange"
    """Which strain is taken from the displacements; "small" of one camera alone."""
    strain_window: Annotated[int, Field(ge=3, le=101)] = 5
    """Points across the window of the virtual strain gauge, odd."""
    mm_per_px: Length | None = None
    """Scale of one camera's picture, if there is one."""
    plane_pose: Annotated[int, Field(ge=0)] | None = None
    """Number of the pose of [calibration], from 0, whose target lies on the surface: one camera
    then measures in mm on that plane, with the lens undone."""
    lens: LensModel = "brown"
    """What the calibration is to find."""
    formats: Annotated[
        tuple[Literal["csv", "npz", "h5", "mat"], ...], Listed(1, different=True)
    ] = ("csv", "npz")
    """Files of the maps; npz is written in any case."""

    @property
    def uses_calibration(self) -> bool:
        """Pairs do, and one camera on the plane of a pose."""
        return self.cameras is not None or self.plane_pose is not None

    def pictures(self, frames: int) -> list[tuple[str, int]]:
        """The first frame, and those that are measured."""
        return [(camera, frame) for camera in self.views for frame in (0, *self.measured(frames))]

    def measured(self, frames: int) -> tuple[int, ...]:
        """Numbers of the frames that are measured, of so many."""
        return tuple(range(1, frames)) if self.frames is None else tuple(sorted(self.frames))

    def seconds(self, markers: int, pixels: int, frames: int) -> float:
        """20,000 subsets of 31 px in a second, and what is done with every pixel."""
        subsets = 5e-6 * self.subset_px / self.step_px**2
        return len(self.views) * pixels * (3e-6 + (3e-6 + subsets) * (frames - 1))

    @model_validator(mode="after")
    def _check(self) -> DicTable:
        if (self.camera is None) == (self.cameras is None):
            got = Words("neither" if self.camera is None else "both")
            raise fault("camera", "how many cameras measure", got, "camera or cameras")
        for key in ADVISED if self.settings else ():
            if getattr(self, key) != type(self).model_fields[key].default:
                expected = f"settings or {key}"
                raise fault(key, 'chosen by settings = "best"', getattr(self, key), expected)
        for key in ("subset_px", "strain_window"):
            if getattr(self, key) % 2 == 0:
                raise fault(key, "even", getattr(self, key), "an odd number")
        for key in ("mm_per_px", "plane_pose"):
            if self.cameras is not None and getattr(self, key) is not None:
                raise fault(key, "of one camera, but cameras are given", getattr(self, key), "none")
        if self.mm_per_px is not None and self.plane_pose is not None:
            expected = "mm_per_px or plane_pose"
            raise fault("mm_per_px", "lengths are told twice", self.mm_per_px, expected)
        if self.cameras is not None and self.strain == "small":
            expected = "green-lagrange, hencky or none"
            raise fault("strain", "not of a surface in space", self.strain, expected)
        return self

    @classmethod
    def faults(
        cls, entry: Mapping[str, Any], document: Mapping[str, Any]
    ) -> Iterator[MeasureFault]:
        """A calibration where one is needed, with that pose; frames that there are."""
        calibration, pose = document.get("calibration"), entry.get("plane_pose")
        if ("cameras" in entry or pose is not None) and calibration is None:
            key = () if "cameras" in entry else ("plane_pose",)
            yield (
                key, "needs images of a target", Words("no [calibration]"),
                "[calibration] of a checker or charuco",
            )  # fmt: skip
        poses = calibration.get("pose") if isinstance(calibration, dict) else None
        if isinstance(poses, list) and isinstance(pose, int) and not pose < len(poses):
            yield ("plane_pose",), "no such pose", pose, f"less than {len(poses)}"
        yield from _missing_frames(entry, document)


class DamageTable(MeasureTable):
    """Differences of a deflection line between the variants, and where their slope changes.

    Example::

        name = "damage"
        type = "damage"
        of = "deflection"
        reference = "whole"
    """

    type: Literal["damage"]
    references = {"of": "measure of a deflection", "reference": "variant"}
    compares_variants = True

    of: Name
    """The [[measure]] of type "deflection" that every variant makes."""
    reference: Name
    """The [[variant]] that the others are compared with."""
    tolerance_mm: Length = 10.0
    """How far a change of slope may be from the notch that made it."""
    significance: Annotated[float, Field(gt=0, lt=1)] = 1e-3
    """Highest p-value at which a change of slope counts."""
    most: Annotated[int, Field(ge=1, le=50)] = 6
    """Changes of slope that are looked for."""
    clearance_mm: Annotated[float, Field(ge=0)] | None = None
    """Markers nearer than this to a change don't count for where it is; the default is the depth of
    the notched member: so far the line is bent by how stress flows round the notch."""


def _missing_frames(
    entry: Mapping[str, Any], document: Mapping[str, Any]
) -> Iterator[MeasureFault]:
    """Frames of a measure that the analysis doesn't have."""
    analysis, frames = document.get("analysis", {}), entry.get("frames")
    if not isinstance(analysis, Mapping) or not isinstance(frames, list):
        return
    instants = analysis.get("times", analysis.get("load_factors", [0, 1]))
    for place, frame in enumerate(frames):
        if isinstance(instants, list) and isinstance(frame, int) and not frame < len(instants):
            yield ("frames", place), "no such frame", frame, f"from 1 to {len(instants) - 1}"


def _numbers(value: Any) -> list[float] | None:
    """Three numbers that floats can hold, or None."""
    if not isinstance(value, list) or len(value) != 3:
        return None
    good = all(isinstance(v, int | float) and abs(v) < 1e300 for v in value)
    return [float(v) for v in value] if good else None


TABLES.update(
    (table.kind(), table) for table in (DeflectionTable, StereoTable, DicTable, DamageTable)
)
AnyMeasure = Annotated[MeasureTable, AnyKind()]
"""The table of any kind."""
