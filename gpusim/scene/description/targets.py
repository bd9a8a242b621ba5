"""Targets of photogrammetry and of lens tests, as ``[[body.paint]]`` and ``[[prop.paint]]``."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.colors import Shade
from gpusim.scene.tables.table import Count, Length, Listed, Vec3, Vector, fault

from .ground import PatternedTable

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
    """Albedo of what is dark."""
    light: Shade = 0.9
    """Albedo of what is light."""


class CirclesTable(_Centred):
    """Concentric circles: the largest is dark, then light and dark alternate.

    Example::

        name = "rings"
        type = "circles"
        albedo = 0.8
        positions_mm = [[10.0, 0.0, 5.0], [190.0, 0.0, 5.0]]
        diameters_mm = [8.0, 5.0, 2.0]
    """

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
    """Siemens stars: dark spokes as wide as the light gaps between them.

    Example::

        name = "star"
        type = "star"
        albedo = 0.8
        positions_mm = [[100.0, 0.0, 5.0]]
        diameter_mm = 9.0
        spokes = 72
    """

    type: Literal["star"]
    diameter_mm: Length
    """Of a star."""
    spokes: Annotated[int, Field(ge=2, le=1000)] = 36
    """Dark ones; as many gaps."""


class ArucoTable(_Centred):
    """ArUco or AprilTag markers; the ground around them has to be light.

    Example::

        name = "tags"
        type = "aruco"
        albedo = 0.9
        positions_mm = [[10.0, 0.0, 5.0], [190.0, 0.0, 5.0]]
        size_mm = 8.0
        ids = [3, 7]
        dictionary = "4X4_50"
    """

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
    """Coded targets of photogrammetry: a disc, and around it a ring of light and dark bits.

    Example::

        name = "coded"
        type = "ring_codes"
        albedo = 0.05
        positions_mm = [[10.0, 0.0, 5.0], [190.0, 0.0, 5.0]]
        codes = [91, 379]
        diameter_mm = 3.0
    """

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
    """OpenCV's ChArUco board: a chessboard with a marker in every light square.

    Example::

        name = "board"
        type = "charuco"
        albedo = 0.9
        square_mm = 30.0
        marker_mm = 22.0
        columns = 7
        rows = 5
        origin_mm = [0.0, 0.0, 0.0]
    """

    type: Literal["charuco"]
    square_mm: Length
    """Side of a field."""
    marker_mm: Length
    """Side of the markers, less than that of the squares."""
    columns: Count
    """Fields in a row."""
    rows: Count
    """Rows of fields."""
    origin_mm: Vector
    """The lower left corner of the board, seen from outside."""
    dictionary: str = "4X4_50"
    """OpenCV's name without DICT_, as for "aruco"."""
    dark: Shade = 0.05
    """Albedo of dark fields and markers."""
    light: Shade = 0.9
    """Albedo of light fields."""

    @model_validator(mode="after")
    def _check(self) -> CharucoTable:
        if not self.marker_mm < self.square_mm:
            raise fault("marker_mm", "no margin", self.marker_mm, f"less than {self.square_mm:g}")
        return self


class LinesTable(PatternedTable):
    """Lines at equal distances, along the surface's horizontal, its up direction, or both.

    Example::

        name = "grid"
        type = "lines"
        albedo = 0.85
        pitch_mm = 2.0
        width_mm = 0.4
        along = "both"
        columns = 40
        rows = 8
        origin_mm = [10.0, 0.0, 1.0]
    """

    type: Literal["lines"]
    pitch_mm: Length
    """From one line's middle to the next."""
    width_mm: Length
    """Of a line."""
    along: Literal["both", "across", "up"] = "both"
    """Which lines: those across the surface's up direction, those along it, or both."""
    columns: Count
    """Pitches of the grid in a row."""
    rows: Count
    """Pitches of the grid."""
    origin_mm: Vector
    """The crossing at the lower left, seen from outside."""
    line: Shade = 0.05
    """Albedo of the lines."""
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
