"""The tables of gpusim's own kinds of ``[[measure]]``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from gpusim.choices import LensModel
from gpusim.scene.tables.table import (
    AnyOf,
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

from .analysis.loads import WhereTable
from .correlation_measures import (
    CorrelationTable,
    ExtensometerTable,
    GaugeTable,
    LineMeasureTable,
    PointMeasureTable,
)
from .measure_table import TABLES, MeasureFault, MeasureTable


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
    endings = ("-cameras",)

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
"""Keys that ``settings = "best"`` chooses, in the order of `gpusim.measure.Advice.settings`."""


class DicTable(CorrelationTable):
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
    references = {**CorrelationTable.references, "roi.paint": "paint"}
    endings = "-statistics", "-parts"

    roi: RegionTable | None = None
    """What is measured; by default what is painted with speckle or a picture, else all bodies."""
    settings: Literal["best"] | None = None
    """"best": subset, step, shape, blur and strain window by the advice of ``gpusim dic --advise``
    on the reference picture (of the first camera) within the region, in place of those below."""
    step_px: Annotated[int, Field(ge=1, le=1000)] = 10
    """Distance of the points."""
    strain: Literal["green-lagrange", "hencky", "small", "none"] = "green-lagrange"
    """Which strain is taken from the displacements; "small" of one camera alone."""
    strain_window: Annotated[int, Field(ge=3, le=101)] = 5
    """Points across the window of the virtual strain gauge, odd."""
    formats: Annotated[
        tuple[Literal["csv", "npz", "h5", "mat"], ...], Listed(1, different=True)
    ] = ("csv", "npz")
    """Files of the maps; npz is written in any case."""

    def seconds(self, markers: int, pixels: int, frames: int) -> float:
        """20,000 subsets of 31 px in a second, and what is done with every pixel."""
        subsets = 5e-6 * self.subset_px / self.step_px**2
        return len(self.views) * pixels * (3e-6 + (3e-6 + subsets) * (frames - 1))

    @model_validator(mode="after")
    def _check_strain(self) -> DicTable:
        for key in ADVISED if self.settings else ():
            if getattr(self, key) != type(self).model_fields[key].default:
                expected = f"settings or {key}"
                raise fault(key, 'chosen by settings = "best"', getattr(self, key), expected)
        if self.cameras is not None and self.strain == "small":
            expected = "green-lagrange, hencky or none"
            raise fault("strain", "not of a surface in space", self.strain, expected)
        return self


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
    endings = ("-breaks",)

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


def _numbers(value: Any) -> list[float] | None:
    """Three numbers that floats can hold, or None."""
    if not isinstance(value, list) or len(value) != 3:
        return None
    good = all(isinstance(v, int | float) and abs(v) < 1e300 for v in value)
    return [float(v) for v in value] if good else None


TABLES.update(
    (table.kind(), table)
    for table in (
        DeflectionTable, StereoTable, DicTable, ExtensometerTable, GaugeTable, LineMeasureTable,
        PointMeasureTable, DamageTable,
    )
)  # fmt: skip
AnyMeasure = Annotated[MeasureTable, AnyOf(TABLES)]
"""The table of any kind."""
