"""``[[prop]]`` and ``[calibration]``: rigid things, and where they are in each frame."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import (
    Direction,
    FileUnit,
    Listed,
    Name,
    Names,
    SeveralNames,
    Table,
    Vec3,
    Vector,
    Words,
    across,
    cross,
    fault,
    file_unit,
    known_suffix,
    parallel,
    unit,
)

from .mesh import MESH_SUFFIXES, InFileUnitsTable
from .paint import MarkersTable, Paint, PaintTable, not_by_uv

# Files of faces alone; said here too, because a plan loads no numerics.
SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".off", ".glb", ".gltf")
TEXTURED_SUFFIXES = (".obj", ".glb", ".gltf")

PropLength = Annotated[float, Field(gt=0, le=1e10)]


class PoseTable(Table):
    """Where a prop is: turned about its own point, which then lies at ``position_mm``.

    Example::

        position_mm = [100.0, 5.0, 20.0]
        rotation_deg = [0.0, 15.0, -20.0]
    """

    position_mm: Vector
    """Of the prop's centre (of a mesh prop: of the point that its file's origin is)."""
    rotation_deg: Vector = (0.0, 0.0, 0.0)
    """About the world's x, then y, then z axis, from how the prop is described."""


Poses = Annotated[tuple[PoseTable, ...], Listed(1, 10_000)]


class _Prop(Table):
    # it is built as described; `position` and `rotation` say how it stands, as those of a pose do,
    # and `origin` which point of it poses are about
    name: Name
    """What [calibration], [[measure]] and --set call it."""
    poses_: Annotated[Poses | None, Field(alias="poses")] = None
    """One per frame, for a prop that moves; paint and ``where`` are of the prop as described."""

    @property
    def poses(self) -> tuple[PoseTable, ...]:
        """One per frame; none where it stands still."""
        return self.poses_ or ()


class _Centred(_Prop):
    center_mm: Vector
    """Its middle."""

    @property
    def position(self) -> Vec3:
        """Where it stands (m)."""
        return self.center

    origin = position


class PlateTable(_Centred):
    """A rigid rectangular plate: a wall, a target. Only its front is seen.

    Example::

        name = "wall"
        center_mm = [100.0, 80.0, 5.0]
        normal = [0.0, -1.0, 0.0]
        size_mm = [400.0, 200.0]
        paint = [{ name = "white", type = "plain", albedo = 0.8 }]
    """

    type: Literal["plate"] = "plate"
    """Needn't be said: a prop without type is a plate."""
    rotation: ClassVar[Vec3] = (0.0, 0.0, 0.0)
    normal: Direction
    """Out of its front."""
    up: Direction = (0.0, 0.0, 1.0)
    """Roughly up on it: the direction of its height."""
    size_mm: Annotated[tuple[PropLength, PropLength], Listed()]
    """Width (across ``up``) and height, at most 1e10 mm: beyond, rounding moves what is on it."""
    paints: Annotated[tuple[PaintTable, ...], Field(alias="paint"), Listed(1, 1)]
    """One paint: a plate has one face."""

    @property
    def paint(self) -> Paint:
        """The one paint."""
        return self.paints[0]

    @model_validator(mode="after")
    def _check(self) -> PlateTable:
        if parallel(self.normal, self.up):
            raise fault("up", "is along the normal", self.up, "a vector across it")
        not_by_uv(self.paints)
        paint = self.paint
        if not paint.where.is_everything:
            raise fault("paint.0.where", "a plate has one face", Words("a selection"), "no where")
        if isinstance(paint, MarkersTable):
            self._check_markers(paint)
        return self

    def _check_markers(self, paint: MarkersTable) -> None:
        n = unit(self.normal)
        up = unit(across(self.up, n))
        right = cross(up, n)
        for index, centre in enumerate(paint.centres_mm()):
            arm = [a - b for a, b in zip(centre, self.center_mm, strict=True)]
            x, y, z = (
                sum(a * b for a, b in zip(arm, axis, strict=True)) for axis in (right, up, n)
            )
            key = "line" if paint.positions_mm is None else f"positions_mm.{index}"
            half = paint.size_mm / 2
            if not abs(z) <= 1e-3:
                raise fault(f"paint.0.{key}", f"{abs(z):g} mm off the plate", centre, "on its face")
            if not (abs(x) <= self.size_mm[0] / 2 - half and abs(y) <= self.size_mm[1] / 2 - half):
                raise fault(f"paint.0.{key}", "reaches over the plate's edge", centre, "inside")


class _Shaped(_Prop):
    rotation_deg: Vector = (0.0, 0.0, 0.0)
    """About the world's x, then y, then z axis, through the prop's own point; ``poses`` replace
    it."""
    paints: Annotated[tuple[PaintTable, ...], Field(alias="paint"), Listed(1)]
    """A face belongs to the last entry that matches it; positions are those before any rotation."""


class BoxTable(_Centred, _Shaped):
    """A rigid block: a machine's frame, a base. Its sides are the sets "x_min" … "z_max".

    Example::

        name = "base"
        type = "box"
        center_mm = [0.0, 0.0, -50.0]
        size_mm = [120.0, 80.0, 40.0]
        rotation_deg = [0.0, 0.0, 30.0]
        paint = [{ name = "iron", type = "plain", finish = "painted steel" }]
    """

    type: Literal["box"]
    size_mm: Annotated[tuple[PropLength, PropLength, PropLength], Listed()]
    """Along x, y, z, before rotation, at most 1e10 mm."""

    @model_validator(mode="after")
    def _check(self) -> BoxTable:
        not_by_uv(self.paints)
        return self


class ShapeTable(_Shaped, InFileUnitsTable):
    """A rigid thing of any shape: a mesh or a file of faces (.stl .ply .obj .off .glb .gltf).

    Example::

        name = "grip"
        type = "mesh"
        file = "grip.stl"
        position_mm = [0.0, 0.0, 120.0]
        paint = [{ name = "metal", type = "plain", finish = "brushed steel" }]
    """

    type: Literal["mesh"]
    path: Annotated[str, Field(min_length=1, alias="file")]
    """Relative to the scene file. Faces are wound counter-clockwise seen from outside."""
    unit: FileUnit = "mm"
    """Of the file's coordinates; without it those of glTF are metres, as that format says."""
    position_mm: Vector = (0.0, 0.0, 0.0)
    """Where the file's origin is."""
    origin: ClassVar[Vec3] = (0.0, 0.0, 0.0)

    @model_validator(mode="before")
    @classmethod
    def _say_unit(cls, given: Any) -> Any:
        path = given.get("file") if isinstance(given, dict) else None
        return {"unit": file_unit(path), **given} if isinstance(path, str) else given

    @model_validator(mode="after")
    def _check(self) -> ShapeTable:
        suffix = known_suffix("file", self.path, SURFACE_SUFFIXES + MESH_SUFFIXES)
        if suffix not in TEXTURED_SUFFIXES:
            not_by_uv(self.paints)
        return self


Prop = PlateTable | BoxTable | ShapeTable
PropTable = Annotated[Prop, Field(discriminator="type")]


class CalibrationTable(Table):
    """Images of a target for calibration, beside the frames: ``images/<camera>/calib-0000.png``.

    They show the target in each pose, without bodies and other props, in the scene's light.

    Example::

        board = "board"
        cameras = ["left", "right"]
        pose = [
          { position_mm = [100.0, 0.0, 5.0], rotation_deg = [0.0, 0.0, 0.0] },
          { position_mm = [90.0, 10.0, 0.0], rotation_deg = [20.0, 0.0, 15.0] },
        ]
    """

    board: Name
    """A [[prop]] of type "plate"; the other frames don't show it."""
    cameras_: Annotated[SeveralNames | None, Field(alias="cameras")] = None
    """Without it all."""
    show: Names = ()
    """Props that these images show too, such as a wall."""
    poses: Annotated[tuple[PoseTable, ...], Field(alias="pose"), Listed(1, 10_000)]
    """One image per camera each."""
    _all_cameras: tuple[str, ...] = ()

    @property
    def cameras(self) -> tuple[str, ...]:
        """By name."""
        return self.cameras_ or self._all_cameras

    def photographed(self, by: tuple[str, ...]) -> None:
        """Enter the cameras of the scene."""
        self._all_cameras = by

    @model_validator(mode="after")
    def _check(self) -> CalibrationTable:
        if self.board in self.show:
            raise fault("show", "names the board, which is shown", self.show, "other props")
        return self
