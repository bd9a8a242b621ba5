"""What a scene holds once it is read: frozen, in SI (m, N, Pa, kg, W), names resolved.

World axes are right-handed. A ``Vec3`` is (x, y, z). Directions are as in the file, not
normalised. A pattern's ``up`` (projected into the plane of the faces it falls on, seen from
outside) is None for +z, or +y on a plane that is horizontal.
"""

from __future__ import annotations

from dataclasses import dataclass

from .finish import MATTE, Bump, Finish
from .lights import Ambient, Area, Environment, Light, Point, Spot, Sun
from .loads import (
    Amplitude,
    Centrifugal,
    Force,
    Gravity,
    Isotropic,
    LineForce,
    Load,
    Material,
    NodalForce,
    Orthotropic,
    Part,
    Pressure,
    Support,
    Thermal,
    Traction,
    Vec3,
    Where,
)
from .measures import Damage, Deflection, Measure, Published, Stereo, Variant
from .mesh_recipe import (
    BeamMesh,
    BoxMesh,
    BracketMesh,
    CraneMesh,
    FieldMesh,
    FileMesh,
    MeshRecipe,
    NotchRecipe,
    PlateMesh,
)
from .patterns import Picture, Target, Wrap
from .photo import Lens, Psf, Sensor, Shutter, Vignetting

__all__ = [
    "Ambient",
    "Amplitude",
    "Analysis",
    "Area",
    "BeamMesh",
    "Body",
    "Box",
    "BoxMesh",
    "BracketMesh",
    "Bump",
    "Calibration",
    "Camera",
    "Centrifugal",
    "Checker",
    "CraneMesh",
    "Damage",
    "Deflection",
    "Dots",
    "Environment",
    "FieldMesh",
    "FileMesh",
    "Finish",
    "Force",
    "Gravity",
    "Isotropic",
    "Lens",
    "Light",
    "LineForce",
    "Load",
    "Marker",
    "Markers",
    "Material",
    "Measure",
    "MeshRecipe",
    "NodalForce",
    "NotchRecipe",
    "Orthotropic",
    "Output",
    "Paint",
    "Part",
    "Pattern",
    "Picture",
    "Plain",
    "Plate",
    "PlateMesh",
    "Point",
    "Pose",
    "Pressure",
    "Prop",
    "Psf",
    "Published",
    "Render",
    "Sensor",
    "Shape",
    "Shutter",
    "Solver",
    "Speckle",
    "Spot",
    "Stereo",
    "Sun",
    "Support",
    "Target",
    "Thermal",
    "Traction",
    "Variant",
    "Vec3",
    "Vignetting",
    "Where",
    "Wrap",
]


@dataclass(frozen=True)
class Plain:
    """One albedo everywhere; ``finish``: how it shines, here and elsewhere."""

    name: str
    where: Where
    albedo: float
    finish: Finish = MATTE


@dataclass(frozen=True)
class Marker:
    """One marker: its own name and its centre (m) on the unloaded shape."""

    name: str
    position: Vec3


@dataclass(frozen=True)
class Markers:
    """2x2 square markers of side ``size`` (m); fields lower left and upper right are ``dark``."""

    name: str
    where: Where
    albedo: float
    up: Vec3 | None
    size: float
    dark: float
    light: float
    markers: tuple[Marker, ...]
    wrap: Wrap | None = None
    finish: Finish = MATTE


@dataclass(frozen=True)
class Checker:
    """Fields of side ``cell`` (m) from the lower left corner ``origin``, whose field is dark."""

    name: str
    where: Where
    albedo: float
    up: Vec3 | None
    cell: float
    columns: int
    rows: int
    origin: Vec3
    dark: float
    light: float
    wrap: Wrap | None = None
    finish: Finish = MATTE


@dataclass(frozen=True)
class Dots:
    """Round dots (m) of albedo ``dot``; ``origin`` is the centre of the one at the lower left."""

    name: str
    where: Where
    albedo: float
    up: Vec3 | None
    diameter: float
    pitch: float
    columns: int
    rows: int
    origin: Vec3
    dot: float
    wrap: Wrap | None = None
    finish: Finish = MATTE


@dataclass(frozen=True)
class Speckle:
    """Random discs of mean ``diameter`` and edge ``softness`` (m); ``albedo`` is the ground's.

    The other values are those of `gpusim.surface.paint.Speckle`.
    """

    name: str
    where: Where
    albedo: float
    up: Vec3 | None
    diameter: float
    coverage: float
    softness: float
    size_law: str
    spread: float
    arrangement: str
    seed: int
    dot: float
    wrap: Wrap | None = None
    finish: Finish = MATTE


Pattern = Markers | Checker | Dots | Speckle | Picture | Target
Paint = Plain | Pattern


@dataclass(frozen=True)
class Body:
    """A deformable body.

    A face belongs to the last paint whose ``where`` matches it, an element to the last part; where
    no part does it is of ``material``. A body whose displacements are given (its ``mesh`` is a
    `FieldMesh`) has no material, supports or loads.
    """

    name: str
    material: Material | None
    parts: tuple[Part, ...]
    formulation: str
    mesh: MeshRecipe
    supports: tuple[Support, ...]
    loads: tuple[Load, ...]
    paints: tuple[Paint, ...]


@dataclass(frozen=True)
class Pose:
    """Where a prop's own point is (m), and how it is turned (rad, about x, then y, then z)."""

    position: Vec3
    rotation: Vec3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Plate:
    """A rigid plate (m): ``size`` is width (along up x normal) and height (along up).

    Props of every shape have ``paints``, and ``poses``, one per frame, or none if they stand
    still. They are built as described; ``stand`` is the pose in which they then stand, with
    ``origin`` the point that a pose is about.
    """

    name: str
    center: Vec3
    normal: Vec3
    up: Vec3
    size: tuple[float, float]
    paint: Paint
    poses: tuple[Pose, ...] = ()

    @property
    def paints(self) -> tuple[Paint, ...]:
        return (self.paint,)

    @property
    def origin(self) -> Vec3:
        return self.center

    @property
    def stand(self) -> Pose:
        return Pose(self.center)


@dataclass(frozen=True)
class Box:
    """A rigid block (m)."""

    name: str
    center: Vec3
    size: Vec3
    paints: tuple[Paint, ...]
    rotation: Vec3
    poses: tuple[Pose, ...] = ()

    @property
    def origin(self) -> Vec3:
        return self.center

    @property
    def stand(self) -> Pose:
        return Pose(self.center, self.rotation)


@dataclass(frozen=True)
class Shape:
    """A rigid thing from a file (absolute ``path``; ``scale`` is metres per unit of the file)."""

    name: str
    path: str
    scale: float
    position: Vec3
    paints: tuple[Paint, ...]
    rotation: Vec3
    poses: tuple[Pose, ...] = ()

    @property
    def origin(self) -> Vec3:
        return 0.0, 0.0, 0.0

    @property
    def stand(self) -> Pose:
        return Pose(self.position, self.rotation)


Prop = Plate | Box | Shape


@dataclass(frozen=True)
class Calibration:
    """Images of the prop ``board`` in each of ``poses``, by ``cameras``; ``show``: other props."""

    board: str
    cameras: tuple[str, ...]
    show: tuple[str, ...]
    poses: tuple[Pose, ...]


@dataclass(frozen=True)
class Analysis:
    """One frame per load factor ("static"), or per time of a given field ("field")."""

    type: str
    load_factors: tuple[float, ...]
    frame_rate: float | None = None


@dataclass(frozen=True)
class Solver:
    """``tolerance`` is the estimated relative displacement error at which to stop."""

    tolerance: float
    max_iterations: int | None
    method: str


@dataclass(frozen=True)
class Camera:
    """Camera: lengths in m, ``resolution`` (columns, rows) in px.

    ``principal_point_offset`` is right and down from the image's centre, on the sensor.
    ``intrinsics`` (fx, fy, cx, cy, skew) px come before ``focal``, which is 0 where nobody said
    it, as are the sides of the ``sensor``. ``position`` and ``target`` are None for a camera with
    a ``rotation`` (a Rodrigues vector, or nine numbers row by row) and ``translation``, or with
    the pose of its ``calibration`` file. ``electronics``: its sensor where it isn't the scene's.
    """

    name: str
    sensor: tuple[float, float]
    resolution: tuple[int, int]
    focal: float
    position: Vec3 | None
    target: Vec3 | None
    up: Vec3
    principal_point_offset: tuple[float, float]
    lens: Lens | None = None
    shutter: Shutter | None = None
    intrinsics: tuple[float, ...] = ()
    distortion: tuple[float, ...] = ()
    rotation: tuple[float, ...] = ()
    translation: Vec3 | None = None
    calibration: str = ""
    calibration_camera: str | int = 0
    calibration_unit: float = 0.0
    electronics: Sensor | None = None


@dataclass(frozen=True)
class Render:
    """``error`` in grey levels of 8 bit; ``background`` radiance."""

    error: float
    background: float


@dataclass(frozen=True)
class Output:
    """Truth layers by name, and whether to write VTU and STL files, and stress."""

    truth: tuple[str, ...]
    vtu: bool
    stl: bool
    stress: bool
