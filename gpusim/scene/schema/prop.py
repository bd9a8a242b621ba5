"""``[[prop]]`` and ``[calibration]``: rigid things, and where they are in each frame."""

from __future__ import annotations

from pathlib import PurePath
from typing import Annotated, Literal

from pydantic import Field, model_validator

from .base import Direction, Name, Table, Vector, Words, fault, norm, parallel
from .mesh import MESH_SUFFIXES
from .paint import MarkersTable, PaintTable

__all__ = ["SURFACE_SUFFIXES", "CalibrationTable", "PoseTable", "PropTable"]

# Files of faces alone; said here too, because a plan loads no numerics.
SURFACE_SUFFIXES = (".stl", ".ply", ".obj", ".off", ".glb", ".gltf")

PropLength = Annotated[float, Field(gt=0, le=1e10)]


class PoseTable(Table):
    """Where a prop is: turned about its own point, which then lies at ``position_mm``."""

    position_mm: Vector
    """Of the prop's centre (of a mesh prop: of the point that its file's origin is)."""
    rotation_deg: Vector = [0.0, 0.0, 0.0]
    """About the world's x, then y, then z axis, from how the prop is described."""


class _Prop(Table):
    name: Name
    poses: Annotated[list[PoseTable], Field(min_length=1, max_length=10_000)] | None = None
    """One per frame, for a prop that moves; paint and ``where`` are of the prop as described."""


class PlateTable(_Prop):
    """A rigid rectangular plate: a wall, a target. Only its front is seen."""

    type: Literal["plate"] = "plate"
    """Needn't be said."""
    center_mm: Vector
    normal: Direction
    """Out of its front."""
    up: Direction = [0.0, 0.0, 1.0]
    size_mm: Annotated[list[PropLength], Field(min_length=2, max_length=2)]
    """Width (across ``up``) and height, at most 1e10 mm: beyond, rounding moves what is on it."""
    paint: Annotated[list[PaintTable], Field(min_length=1, max_length=1)]
    """One paint: a plate has one face."""

    @model_validator(mode="after")
    def _check(self) -> PlateTable:
        if parallel(self.normal, self.up):
            raise fault("up", "is along the normal, or one is zero", self.up, "a vector across it")
        paint = self.paint[0]
        if not paint.where.is_everything:
            raise fault("paint.0.where", "a plate has one face", Words("a selection"), "no where")
        if isinstance(paint, MarkersTable):
            self._check_markers(paint)
        return self

    def _check_markers(self, paint: MarkersTable) -> None:
        n = [value / norm(self.normal) for value in self.normal]
        along = sum(a * b for a, b in zip(self.up, n, strict=True))
        up = [a - along * b for a, b in zip(self.up, n, strict=True)]
        up = [value / norm(up) for value in up]
        right = [up[1] * n[2] - up[2] * n[1], up[2] * n[0] - up[0] * n[2],
                 up[0] * n[1] - up[1] * n[0]]  # fmt: skip
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
    rotation_deg: Vector = [0.0, 0.0, 0.0]
    """About the world's x, then y, then z axis, through the prop's own point; ``poses`` replace
    it."""
    paint: Annotated[list[PaintTable], Field(min_length=1)]
    """A face belongs to the last entry that matches it; positions are those before any rotation."""


class BoxPropTable(_Shaped):
    """A rigid block: a machine's frame, a base. Its sides are the sets "x_min" … "z_max"."""

    type: Literal["box"]
    center_mm: Vector
    size_mm: Annotated[list[PropLength], Field(min_length=3, max_length=3)]
    """Along x, y, z, before rotation, at most 1e10 mm."""


class MeshPropTable(_Shaped):
    """A rigid thing of any shape: faces (.stl, .ply, .obj, .off, .glb, .gltf) or a mesh file."""

    type: Literal["mesh"]
    file: Annotated[str, Field(min_length=1)]
    """Relative to the scene file. Faces are wound counter-clockwise seen from outside."""
    unit: Literal["m", "cm", "mm", "um", "in"] = "mm"
    """Of the file's coordinates."""
    position_mm: Vector = [0.0, 0.0, 0.0]
    """Where the file's origin is."""

    @model_validator(mode="after")
    def _check(self) -> MeshPropTable:
        known = SURFACE_SUFFIXES + MESH_SUFFIXES
        if PurePath(self.file).suffix.lower() not in known:
            raise fault("file", "unknown kind of file", self.file, "one of " + ", ".join(known))
        return self


PropTable = Annotated[PlateTable | BoxPropTable | MeshPropTable, Field(discriminator="type")]


class CalibrationTable(Table):
    """Images of a target for calibration, beside the frames: ``images/<camera>/calib-0000.png``.

    They show the target in each pose, without bodies and other props, in the scene's light.
    """

    board: Name
    """A [[prop]] of type "plate"; the other frames don't show it."""
    cameras: Annotated[list[Name], Field(min_length=1)] | None = None
    """Without it all."""
    show: list[Name] = []
    """Props that these images show too, such as a wall."""
    pose: Annotated[list[PoseTable], Field(min_length=1, max_length=10_000)]
    """One image per camera each."""

    @model_validator(mode="after")
    def _check(self) -> CalibrationTable:
        for key in ("cameras", "show"):
            names = getattr(self, key) or []
            if len(set(names)) != len(names):
                raise fault(key, "a name twice", names, "each once")
        if self.board in self.show:
            raise fault("show", "names the board, which is shown", self.show, "other props")
        return self
