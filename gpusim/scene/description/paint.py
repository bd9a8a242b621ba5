"""``[[body.paint]]`` and ``[[prop.paint]]``: what a surface looks like.

Albedo is the diffusely reflected fraction of light, 0 to 1, grey or of red, green and blue.
Patterns lie in the plane of the faces they fall on (or as ``mapping`` says), with ``up`` (projected
into that plane) pointing up, as seen from outside. Positions are those of the unloaded shape; the
pattern moves with the material.
"""

from __future__ import annotations

from functools import cached_property
from math import exp, log1p, pi, sqrt
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field, model_validator

from gpusim.scene.tables.colors import Shade
from gpusim.scene.tables.table import (
    Count,
    Length,
    Listed,
    Seed,
    Table,
    Vec3,
    Vector,
    Words,
    between,
    fault,
    in_si,
    norm,
)

from .ground import PaintedTable, PatternedTable
from .targets import (
    ArucoTable,
    CharucoTable,
    CirclesTable,
    LinesTable,
    RingCodesTable,
    StarTable,
)


class PlainTable(PaintedTable):
    """One even colour.

    Example::

        name = "steel"
        type = "plain"
        finish = "brushed steel"
    """

    type: Literal["plain"]


class LineTable(Table):
    """Positions at equal distances on a straight line, both ends included.

    Example::

        start_mm = [10.0, 0.0, 5.0]
        end_mm = [190.0, 0.0, 5.0]
        count = 7
    """

    start_mm: Vector
    """Centre of the first."""
    end_mm: Vector
    """Centre of the last."""
    count: Annotated[int, Field(ge=2, le=100_000)]
    """How many, both ends included."""


class Marker(NamedTuple):
    """One marker: its own name and its centre (m) on the unloaded shape."""

    name: str
    position: Vec3


class MarkersTable(PatternedTable):
    """Square markers of 2x2 black and white fields, dark at the lower left and upper right.

    Example::

        name = "side"
        type = "markers"
        where = { normal = "-y" }
        albedo = 0.4
        size_mm = 8.0
        line = { start_mm = [10.0, 0.0, 5.0], end_mm = [190.0, 0.0, 5.0], count = 7 }
    """

    type: Literal["markers"]
    size_mm: Length
    """The side of the whole marker."""
    positions_mm: Annotated[tuple[Vector, ...], Listed(1)] | None = None
    """Their centres; or give line."""
    line: LineTable | None = None
    """Their centres at equal distances on a straight line, in place of positions_mm."""
    dark: Shade = 0.04
    """Albedo of the dark fields."""
    light: Shade = 0.9
    """Albedo of the light fields."""

    @model_validator(mode="after")
    def _check(self) -> MarkersTable:
        if (self.positions_mm is None) == (self.line is None):
            got = Words("neither" if self.line is None else "both")
            expected = "positions_mm or line"
            raise fault("positions_mm", "where the markers are must be said once", got, expected)
        if self.line is not None:
            step = between(self.line.start_mm, self.line.end_mm)
            if not norm(step) >= (self.line.count - 1) * self.size_mm:
                got = Words(f"{self.line.count} of {self.size_mm:g} mm on {norm(step):g} mm")
                wanted = f"a line of at least {self.line.count - 1} sizes"
                raise fault("line", "the markers overlap", got, wanted)
        return self

    @property
    def places(self) -> tuple[Vec3, ...]:
        """Their centres (m)."""
        return tuple(marker.position for marker in self.markers)

    @property
    def values(self) -> dict[str, Any]:
        """Parameters of the class that draws it, in SI."""
        values = super().values
        del values["line"]  # as `places`
        return values

    def centres_mm(self) -> tuple[Vec3, ...]:
        """Every centre, lines resolved."""
        if self.positions_mm is not None:
            return self.positions_mm
        assert self.line is not None  # _check made sure
        ends, last = (self.line.start_mm, self.line.end_mm), self.line.count - 1
        # (a (last - i) + b i) / last hits both ends exactly
        x, y, z = (
            [(a * (last - i) + b * i) / last for i in range(last + 1)]
            for a, b in zip(*ends, strict=True)
        )
        return tuple(zip(x, y, z, strict=True))

    @cached_property
    def markers(self) -> tuple[Marker, ...]:
        """Each with its own name, numbered from 1 on."""
        centres = self.centres_mm()
        digits = max(2, len(str(len(centres))))
        return tuple(
            Marker(f"{self.name}-{number:0{digits}d}", in_si(centre, "mm"))
            for number, centre in enumerate(centres, start=1)
        )


class CheckerTable(PatternedTable):
    """A chessboard; the field at its lower left corner is dark.

    Example::

        name = "fields"
        type = "checker"
        albedo = 0.9
        cell_mm = 15.0
        columns = 9
        rows = 8
        origin_mm = [0.0, 0.0, 0.0]
    """

    type: Literal["checker"]
    cell_mm: Length
    """Side of a field."""
    columns: Count
    """Fields in a row."""
    rows: Count
    """Rows of fields."""
    origin_mm: Vector
    """The lower left corner of the board, seen from outside."""
    dark: Shade = 0.04
    """Albedo of the dark fields."""
    light: Shade = 0.9
    """Albedo of the light fields."""
    called = {"cell_mm": "size"}


class DotsTable(PatternedTable):
    """A regular grid of round dots.

    Example::

        name = "dots"
        type = "dots"
        where = { normal = "+z" }
        albedo = 0.85
        diameter_mm = 1.0
        pitch_mm = 2.0
        columns = 30
        rows = 12
        origin_mm = [2.0, -11.0, 6.0]
    """

    type: Literal["dots"]
    diameter_mm: Length
    """Of a dot."""
    pitch_mm: Length
    """From one dot's centre to the next."""
    columns: Count
    """Dots in a row."""
    rows: Count
    """Rows of dots."""
    origin_mm: Vector
    """The centre of the dot at the lower left, seen from outside."""
    dot: Shade = 0.04
    """Albedo of the dots."""
    called = {"dot": "albedo"}

    @model_validator(mode="after")
    def _check(self) -> DotsTable:
        if not self.diameter_mm <= self.pitch_mm:
            raise fault("pitch_mm", "the dots overlap", self.pitch_mm, f">= {self.diameter_mm}")
        return self


class SpeckleTable(PatternedTable):
    """Round speckles at random places, sprayed or printed, as image correlation needs them.

    About 3 to 6 px wide in the image, half of the area covered, and edges at least half a pixel
    soft is what correlates well.

    Example::

        name = "speckle"
        type = "speckle"
        where = { normal = "-y" }
        albedo = 0.8
        diameter_mm = 0.4
        coverage = 0.5
        softness_mm = 0.05
        spread = 0.3
        seed = 1
    """

    unfolds: ClassVar[bool] = True
    type: Literal["speckle"]
    diameter_mm: Length
    """The mean diameter."""
    coverage: Annotated[float, Field(gt=0, lt=1)] = 0.5
    """The painted share of the area."""
    softness_mm: Annotated[float, Field(ge=0)] = 0.0
    """The standard deviation of the edges' profile; 0 is a hard edge."""
    spread: Annotated[float, Field(ge=0)] = 0.0
    """Standard deviation of the diameters over their mean: 0 makes all equal; 0.4 looks sprayed."""
    size_law: Literal["fixed", "uniform", "lognormal"] = "lognormal"
    """How the diameters are spread: as a spray's drops are ("lognormal"), or evenly."""
    arrangement: Literal["random", "grid"] = "random"
    """Sprayed speckles overlap; those on a grid are moved at random as far as none touches."""
    seed: Seed = 0
    """Another seed, another pattern."""
    dot: Shade = 0.05
    """Of the speckles."""

    @model_validator(mode="after")
    def _check(self) -> SpeckleTable:
        if not self.softness_mm <= self.diameter_mm / 2:
            expected = f"at most {self.diameter_mm / 2:g}"
            raise fault("softness_mm", "more than half the diameter", self.softness_mm, expected)
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
                expected = f"at most {full:.3g} on a grid"
                raise fault("coverage", "the largest speckles would touch", self.coverage, expected)
        return self


class PictureTable(PatternedTable):
    """A picture: its values are albedo, its pixels squares on the surface.

    Example::

        name = "photo"
        type = "image"
        albedo = 0.5
        file = "speckle.png"
        texel_mm = 0.05
        origin_mm = [0.0, 0.0, 0.0]
    """

    has_texels: ClassVar[bool] = True
    type: Literal["image"]
    path: Annotated[str | None, Field(min_length=1, alias="file")] = None
    """PNG or TIFF, 8 or 16 bit; relative to the scene file. With mapping "uv" it may be left out:
    then each face has the picture, or the plain colour, of its material in the prop's file."""
    texel_mm: Length | None = None
    """Side of a pixel of the picture on the surface; none with mapping "uv"."""
    origin_mm: Vector | None = None
    """The lower left corner of the picture, seen from outside; none with mapping "uv"."""
    dark: Shade = 0.0
    """Of the value 0."""
    light: Shade = 1.0
    """Of the largest value."""
    gamma: Literal["linear", "srgb"] = "linear"
    """How the file's values are coded."""
    channels: Literal["rgb", "grey"] = "rgb"
    """"rgb": a file in colour is paint in colour; "grey": its brightness (luma) alone counts."""

    @model_validator(mode="after")
    def _check(self) -> PictureTable:
        by_uv = self.mapping == "uv"
        for key, value in (("texel_mm", self.texel_mm), ("origin_mm", self.origin_mm)):
            if (value is not None) == by_uv:
                got, wanted = (value, "none") if by_uv else (Words("none"), "one")
                raise fault(key, f"with mapping {self.mapping!r}", got, wanted)
        if self.path is None and not by_uv:
            raise fault("file", "missing", Words("none"), "a PNG or TIFF")
        return self


def not_by_uv(paints: tuple[Paint, ...]) -> None:
    """Refuse pictures by texture coordinates where there are none."""
    for number, paint in enumerate(paints):
        if isinstance(paint, PictureTable) and paint.mapping == "uv":
            wanted = "another, or a [[prop]] of an .obj, .glb or .gltf"
            expected = f"paint.{number}.mapping", "only a prop's file has texture coordinates"
            raise fault(*expected, Words("uv"), wanted)


Target = CirclesTable | StarTable | ArucoTable | RingCodesTable | CharucoTable | LinesTable
Pattern = MarkersTable | CheckerTable | DotsTable | SpeckleTable | PictureTable | Target
Paint = PlainTable | Pattern
PaintTable = Annotated[Paint, Field(discriminator="type")]
