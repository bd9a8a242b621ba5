"""``[body.mesh]``, ``[[body.notch]]``, ``[body.field]``: how a body's mesh is made, or read."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import (
    Axis,
    FileUnit,
    Length,
    Listed,
    SignedAxis,
    Table,
    Vector,
    Words,
    fault,
    known_suffix,
    metres,
)

_SIDES = ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")
# What `where = { set = … }` may name, by builder; checked before a mesh is built.
SETS = {
    "box": _SIDES,
    "beam": _SIDES,
    "crane": ("foot", "load", "front", "back", "tip"),
    "plate_with_hole": ("hole", *_SIDES),
    "bracket": (
        "base", "wall", "base_hole", "wall_hole", "base_end", "wall_end", "y_min", "y_max",
    ),
}  # fmt: skip
NOTCHABLE = ("box", "beam")

# The endings that the readers know; said here too, because a plan loads no numerics.
CAD_SUFFIXES = (".step", ".stp", ".brep", ".stl")
MESH_SUFFIXES = (
    ".msh", ".inp", ".vtu", ".vtk", ".e", ".ex2", ".exo", ".exodus", ".med", ".bdf", ".nas", ".fem",
    ".dat",
)  # fmt: skip

FIELD_SUFFIXES = (".vtu", ".pvd", ".series", ".e", ".ex2", ".exo", ".exodus", ".frd", ".npz")

Count = Annotated[int, Field(ge=1, le=10_000)]
Divisions = Annotated[tuple[Count, Count, Count], Listed()]
Cells = Literal["hex8", "hex20", "hex27", "tet4", "tet10", "wedge6", "wedge15"]


class NotchRecipeTable(Table):
    """A slot cut into a box or a beam; elements get finer towards it. Its faces are the set
    "notch_1" (2, … in the order of the file).

    Example::

        position_mm = 60.0
        width_mm = 2.0
        depth_mm = 4.0
    """

    position_mm: float
    """Of its middle, along ``axis``."""
    width_mm: Length
    """Along ``axis``."""
    depth_mm: Length
    """Into the body, from ``side``."""
    axis: Axis = "x"
    """The direction along which position and width are counted."""
    side: SignedAxis = "-y"
    """The side that it is cut into; along the third axis it goes right through."""
    cells: Annotated[int, Field(ge=1, le=100)] = 2
    """Elements over its width."""

    @model_validator(mode="after")
    def _check(self) -> NotchRecipeTable:
        if self.side[1] == self.axis:
            raise fault("side", "is along the notch's axis", self.side, "a side across the axis")
        return self


class _Builder(Table):
    cells: Cells = "hex8"
    """Type of the elements: bricks are cut into tetrahedra or wedges, midside nodes are added."""


class _Notchable(_Builder):
    _notches: tuple[NotchRecipeTable, ...] = ()

    @property
    def notches(self) -> tuple[NotchRecipeTable, ...]:
        """Those of the body that the mesh is of."""
        return self._notches

    def notched(self, notches: tuple[NotchRecipeTable, ...]) -> None:
        """Enter the slots: the file has them beside the mesh."""
        self._notches = notches


class BoxMeshTable(_Notchable):
    """A block along the axes. Its sides are the sets "x_min" … "z_max".

    Example::

        builder = "box"
        size_mm = [200.0, 20.0, 10.0]
        divisions = [40, 4, 4]
    """

    builder: Literal["box"]
    size_mm: Annotated[tuple[Length, Length, Length], Listed()]
    """Along x, y and z."""
    divisions: Divisions
    """Elements along x, y, z (away from notches)."""
    origin_mm: Vector = (0.0, 0.0, 0.0)
    """The corner with the smallest x, y, z."""


class BeamMeshTable(_Notchable):
    """A bar whose axis is the x axis, from x = 0. Its sides are the sets "x_min" … "z_max".

    Example::

        builder = "beam"
        length_mm = 300.0
        width_mm = 30.0
        height_mm = 6.0
        divisions = [60, 6, 2]
    """

    builder: Literal["beam"]
    length_mm: Length
    """Along x."""
    width_mm: Length
    """Along y, from -width/2 to width/2."""
    height_mm: Length
    """Along z, from -height/2 to height/2."""
    end_width_mm: Length | None = None
    """At the far end, if it tapers."""
    end_height_mm: Length | None = None
    """At the far end, if it tapers."""
    divisions: Divisions
    """Elements along x, y, z (away from notches)."""

    @property
    def end_width(self) -> float:
        """At the far end."""
        return self.width if self.end_width_mm is None else self.end_width_mm / 1000.0

    @property
    def end_height(self) -> float:
        """At the far end."""
        return self.height if self.end_height_mm is None else self.end_height_mm / 1000.0


class CraneMeshTable(_Builder):
    """A column with a beam welded on top, of flat bars.

    The column's outer face is x = 0 and its clamped foot ends at z = 0; the beam reaches along +x
    and lies on top of the column; both are centred on y = 0. Named sets: "foot" (z <= 0), "load"
    (top of the last ``load_length_mm``), "front" (-y), "back" (+y), "tip" (the free end).

    Example::

        builder = "crane"
        element_mm = 6.0
    """

    builder: Literal["crane"]
    height_mm: Length = 562.0
    """Of the column above its foot."""
    foot_mm: Length = 70.0
    """Length of the clamped foot below z = 0."""
    length_mm: Length = 597.0
    """Of the beam, from the column's outer face."""
    column_thickness_mm: Length = 6.0
    """Of the column, along x."""
    beam_thickness_mm: Length = 4.0
    """Of the beam, along z."""
    width_mm: Length = 40.0
    """Of both members, along y."""
    load_length_mm: Length = 108.0
    """An element edge lies this far from the beam's free end."""
    element_mm: Length = 3.0
    """About the length of an element along the members."""
    through: Count = 2
    """Elements through the thickness of each member."""
    across: Count = 6
    """Elements across the width."""

    @model_validator(mode="after")
    def _check(self) -> CraneMeshTable:
        if not self.column_thickness_mm + self.load_length_mm < self.length_mm:
            expected = "more than column_thickness_mm + load_length_mm"
            raise fault("length_mm", "the beam is too short", self.length_mm, expected)
        return self


class _Holed(_Builder):
    hole_diameter_mm: Length
    """Of the round hole, or of each."""
    around: Annotated[int, Field(ge=8, le=10_000, multiple_of=4)] = 32
    """Elements around a hole."""
    radial: Count = 8
    """Elements from a hole to the square around it."""
    through: Count = 2
    """Elements through the thickness."""


class PlateMeshTable(_Holed):
    """A plate with a round hole at the origin, length along x, width along y, thickness from z = 0.

    Sets "hole" and "x_min" … "z_max". Midside nodes of hex20 and hex27 lie on the circle.

    Example::

        builder = "plate_with_hole"
        length_mm = 100.0
        width_mm = 40.0
        thickness_mm = 3.0
        hole_diameter_mm = 12.0
    """

    builder: Literal["plate_with_hole"]
    length_mm: Length
    """Along x, from -length/2 to length/2."""
    width_mm: Length
    """Along y, from -width/2 to width/2."""
    thickness_mm: Length
    """Along z, from 0."""

    @model_validator(mode="after")
    def _check(self) -> PlateMeshTable:
        room = 0.98 * min(self.length_mm, self.width_mm)
        if not self.hole_diameter_mm < room:
            expected = f"less than {room:g}"
            raise fault("hole_diameter_mm", "too wide", self.hole_diameter_mm, expected)
        return self


class BracketMeshTable(_Holed):
    """An L-bracket of bent plate with a hole in each leg, half a width from the leg's end.

    The base lies on z = 0 and reaches along +x, the wall stands on x = 0 and reaches along +z.
    Sets "base", "wall", "base_hole", "wall_hole", "base_end", "wall_end", "y_min", "y_max".

    Example::

        builder = "bracket"
        wall_height_mm = 80.0
    """

    builder: Literal["bracket"]
    base_length_mm: Length = 60.0
    """Of the base, along x, bend included."""
    wall_height_mm: Length = 80.0
    """Of the wall, along z, bend included."""
    width_mm: Length = 40.0
    """Along y, from -width/2 to width/2."""
    thickness_mm: Length = 5.0
    """Of the sheet."""
    fillet_radius_mm: Length = 6.0
    """Inner radius of the bend."""
    hole_diameter_mm: Length = 12.0
    """Of the hole in each leg."""
    radial: Count = 5
    """Elements from a hole to the square around it."""
    bend: Count = 6
    """Elements along the bend."""

    @model_validator(mode="after")
    def _check(self) -> BracketMeshTable:
        least = self.width_mm + self.fillet_radius_mm + self.thickness_mm
        for key in ("base_length_mm", "wall_height_mm"):
            value = getattr(self, key)
            if not value >= least * (1 - 1e-12):
                expected = f"at least width_mm + fillet_radius_mm + thickness_mm = {least:g}"
                raise fault(key, "the leg is too short", value, expected)
        if not self.hole_diameter_mm < 0.98 * self.width_mm:
            raise fault("hole_diameter_mm", "too wide", self.hole_diameter_mm, "less than width_mm")
        return self


class InFileUnitsTable(Table):
    unit: FileUnit = "mm"
    """Of the file's coordinates."""

    @property
    def scale(self) -> float:
        """Metres per unit of the file."""
        return metres(self.unit)


class FileMeshTable(InFileUnitsTable):
    """A mesh from a file, or a CAD file to be meshed (needs gmsh).

    Groups of the file are sets: Gmsh's physical groups, sets of Abaqus and Exodus, MED's groups;
    the faces of a CAD file are "face_1", "face_2", …

    Example::

        file = "bracket.step"
        size_mm = 2.5
        order = 2
    """

    builder: Literal["file"] = "file"
    """Needn't be said: a mesh with ``file`` is from a file."""
    path: Annotated[str, Field(min_length=1, alias="file")]
    """Relative to the scene file. A mesh: .msh, .inp, .vtu, .vtk, .e, .exo, .med, .bdf; CAD: .step,
    .brep, .stl."""
    unit: FileUnit = "mm"
    """Of the file's coordinates; those of a STEP file are always millimetres."""
    order: Annotated[int, Field(ge=1, le=2)] = 1
    """2: elements with midside nodes (straight edges, but for a CAD file's curved faces)."""
    size_mm: Length | None = None
    """Greatest element of a CAD file."""
    hexahedra: bool = False
    """Bricks only, for a CAD file."""
    hex_dominant: bool = False
    """Bricks in a CAD file's solids of six sides, tetrahedra in the others."""
    curvature: Annotated[int, Field(ge=0, le=1000)] = 0
    """Elements around a full circle, for a CAD file; 0 leaves it to ``size_mm``."""
    time_limit_s: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] = 600.0
    """After which a CAD file that isn't meshed yet is given up."""

    @property
    def is_cad(self) -> bool:
        """Whether the file has to be meshed."""
        return PurePath(self.path).suffix.lower() in CAD_SUFFIXES

    @model_validator(mode="after")
    def _check(self) -> FileMeshTable:
        suffix = known_suffix("mesh file", self.path, MESH_SUFFIXES + CAD_SUFFIXES)
        if self.is_cad and self.size_mm is None:
            raise fault("size_mm", "missing for a CAD file", Words(""), "the greatest element size")
        if suffix in (".step", ".stp") and self.unit != "mm":
            raise fault("unit", "a STEP file says its unit itself", self.unit, '"mm" or nothing')
        if suffix == ".stl" and self.curvature:
            raise fault("curvature", "of an STL's flat triangles", self.curvature, "0")
        if self.hexahedra and self.hex_dominant:
            raise fault("hex_dominant", "beside hexahedra", True, "one of them")
        for key in () if self.is_cad else ("size_mm", "hexahedra", "hex_dominant", "curvature"):
            if getattr(self, key) not in (None, False, 0):
                raise fault(key, "is for CAD files", self.path, "a .step, .brep or .stl file")
        return self


_Built = (
    BoxMeshTable
    | BeamMeshTable
    | CraneMeshTable
    | PlateMeshTable
    | BracketMeshTable
    | FileMeshTable
)
MeshTable = Annotated[_Built, Field(discriminator="builder")]


class FieldMeshTable(InFileUnitsTable):
    """Mesh and nodal displacements of a result file; nothing is solved.

    Frames between its times are interpolated linearly; a file whose first time is above 0 is taken
    to start undeformed at time 0.

    Example::

        file = "strip.frd"
    """

    path: Annotated[str, Field(min_length=1, alias="file")]
    """Relative to the scene file: .vtu (one state, time 1), .pvd or .vtu.series (one .vtu per
    time), .e/.exo (Exodus), .frd (CalculiX, text), .npz."""
    unit: FileUnit = "mm"
    """Of coordinates and displacements in the file."""
    variable: Annotated[
        Annotated[str, Field(min_length=1, max_length=200)] | None, Field(alias="displacement")
    ] = None
    """Name of the nodal variable; where it is one per axis, what the three names begin with.
    Without it one with a usual name: displacement, disp, U, DISP."""
    magnify: Annotated[Length, Field(alias="scale")] = 1.0
    """Factor on the displacements, to show them larger than they are."""

    @model_validator(mode="after")
    def _check(self) -> FieldMeshTable:
        known_suffix("result file", self.path, FIELD_SUFFIXES)
        return self


MeshRecipe = _Built | FieldMeshTable
