"""``[[body.support]]``, ``[[body.load]]``: what holds and moves a body, and ``where``."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from gpusim.scene.tables.table import (
    Axis,
    Direction,
    Listed,
    Name,
    SignedAxis,
    Table,
    Vec3,
    Vector,
    Words,
    fault,
)

Amplitude = tuple[float, ...]
Factors = Annotated[Amplitude, Listed(1, 10_000)]


class WhereTable(Table):
    """All given conditions hold together; positions are those of the unloaded shape.

    Example::

        x_min_mm = 150.0
        x_max_mm = 200.0
        normal = "+z"
    """

    set: Annotated[str, Field(min_length=1, max_length=200)] | None = None
    """A named set of the mesh."""
    x_min_mm: float | None = None
    """Smallest x that is selected; a face counts if all its nodes are inside."""
    x_max_mm: float | None = None
    """Largest x that is selected."""
    y_min_mm: float | None = None
    """Smallest y that is selected."""
    y_max_mm: float | None = None
    """Largest y that is selected."""
    z_min_mm: float | None = None
    """Smallest z that is selected."""
    z_max_mm: float | None = None
    """Largest z that is selected."""
    normal: SignedAxis | None = None
    """Faces that look this way, up to 30 degrees from it: of the wall of a hole or a rounding, too,
    what does; a ``set`` takes a whole face and no other. For nodes: the nodes of such faces."""
    tolerance_mm: Annotated[float, Field(ge=0)] = 0.001
    """How far outside the bounds still counts as inside."""

    @property
    def is_everything(self) -> bool:
        """Whether no condition is given at all."""
        return not self.model_fields_set - {"tolerance_mm"}

    @property
    def lower(self) -> Vec3:
        """Smallest x, y, z (m); -inf where nothing was asked."""
        return self._bounds("min", float("-inf"))

    @property
    def upper(self) -> Vec3:
        """Largest x, y, z (m); inf where nothing was asked."""
        return self._bounds("max", float("inf"))

    def _bounds(self, end: str, without: float) -> Vec3:
        given = (getattr(self, f"{axis}_{end}_mm") for axis in "xyz")
        x, y, z = (without if value is None else value / 1000.0 for value in given)
        return x, y, z

    @model_validator(mode="after")
    def _check(self) -> WhereTable:
        for axis in "xyz":
            low, high = getattr(self, f"{axis}_min_mm"), getattr(self, f"{axis}_max_mm")
            if low is not None and high is not None and not low <= high:
                expected = "min <= max"
                raise fault(f"{axis}_min_mm", "empty range", Words(f"{low} to {high}"), expected)
        return self


class _Driven(Table):
    """What is scaled from frame to frame, by factors of its own or by those of the analysis."""

    if TYPE_CHECKING:  # where it stands among a table's keys is for the table to say
        amplitude_: Factors | None

    _of_analysis: Amplitude = ()

    @property
    def amplitude(self) -> Amplitude:
        """One factor per frame."""
        return self._of_analysis if self.amplitude_ is None else self.amplitude_

    def driven(self, factors: Amplitude) -> None:
        """Enter the load factors of the analysis."""
        self._of_analysis = factors

    def undriven(self) -> Self:
        """The same at amplitude 1, whatever the frames have."""
        varied = {"amplitude_", "times_s"} & {*type(self).model_fields}
        copy = self.model_copy(update=dict.fromkeys(varied))
        copy._of_analysis = ()
        return copy


class SupportTable(_Driven):
    """Nodes that are held, or moved by a given amount.

    Example::

        name = "clamp"
        where = { set = "x_min" }
        fix = ["x", "y", "z"]
    """

    name: Name
    """What messages and --set call it."""
    type: Literal["fixed", "symmetry"] = "fixed"
    """"symmetry": flat faces don't move along their normal, which is x, y or z."""
    where: WhereTable
    """The nodes that are held: say a set, a bound or a normal."""
    fix: Annotated[tuple[Axis, ...], Listed(1, 3, different=True)] = ("x", "y", "z")
    """The directions in which the nodes are held; without it all three."""
    displacement_mm: Vector = (0.0, 0.0, 0.0)
    """Where they are held, relative to the unloaded shape; scaled by the load factor."""
    amplitude_: Annotated[Factors | None, Field(alias="amplitude")] = None
    """One factor per frame for displacement_mm; without it the analysis' load_factors."""

    @model_validator(mode="after")
    def _check(self) -> SupportTable:
        if self.where.is_everything:
            expected = "a set, a bound or a normal"
            raise fault("where", "selects the whole body", Words("{}"), expected)
        if self.amplitude_ is not None and not any(self.displacement_mm):
            raise fault("amplitude", "of a support that doesn't move", self.amplitude_,
                        "a displacement_mm that isn't zero")  # fmt: skip
        if self.type == "symmetry":
            for key in ("fix", "displacement_mm"):
                if getattr(self, key) != type(self).model_fields[key].default:
                    raise fault(key, "given for a symmetry support", getattr(self, key),
                                "none: the faces say the direction")  # fmt: skip
            return self
        for axis, value in zip("xyz", self.displacement_mm, strict=True):
            if value != 0 and axis not in self.fix:
                problem = f"moves along {axis}, which fix leaves free"
                raise fault("displacement_mm", problem, self.fix, f'fix with "{axis}" in it')
        return self


class TieTable(Table):
    """Nodes that follow faces as if glued to them: parts of one mesh that touch without sharing
    nodes.

    Example::

        name = "joint"
        faces = { set = "base_top" }
        nodes = { set = "rib_bottom" }
    """

    name: Name
    """What messages and --set call it."""
    faces: WhereTable
    """The faces that are followed; let them be those of the coarser mesh."""
    nodes: WhereTable
    """The nodes that follow; each is given the displacement of the nearest point of the faces."""
    tolerance_mm: Annotated[float, Field(gt=0)] | None = None
    """How far off the faces a node may lie; without it 0.025 of the size of its face."""


class _Load(_Driven):
    name: Name
    """What messages and --set call it."""
    amplitude_: Annotated[Factors | None, Field(alias="amplitude")] = None
    """One factor per frame for this load; without it the analysis' load_factors. Of a transient
    analysis linear in between, and 1 without it."""
    times_s: Factors | None = None
    """Of a transient analysis: the times that ``amplitude`` has its factors at, in place of the
    frames'; before and after them it stays as it is there."""

    @model_validator(mode="after")
    def _check_times(self) -> Self:
        if self.times_s is None:
            return self
        count = len(self.amplitude_ or ())
        if len(self.times_s) != count:
            raise fault("times_s", "not one per factor of amplitude",
                        Words(f"{len(self.times_s)} times"), f"{count}")  # fmt: skip
        if not all(a < b for a, b in pairwise(self.times_s)):
            raise fault("times_s", "not in their order", self.times_s, "times that increase")
        return self


class _Force(_Load):
    where: WhereTable
    """The faces (of type "nodal_force" the nodes) that it acts on."""
    force_N: Vector
    """Its x, y and z components, at load factor 1."""


class ForceTable(_Force):
    """A total force, spread evenly over the area of the faces.

    Example::

        name = "pull"
        type = "force"
        where = { set = "x_max" }
        force_N = [1000.0, 0.0, 0.0]
    """

    type: Literal["force"]


class NodalForceTable(_Force):
    """The same force on every node.

    Example::

        name = "corners"
        type = "nodal_force"
        where = { x_min_mm = 200.0, z_min_mm = 10.0 }
        force_N = [0.0, 0.0, -5.0]
    """

    type: Literal["nodal_force"]


class LineForceTable(_Load):
    """A total force, spread evenly over the length of a line of element edges.

    Example::

        name = "edge"
        type = "line_force"
        where = { x_min_mm = 200.0, z_min_mm = 10.0 }
        force_N = [0.0, 0.0, -50.0]
    """

    type: Literal["line_force"]
    where: WhereTable
    """The nodes of the line: say two bounds, or a named set."""
    force_N: Vector
    """x, y and z components of the whole, at load factor 1."""


class PressureTable(_Load):
    """A pressure on faces; positive pushes into the body.

    Example::

        name = "water"
        type = "pressure"
        where = { normal = "+z" }
        pressure_MPa = 0.1
    """

    type: Literal["pressure"]
    where: WhereTable
    """The faces that it acts on."""
    pressure_MPa: float
    """At load factor 1; negative pulls."""
    follows: bool = False
    """Whether it stays normal to the faces as they turn, on the area that they have then: of
    bodies that are solved nonlinearly."""


class TractionTable(_Load):
    """A force per area on faces.

    Example::

        name = "friction"
        type = "traction"
        where = { normal = "+z" }
        traction_MPa = [0.02, 0.0, 0.0]
    """

    type: Literal["traction"]
    where: WhereTable
    """The faces that it acts on."""
    traction_MPa: Vector
    """Its x, y and z components, at load factor 1."""


class GravityTable(_Load):
    """The body's own weight.

    Example::

        name = "weight"
        type = "gravity"
        acceleration_m_s2 = [0.0, 0.0, -9.81]
    """

    type: Literal["gravity"]
    acceleration_m_s2: Vector = (0.0, 0.0, -9.80665)
    """x, y and z components; by default the earth's, with z up."""


class CentrifugalTable(_Load):
    """Steady rotation about an axis: the body is pulled outward.

    Example::

        name = "spin"
        type = "centrifugal"
        axis_point_mm = [0.0, 0.0, 0.0]
        axis = [0.0, 0.0, 1.0]
        speed_rpm = 3000.0
    """

    type: Literal["centrifugal"]
    axis_point_mm: Vector = (0.0, 0.0, 0.0)
    """A point on the axis."""
    axis: Direction = (0.0, 0.0, 1.0)
    """Direction of the axis; its length doesn't matter."""
    speed_rpm: float
    """Turns per minute; the amplitude scales the force, not the speed."""


class ThermalTable(_Load):
    """A temperature change of the whole body; the material's expansion_per_K says what it does.

    Example::

        name = "heat"
        type = "thermal"
        temperature_change_K = 80.0
    """

    type: Literal["thermal"]
    temperature_change_K: float
    """From the unloaded shape to load factor 1."""


Load = (
    ForceTable
    | NodalForceTable
    | LineForceTable
    | PressureTable
    | TractionTable
    | GravityTable
    | CentrifugalTable
    | ThermalTable
)
LoadTable = Annotated[Load, Field(discriminator="type")]
