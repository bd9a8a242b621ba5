"""``[[body]]``, and the scene as a whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field, model_validator

from gpusim.scene.tables.table import Listed, Name, Table, Words, fault

from .analysis.analysis_table import TABLES, AnalysisTable, AnyAnalysis
from .analysis.loads import Amplitude, Load, LoadTable, SupportTable, TieTable, WhereTable
from .analysis.statics import FieldTable, StaticTable
from .analysis.transient import TransientTable
from .analysis.vibrations import BucklingTable, HarmonicTable, ModalTable
from .camera import CameraTable
from .lights import LightTable
from .material import MaterialTable
from .measures import AnyMeasure
from .mesh import (
    BeamMeshTable,
    BoxMeshTable,
    FieldMeshTable,
    MeshRecipe,
    MeshTable,
    NotchRecipeTable,
)
from .paint import Paint, PaintTable, not_by_uv
from .processing import OutputTable, RenderTable, SolverTable, VariantTable
from .prop import CalibrationTable, PropTable
from .sensor import SensorTable
from .video import VideoTable


@dataclass(frozen=True)
class Part:
    """Elements whose middle is at ``where`` are of another material than their body."""

    material: MaterialTable
    where: WhereTable


@dataclass(frozen=True)
class Body:
    """A deformable body, names resolved.

    A face belongs to the last paint whose ``where`` matches it, an element to the last part; where
    no part does it is of ``material``. A body whose displacements are given (its ``mesh`` is a
    `FieldMeshTable`) has no material, supports or loads.
    """

    name: str
    material: MaterialTable | None
    parts: tuple[Part, ...]
    formulation: str
    mesh: MeshRecipe
    supports: tuple[SupportTable, ...]
    ties: tuple[TieTable, ...]
    loads: tuple[Load, ...]
    paints: tuple[Paint, ...]

    @property
    def materials(self) -> tuple[MaterialTable, ...]:
        """Its own and those of its parts."""
        own = () if self.material is None else (self.material,)
        return (*own, *(part.material for part in self.parts))

    def large_displacements(self, geometry: str) -> str:
        """Why an analysis of this ``geometry`` solves it at large displacements; "" where the
        linear solution is to say."""
        if geometry == "nonlinear":
            return "asked for"
        unknown = [one.name for one in self.materials if one.finite_strain]
        return f"linear theory doesn't know material {unknown[0]!r}" if unknown else ""

    @property
    def has_history(self) -> bool:
        """Whether it isn't the same again when loads come back."""
        return any(material.has_history for material in self.materials)


class PartTable(Table):
    """Elements of a body that are of another material.

    Example::

        material = "brass"
        where = { z_max_mm = 0.0 }
    """

    material: Name
    """The name of a [[material]]."""
    where: WhereTable
    """The elements whose middle is there; ``set`` is a named set of elements."""

    @model_validator(mode="after")
    def _check(self) -> PartTable:
        if self.where.normal is not None:
            raise fault("where.normal", "of elements, which look nowhere", self.where.normal,
                        "a set of elements or bounds")  # fmt: skip
        if self.where.is_everything:
            raise fault("where", "selects the whole body", Words("{}"), "a set or a bound")
        return self


class BodyTable(Table):
    """A deformable body: a mesh of a material to be solved, or a field that is given.

    Example::

        name = "bar"
        material = "steel"

        [mesh]
        builder = "box"
        size_mm = [200.0, 20.0, 10.0]
        divisions = [40, 4, 4]

        [[support]]
        name = "clamp"
        where = { set = "x_min" }
        fix = ["x", "y", "z"]

        [[load]]
        name = "pull"
        type = "force"
        where = { set = "x_max" }
        force_N = [1000.0, 0.0, 0.0]

        [[paint]]
        name = "grey"
        type = "plain"
        albedo = 0.4
    """

    name: Name
    """Of its files, and what messages and --set call it."""
    material: Name | None = None
    """The name of a [[material]]."""
    field: FieldMeshTable | None = None
    """Mesh and displacements from a result file of another program, in place of material, mesh,
    supports and loads; ``analysis.type`` is "field" then."""
    part: Annotated[tuple[PartTable, ...], Listed()] = ()
    """Elements of other materials; an element belongs to the last entry that matches it."""
    formulation: Literal["incompatible", "full", "bbar", "reduced", "exact"] = "incompatible"
    """Of 8-node bricks "incompatible" (bends without locking), "full", or "bbar" (for rubber-like
    bodies); of 20-node bricks "full" or "reduced"; of 10-node tetrahedra "full", "exact" or "bbar";
    of 6-node wedges "full" or "exact". An element type that doesn't have it takes its own
    default."""
    mesh: MeshTable | None = None
    """What it is made of; ``builder`` says how the mesh is made, or ``file`` from which it is
    read."""
    notch: Annotated[tuple[NotchRecipeTable, ...], Listed()] = ()
    """Slots in a box or a beam."""
    support: Annotated[tuple[SupportTable, ...], Listed()] = ()
    """What holds it."""
    tie: Annotated[tuple[TieTable, ...], Listed()] = ()
    """What joins parts of its mesh that touch without sharing nodes."""
    load: Annotated[tuple[LoadTable, ...], Listed()] = ()
    """What pulls, pushes, turns or heats it."""
    paint: Annotated[tuple[PaintTable, ...], Listed(1)]
    """A face belongs to the last entry that matches it."""

    @model_validator(mode="after")
    def _check(self) -> BodyTable:
        not_by_uv(self.paint)
        if self.field is None:
            for key, what in (("material", "the name of a [[material]]"), ("mesh", "a mesh")):
                if getattr(self, key) is None:
                    expected = f"{what}, or a field"
                    raise fault(key, "missing", Words(f"neither {key} nor field"), expected)
            return self
        for key in ("material", "mesh", "part", "formulation", "notch", "support", "tie", "load"):
            if getattr(self, key) not in (None, (), type(self).model_fields[key].default):
                raise fault(key, "beside field, which gives mesh and displacements",
                            Words("both"), "one of them")  # fmt: skip
        return self

    def resolved(self, materials: Mapping[str, MaterialTable], factors: Amplitude) -> Body:
        """The body with its materials, its notches, and the load ``factors`` of the frames for
        what has no amplitude of its own."""
        mesh = self.mesh if self.field is None else self.field
        assert mesh is not None  # _check made sure
        if isinstance(mesh, BoxMeshTable | BeamMeshTable):
            mesh.notched(self.notch)
        for driven in (*self.support, *self.load):
            driven.driven(factors)
        return Body(
            name=self.name,
            material=None if self.material is None else materials[self.material],
            parts=tuple(Part(materials[part.material], part.where) for part in self.part),
            formulation=self.formulation,
            mesh=mesh,
            supports=self.support,
            ties=self.tie,
            loads=self.load,
            paints=self.paint,
        )


TABLES.update(
    static=StaticTable, field=FieldTable, modal=ModalTable, transient=TransientTable,
    harmonic=HarmonicTable, buckling=BucklingTable,
)  # fmt: skip


class SceneTable(Table):
    """A gpusim scene: structure, loads, cameras, lights, and what to measure.

    Example::

        schema = 1
        name = "A grey plate"

        [[prop]]
        name = "plate"
        type = "plate"
        center_mm = [0.0, 0.0, 0.0]
        normal = [0.0, -1.0, 0.0]
        size_mm = [100.0, 60.0]
        paint = [{ name = "grey", type = "plain", albedo = 0.4 }]

        [[camera]]
        name = "front"
        sensor_mm = [8.8, 6.6]
        resolution_px = [1280, 960]
        focal_mm = 25.0
        position_mm = [0.0, -400.0, 0.0]
        target_mm = [0.0, 0.0, 0.0]
    """

    schema_: Annotated[Literal[1], Field(alias="schema")]
    """Version of the scene format."""
    name: Annotated[str, Field(min_length=1, max_length=200)]
    """Title of the report."""
    description: str = ""
    """A few sentences for the report."""
    material: Annotated[tuple[MaterialTable, ...], Listed()] = ()
    """What bodies are made of."""
    body: Annotated[tuple[BodyTable, ...], Listed()] = ()
    """Deformable bodies, which are solved and seen."""
    prop: Annotated[tuple[PropTable, ...], Listed()] = ()
    """Rigid things in the picture: walls, boards, machines."""
    analysis: AnyAnalysis = StaticTable()
    """What is computed, and the frames that it is computed for."""
    solver: SolverTable = SolverTable()
    """How far to solve."""
    camera: Annotated[tuple[CameraTable, ...], Listed()] = ()
    """From where the scene is seen; each takes a picture of every frame."""
    light: Annotated[tuple[LightTable, ...], Listed()] = ()
    """Lamps, sun and surroundings; without any, images show the albedo."""
    calibration: CalibrationTable | None = None
    """Images of a calibration target, beside the frames."""
    render: RenderTable = RenderTable()
    """How exact the images are."""
    sensor: SensorTable = SensorTable()
    """From radiance to grey values, for all cameras."""
    measure: Annotated[tuple[AnyMeasure, ...], Listed()] = ()
    """What is measured in the pictures and compared with the truth."""
    variant: Annotated[tuple[VariantTable, ...], Listed()] = ()
    """States that are made in one run and compared."""
    video: VideoTable | None = None
    """Films of the pictures, and how they are taken."""
    output: OutputTable = OutputTable()
    """What is written beside images, measurements and report."""

    @model_validator(mode="after")
    def _complete(self) -> SceneTable:
        """What tables take from others where they don't say it themselves."""
        for index, camera in enumerate(self.camera):
            camera.equip(self.sensor, f"camera.{index}")
        self.filmed()
        if self.calibration is not None:
            self.calibration.photographed(tuple(camera.name for camera in self.camera))
        return self

    def filmed(self) -> tuple[AnalysisTable, tuple[CameraTable, ...]]:
        """The analysis and the cameras, with the frame rate and the exposure of [video] where they
        don't say their own. Raises a fault of the key ``analysis``."""
        if self.video is None:
            return self.analysis, self.camera
        cameras = tuple(map(self.video.exposed, self.camera))
        return self.analysis.at_rate(self.video.frame_rate_Hz), cameras
