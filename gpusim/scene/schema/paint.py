"""``[[body.paint]]`` and ``[[prop.paint]]``: what a surface looks like.

Albedo is the diffusely reflected fraction of light, 0 to 1. Patterns lie in the plane of the faces
they fall on (or as ``mapping`` says), with ``up`` (projected into that plane) pointing up, as seen
from outside. Positions are those of the unloaded shape; the pattern moves with the material.
"""

from __future__ import annotations

from itertools import pairwise
from math import exp, log1p, pi, sqrt
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Albedo, Direction, Length, Name, Table, Vector, Words, fault, norm, parallel
from .finish import FinishTable
from .where import WhereTable

__all__ = ["ImageTable", "LineTable", "MarkersTable", "PaintTable", "PatternTable"]

Count = Annotated[int, Field(ge=1, le=100_000)]


class _Paint(FinishTable):
    name: Name
    where: WhereTable = WhereTable()
    """The faces; without it all."""
    albedo: Albedo
    """Of the ground, outside the pattern."""


class _Pattern(_Paint):
    up: Direction | None = None
    """Roughly up on the surface; without it +z, on horizontal faces +y."""
    mapping: Literal["plane", "cylinder", "unfold"] = "plane"
    """How the pattern lies on the faces: "plane" faces only; round a "cylinder"; or laid on any
    faces as if they were unfolded, without smearing in holes and on sides (speckle only)."""
    axis_point_mm: Vector | None = None
    """A point on the axis of the cylinder."""
    axis: Direction | None = None
    """The cylinder's axis, which is up."""

    @model_validator(mode="after")
    def _check_mapping(self) -> _Pattern:
        round_an_axis = self.mapping == "cylinder"
        for key in ("axis_point_mm", "axis"):
            if (getattr(self, key) is not None) != round_an_axis:
                got, wanted = (
                    (Words("none"), "one") if round_an_axis else (getattr(self, key), "none")
                )
                raise fault(key, f"with mapping {self.mapping!r}", got, wanted)
        if self.axis is not None and not norm(self.axis) > 0:
            raise fault("axis", "has no direction", self.axis, "a vector that isn't zero")
        if self.mapping == "unfold" and not isinstance(self, SpeckleTable):
            raise fault("mapping", "a pattern with places", Words("unfold"), "plane or cylinder")
        return self

    @model_validator(mode="after")
    def _check_up(self) -> _Pattern:
        if self.up is None:
            return self
        if not norm(self.up) > 0:
            raise fault("up", "has no direction", self.up, "a vector that isn't zero")
        normal = self.where.normal
        if normal is not None and parallel(self.up, [float(axis == normal[1]) for axis in "xyz"]):
            raise fault("up", f"stands along the normal {normal}", self.up, "a vector across it")
        return self


class PlainTable(_Paint):
    """One even colour."""

    type: Literal["plain"]


class LineTable(Table):
    """Positions at equal distances on a straight line, both ends included."""

    start_mm: Vector
    end_mm: Vector
    count: Annotated[int, Field(ge=2, le=100_000)]


class MarkersTable(_Pattern):
    """Square markers of 2x2 black and white fields, dark at the lower left and upper right."""

    type: Literal["markers"]
    size_mm: Length
    """The side of the whole marker."""
    positions_mm: Annotated[list[Vector], Field(min_length=1)] | None = None
    """Their centres; or give line."""
    line: LineTable | None = None
    dark: Albedo = 0.04
    light: Albedo = 0.9

    @model_validator(mode="after")
    def _check(self) -> MarkersTable:
        if (self.positions_mm is None) == (self.line is None):
            got = Words("neither" if self.line is None else "both")
            raise fault(
                "positions_mm",
                "where the markers are must be said once",
                got,
                "positions_mm or line",
            )
        if self.line is not None:
            step = [b - a for a, b in zip(self.line.start_mm, self.line.end_mm, strict=True)]
            if not norm(step) >= (self.line.count - 1) * self.size_mm:
                got = Words(f"{self.line.count} of {self.size_mm:g} mm on {norm(step):g} mm")
                wanted = f"a line of at least {self.line.count - 1} sizes"
                raise fault("line", "the markers overlap", got, wanted)
        return self

    def centres_mm(self) -> list[list[float]]:
        """Every centre, lines resolved."""
        if self.positions_mm is not None:
            return self.positions_mm
        assert self.line is not None  # _check made sure
        a, b, last = self.line.start_mm, self.line.end_mm, self.line.count - 1
        # (a (last - i) + b i) / last hits both ends exactly
        return [
            [(p * (last - i) + q * i) / last for p, q in zip(a, b, strict=True)]
            for i in range(last + 1)
        ]


class CheckerTable(_Pattern):
    """A chessboard; the field at its lower left corner is dark."""

    type: Literal["checker"]
    cell_mm: Length
    columns: Count
    rows: Count
    origin_mm: Vector
    """The lower left corner of the board, seen from outside."""
    dark: Albedo = 0.04
    light: Albedo = 0.9


class DotsTable(_Pattern):
    """A regular grid of round dots."""

    type: Literal["dots"]
    diameter_mm: Length
    pitch_mm: Length
    columns: Count
    rows: Count
    origin_mm: Vector
    """The centre of the dot at the lower left, seen from outside."""
    dot: Albedo = 0.04

    @model_validator(mode="after")
    def _check(self) -> DotsTable:
        if not self.diameter_mm <= self.pitch_mm:
            raise fault("pitch_mm", "the dots overlap", self.pitch_mm, f">= {self.diameter_mm}")
        return self


class SpeckleTable(_Pattern):
    """Round speckles at random places, sprayed or printed, as image correlation needs them.

    About 3 to 6 px wide in the image, half of the area covered, and edges at least half a pixel
    soft is what correlates well.
    """

    type: Literal["speckle"]
    diameter_mm: Length
    """The mean diameter."""
    coverage: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """The painted share of the area."""
    softness_mm: Annotated[float, Field(ge=0)] = 0.0
    """The standard deviation of the edges' profile; 0 is a hard edge."""
    size_law: Literal["fixed", "uniform", "lognormal"] = "fixed"
    """How the diameters are distributed."""
    spread: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the diameters over their mean."""
    arrangement: Literal["random", "grid"] = "random"
    """Sprayed speckles overlap; those on a grid are moved at random as far as none touches."""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    """Another seed, another pattern."""
    dot: Albedo = 0.05
    """Of the speckles."""

    @model_validator(mode="after")
    def _check(self) -> SpeckleTable:
        if not self.softness_mm <= self.diameter_mm / 2:
            raise fault(
                "softness_mm", "more than half the diameter", self.softness_mm,
                f"at most {self.diameter_mm / 2:g}",
            )  # fmt: skip
        most = {"fixed": 0.0, "uniform": 0.5, "lognormal": 1.0}[self.size_law]
        if not self.spread <= most:
            wanted = f"0 to {most:g} with size_law {self.size_law!r}"
            raise fault("spread", "too much", self.spread, wanted)
        if self.arrangement == "grid":
            deviation = log1p(self.spread**2)
            largest = {
                "fixed": 1.0,
                "uniform": 1.0 + sqrt(3.0) * self.spread,
                "lognormal": exp(3.0 * sqrt(deviation) - 0.5 * deviation),
            }[self.size_law]
            # discs of a hexagonal grid touch at a share of pi / sqrt(12)
            full = pi / sqrt(12.0) * (1.0 + self.spread**2) / largest**2
            if not self.coverage <= full:
                raise fault(
                    "coverage", "the largest speckles would touch", self.coverage,
                    f"at most {full:.3g} on a grid",
                )  # fmt: skip
        return self


class ImageTable(_Pattern):
    """A picture: its grey values are albedo, its pixels squares on the surface."""

    type: Literal["image"]
    file: Annotated[str, Field(min_length=1)]
    """PNG or TIFF, 8 or 16 bit; relative to the scene file."""
    texel_mm: Length
    """Side of a pixel of the picture on the surface."""
    origin_mm: Vector
    """The lower left corner of the picture, seen from outside."""
    dark: Albedo = 0.0
    """Of the value 0."""
    light: Albedo = 1.0
    """Of the largest value."""
    gamma: Literal["linear", "srgb"] = "linear"
    """How the file's values are coded."""


class _Places(_Pattern):
    positions_mm: Annotated[list[Vector], Field(min_length=1)]
    """Their centres."""
    dark: Albedo = 0.05
    light: Albedo = 0.9


class CirclesTable(_Places):
    """Concentric circles: the largest is dark, then light and dark alternate."""

    type: Literal["circles"]
    diameters_mm: Annotated[list[Length], Field(min_length=1)]
    """From the largest to the smallest."""

    @model_validator(mode="after")
    def _check(self) -> CirclesTable:
        sizes = self.diameters_mm
        if any(not a > b for a, b in pairwise(sizes)):
            raise fault("diameters_mm", "don't fall", sizes, "the largest first")
        return self


class StarTable(_Places):
    """Siemens stars: dark spokes as wide as the light gaps between them."""

    type: Literal["star"]
    diameter_mm: Length
    spokes: Annotated[int, Field(ge=2, le=1000)] = 36


class ArucoTable(_Places):
    """ArUco or AprilTag markers; the ground around them has to be light."""

    type: Literal["aruco"]
    size_mm: Length
    """Side of the dark square."""
    ids: list[Annotated[int, Field(ge=0)]]
    """One number per position."""
    dictionary: str = "4X4_50"
    """OpenCV's name without DICT_: 4X4_50, 6X6_250, APRILTAG_36h11, ..."""

    @model_validator(mode="after")
    def _check(self) -> ArucoTable:
        if len(self.ids) != len(self.positions_mm):
            wanted = f"{len(self.positions_mm)}, as many as positions_mm"
            raise fault("ids", "not one per position", len(self.ids), wanted)
        return self


class RingCodesTable(_Pattern):
    """Coded targets of photogrammetry: a disc, and around it a ring of light and dark bits."""

    type: Literal["ring_codes"]
    positions_mm: Annotated[list[Vector], Field(min_length=1)]
    """Their centres."""
    codes: list[Annotated[int, Field(ge=0)]]
    """One number per position; bit k fills the k-th sector, counter-clockwise from the surface's
    horizontal."""
    diameter_mm: Length
    """Of the disc; the ring reaches from twice to three times as far."""
    bits: Annotated[int, Field(ge=3, le=20)] = 12
    """Sectors of the ring."""
    dot: Albedo = 0.9
    """Of the disc and of bits that are set; the ground (``albedo``) is darker, or lighter."""

    @model_validator(mode="after")
    def _check(self) -> RingCodesTable:
        if len(self.codes) != len(self.positions_mm):
            wanted = f"{len(self.positions_mm)}, as many as positions_mm"
            raise fault("codes", "not one per position", len(self.codes), wanted)
        if not max(self.codes) < 1 << self.bits:
            raise fault("codes", f"more than {self.bits} bits", max(self.codes),
                        f"at most {(1 << self.bits) - 1}")  # fmt: skip
        return self


class CharucoTable(_Pattern):
    """OpenCV's ChArUco board: a chessboard with a marker in every light square."""

    type: Literal["charuco"]
    square_mm: Length
    marker_mm: Length
    """Side of the markers, less than that of the squares."""
    columns: Count
    rows: Count
    origin_mm: Vector
    """The lower left corner of the board, seen from outside."""
    dictionary: str = "4X4_50"
    dark: Albedo = 0.05
    light: Albedo = 0.9

    @model_validator(mode="after")
    def _check(self) -> CharucoTable:
        if not self.marker_mm < self.square_mm:
            raise fault("marker_mm", "no margin", self.marker_mm, f"less than {self.square_mm:g}")
        return self


class LinesTable(_Pattern):
    """Lines at equal distances, along the surface's horizontal, its up direction, or both."""

    type: Literal["lines"]
    pitch_mm: Length
    width_mm: Length
    along: Literal["both", "across", "up"] = "both"
    columns: Count
    rows: Count
    """Pitches of the grid."""
    origin_mm: Vector
    """The crossing at the lower left, seen from outside."""
    line: Albedo = 0.05

    @model_validator(mode="after")
    def _check(self) -> LinesTable:
        if not self.width_mm < self.pitch_mm:
            raise fault("width_mm", "no gaps", self.width_mm, f"less than {self.pitch_mm:g}")
        return self


PatternTable = (
    MarkersTable
    | CheckerTable
    | DotsTable
    | SpeckleTable
    | ImageTable
    | CirclesTable
    | StarTable
    | ArucoTable
    | RingCodesTable
    | CharucoTable
    | LinesTable
)
PaintTable = Annotated[PlainTable | PatternTable, Field(discriminator="type")]
