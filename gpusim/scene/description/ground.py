"""What every paint says: where it is, how its ground shines, and how a pattern lies on faces."""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt
from typing import Annotated, Any, ClassVar, Literal, cast

from pydantic import Field, model_validator

from gpusim.scene.tables.colors import SceneColor, Shade
from gpusim.scene.tables.finishes import FINISHES, FinishName
from gpusim.scene.tables.table import (
    Direction,
    Length,
    Name,
    Seed,
    Share,
    Table,
    Vec3,
    Vector,
    Words,
    fault,
    in_si,
    name_and_unit,
    parallel,
)

from .analysis.loads import WhereTable

_STEEPEST = 0.35
_PLACES = {"positions_mm", "origin_mm", "path"}


class PaintedTable(Table):
    """How the ground shines. Markers, fields, dots and targets on it are matte prints; speckle and
    pictures shine with their ground, as under a varnish."""

    named: Annotated[FinishName | None, Field(alias="finish")] = None
    """Gives albedo, roughness, metallic and bump, each of which may be said otherwise beside it."""
    roughness: Share = 1.0
    """1: matte. Less: glossy, lacquer at about 0.3, brushed steel (with metallic) at 0.4."""
    metallic: Share = 0.0
    """1: bare metal, which mirrors with its albedo and has no colour of its own below."""
    bump_um: Annotated[float, Field(ge=0)] = 0.0
    """RMS height of a fine relief (orange peel, grain, scratches); 0: smooth. It turns normals and
    moves with the material; outlines and shadows stay those of the smooth surface."""
    bump_length_mm: Length = 0.5
    """Over which the relief changes: its correlation is 1/e there."""
    bump_along: Direction | None = None
    """Direction of longer waves, as of brushing, on the unloaded shape."""
    bump_stretch: Annotated[float, Field(ge=1, le=1e4)] = 1.0
    """How many times longer they are in that direction."""
    bump_seed: Seed = 0
    """Another seed, another relief."""
    name: Name
    """What [[measure]] and --set call it; unique among the paints of bodies, or of props."""
    where: WhereTable = WhereTable()
    """The faces; without it all."""
    albedo_: Annotated[Shade | None, Field(alias="albedo")] = None
    """Of the ground, outside the pattern; red, green and blue are linear, "#rrggbb" is sRGB."""
    color: Shade | None = None
    """The same by another name: give one of them."""

    @property
    def albedo(self) -> SceneColor:
        """Of the ground, by either name."""
        return cast(SceneColor, self.color if self.albedo_ is None else self.albedo_)

    @model_validator(mode="after")
    def _check_albedo(self) -> PaintedTable:
        if self.albedo_ is None and self.color is None:
            wanted = "a number from 0 to 1, or a colour (of the ground, outside the pattern)"
            raise fault("albedo", "missing", Words("neither albedo nor color"), wanted)
        if self.albedo_ is not None and self.color is not None:
            raise fault("color", "beside albedo, which is the same", self.color, "one of them")
        return self

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, given: Any) -> Any:
        name = given.get("finish") if isinstance(given, dict) else None
        finish = FINISHES.get(name) if isinstance(name, str) else None
        return finish.filled(given) if finish else given

    @model_validator(mode="after")
    def _check_bump(self) -> PaintedTable:
        slope = sqrt(2.0) * self.bump_um * 1e-3 / self.bump_length_mm
        if not slope <= _STEEPEST:
            expected = f"at most {_STEEPEST / sqrt(2.0) * self.bump_length_mm * 1e3:.3g}"
            raise fault("bump_um", "too steep for a fine relief", self.bump_um, expected)
        if (self.bump_stretch != 1.0) != (self.bump_along is not None):
            got = Words("none") if self.bump_along is None else self.bump_along
            raise fault("bump_along", "goes with bump_stretch", got, "both or neither")
        return self


class PatternedTable(PaintedTable):
    """A pattern that is drawn by the class of its ``type`` in `gpusim.surface.paint`: its own keys
    are that class's parameters, by their names without unit unless ``called`` otherwise there."""

    type: str
    up: Direction | None = None
    """Roughly up on the surface; without it +z, on horizontal faces +y."""
    mapping: Literal["plane", "cylinder", "unfold", "uv"] = "plane"
    """How the pattern lies on the faces: "plane" faces only; round a "cylinder"; "unfold": laid on
    any faces as if they were unfolded, without smearing in holes and on sides (speckle only); "uv":
    by the texture coordinates of the prop's file (pictures only)."""
    axis_point_mm: Vector | None = None
    """A point on the axis of the cylinder."""
    axis: Direction | None = None
    """The cylinder's axis, which is up."""
    called: ClassVar[Mapping[str, str]] = {}
    unfolds: ClassVar[bool] = False
    has_texels: ClassVar[bool] = False

    @property
    def places(self) -> tuple[Vec3, ...]:
        """Centres, or the one lower left corner (m)."""
        corner = getattr(self, "origin", None)
        return getattr(self, "positions", ()) if corner is None else (corner,)

    @property
    def values(self) -> dict[str, Any]:
        """Parameters of the class that draws it, but for where and how it shines, in SI."""
        own = set(type(self).model_fields) - set(PatternedTable.model_fields) - _PLACES
        names = {self.called.get(key, name_and_unit(key)[0]): key for key in sorted(own)}
        values = {
            name: in_si(getattr(self, key), name_and_unit(key)[1]) for name, key in names.items()
        }
        return {**values, "ground": self.albedo}

    @model_validator(mode="after")
    def _check_mapping(self) -> PatternedTable:
        round_an_axis = self.mapping == "cylinder"
        for key in ("axis_point_mm", "axis"):
            if (getattr(self, key) is not None) != round_an_axis:
                got, wanted = (
                    (Words("none"), "one") if round_an_axis else (getattr(self, key), "none")
                )
                raise fault(key, f"with mapping {self.mapping!r}", got, wanted)
        if self.mapping == "unfold" and not self.unfolds:
            raise fault("mapping", "a pattern with places", Words("unfold"), "plane or cylinder")
        if self.mapping == "uv" and not self.has_texels:
            raise fault("mapping", "no picture", Words("uv"), 'another, or type = "image"')
        return self

    @model_validator(mode="after")
    def _check_up(self) -> PatternedTable:
        if self.up is None:
            return self
        normal = self.where.normal
        x, y, z = (float(normal is not None and axis == normal[1]) for axis in "xyz")
        if normal is not None and parallel(self.up, (x, y, z)):
            raise fault("up", f"stands along the normal {normal}", self.up, "a vector across it")
        return self
