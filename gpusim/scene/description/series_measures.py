"""The tables of ``[[measure]]`` that follow a few places over frames: extensometer, gauge, line and
point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from .correlation_table import CorrelationTable
from .table import Listed, Names, Pair, PositivePair, Vector, Words, fault

Step = Annotated[int, Field(ge=1, le=1000)]
SurfaceStrain = Literal["green-lagrange", "hencky"]


class SeriesTable(CorrelationTable):
    """A few places of a surface over frames: in the reference picture, x right and y down, or in
    space on the unloaded structure, as the (first) camera sees it."""

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
