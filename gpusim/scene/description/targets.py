"""Targets of photogrammetry and of lens tests, as ``[[body.paint]]`` and ``[[prop.paint]]``."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from .colors import Shade
from .ground import PatternedTable
from .table import Count, Length, Listed, Vec3, Vector, fault

Places = Annotated[tuple[Vector, ...], Listed(1)]
Codes = Annotated[tuple[Annotated[int, Field(ge=0)], ...], Listed()]


def _one_each(key: str, values: tuple[int, ...], places: tuple[Vec3, ...]) -> None:
    if len(values) != len(places):
        expected = f"{len(places)}, as many as positions_mm"
        raise fault(key, "not one per position", len(values), expected)


class _Centred(PatternedTable):
    positions_mm: Places
    """Their centres."""
    dark: Shade = 0.05
    light: Shade = 0.9


class CirclesTable(_Centred):
    """Concentric circles: the largest is dark, then light and dark alternate."""

    type: Literal["circles"]
    diameters_mm: Annotated[tuple[Length, ...], Listed(1)]
    """From the largest to the smallest."""

    @model_validator(mode="after")
    def _check(self) -> CirclesTable:
        sizes = self.diameters_mm
        if any(not a > b for a, b in pairwise(sizes)):
            raise fault("diameters_mm", "don't fall", sizes, "the largest first")
        return self


class StarTable(_Centred):
    """Siemens stars: dark spokes as wide as the light gaps between them."""

    type: Literal["star"]
    diameter_mm: Length
    spokes: Annotated[int, Field(ge=2, le=1000)] = 36


class ArucoTable(_Centred):
    """ArUco or AprilTag markers; the ground around them has to be light."""

    type: Literal["aruco"]
    size_mm: Length
    """Side of the dark square."""
    ids: Codes
    """One number per position."""
    dictionary: str = "4X4_50"
    """OpenCV's name without DICT_: 4X4_50, 6X6_250, APRILTAG_36h11, ..."""

    @model_validator(mode="after")
    def _check(self) -> ArucoTable:
        _one_each("ids", self.ids, self.positions_mm)
        return self


class RingCodesTable(PatternedTable):
    """Coded targets of photogrammetry: a disc, and around it a ring of light and dark bits."""

    type: Literal["ring_codes"]
    positions_mm: Places
    """Their centres."""
    codes: Codes
    """One number per position; bit k fills the k-th sector, counter-clockwise from the surface's
    horizontal."""
    diameter_mm: Length
    """Of the disc; the ring reaches from twice to three times as far."""
    bits: Annotated[int, Field(ge=3, le=20)] = 12
    """Sectors of the ring."""
    dot: Shade = 0.9
    """Of the disc and of bits that are set; the ground (``albedo``) is darker, or lighter."""

    @model_validator(mode="after")
    def _check(self) -> RingCodesTable:
        _one_each("codes", self.codes, self.positions_mm)
        if not max(self.codes) < 1 << self.bits:
            raise fault("codes", f"more than {self.bits} bits", max(self.codes),
                        f"at most {(1 << self.bits) - 1}")  # fmt: skip
        return self


class CharucoTable(PatternedTable):
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
    dark: Shade = 0.05
    light: Shade = 0.9

    @model_validator(mode="after")
    def _check(self) -> CharucoTable:
        if not self.marker_mm < self.square_mm:
            raise fault("marker_mm", "no margin", self.marker_mm, f"less than {self.square_mm:g}")
        return self


class LinesTable(PatternedTable):
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
    line: Shade = 0.05
    called = {"line": "albedo"}

    @property
    def values(self) -> dict[str, Any]:
        """Parameters of the class that draws it, in SI."""
        along = {"both": "both", "across": "s", "up": "t"}[self.along]
        return {**super().values, "along": along}

    @model_validator(mode="after")
    def _check(self) -> LinesTable:
        if not self.width_mm < self.pitch_mm:
            raise fault("width_mm", "no gaps", self.width_mm, f"less than {self.pitch_mm:g}")
        return self
