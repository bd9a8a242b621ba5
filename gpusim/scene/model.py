"""What a scene holds once it is read: frozen, in SI (m, N, Pa, kg, W), names resolved.

World axes are right-handed. A ``Vec3`` is (x, y, z). Directions are as in the file, not
normalised. A pattern's ``up`` (projected into the plane of the faces it falls on, seen from
outside) is None for +z, or +y on a plane that is horizontal.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "Analysis",
    "Body",
    "BoxMesh",
    "Camera",
    "Checker",
    "CraneMesh",
    "Deflection",
    "Dots",
    "Force",
    "Gravity",
    "Light",
    "Load",
    "Marker",
    "Markers",
    "Material",
    "MeshRecipe",
    "NodalForce",
    "Output",
    "Paint",
    "Plain",
    "Pressure",
    "Prop",
    "Render",
    "Sensor",
    "Solver",
    "Support",
    "Traction",
    "Vec3",
    "Where",
]

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """Linear elastic, isotropic: Pa, -, kg/m3."""

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float


@dataclass(frozen=True)
class BoxMesh:
    """``divisions`` hex8 elements along x, y, z from the lowest corner ``origin`` (m)."""

    size: Vec3
    divisions: tuple[int, int, int]
    origin: Vec3


@dataclass(frozen=True)
class CraneMesh:
    """Column and beam of hex8 elements; lengths in m, see the scene file's ``crane`` builder."""

    height: float
    foot: float
    length: float
    column_thickness: float
    beam_thickness: float
    width: float
    load_length: float
    element: float
    through: int
    across: int


MeshRecipe = BoxMesh | CraneMesh


@dataclass(frozen=True)
class Where:
    """A part of a body: conditions that hold together.

    ``lower``/``upper`` (m) are infinite where nothing was asked; ``tolerance`` (m) widens them.
    ``normal`` is "+x" … "-z".
    """

    set: str | None
    lower: Vec3
    upper: Vec3
    normal: str | None
    tolerance: float


@dataclass(frozen=True)
class Support:
    """Nodes held in ``axes`` (of "xyz") at ``displacement`` (m) from the unloaded shape."""

    name: str
    where: Where
    axes: tuple[str, ...]
    displacement: Vec3


@dataclass(frozen=True)
class Force:
    """A total force (N), spread evenly over the area of the faces."""

    name: str
    where: Where
    force: Vec3


@dataclass(frozen=True)
class NodalForce:
    """The same force (N) on every node."""

    name: str
    where: Where
    force: Vec3


@dataclass(frozen=True)
class Pressure:
    """A pressure (Pa) on faces; positive pushes into the body."""

    name: str
    where: Where
    pressure: float


@dataclass(frozen=True)
class Traction:
    """A force per area (Pa) on faces."""

    name: str
    where: Where
    traction: Vec3


@dataclass(frozen=True)
class Gravity:
    """The body's weight, by acceleration (m/s2)."""

    name: str
    acceleration: Vec3


Load = Force | NodalForce | Pressure | Traction | Gravity


@dataclass(frozen=True)
class Plain:
    """One albedo everywhere."""

    name: str
    where: Where
    albedo: float


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


Paint = Plain | Markers | Checker | Dots


@dataclass(frozen=True)
class Body:
    """A deformable body; a face belongs to the last paint whose ``where`` matches it."""

    name: str
    material: Material
    formulation: str
    mesh: MeshRecipe
    supports: tuple[Support, ...]
    loads: tuple[Load, ...]
    paints: tuple[Paint, ...]


@dataclass(frozen=True)
class Prop:
    """A rigid plate (m): ``size`` is width (along up x normal) and height (along up)."""

    name: str
    center: Vec3
    normal: Vec3
    up: Vec3
    size: tuple[float, float]
    paint: Paint


@dataclass(frozen=True)
class Analysis:
    """``type`` is "static"; one frame per load factor."""

    type: str
    load_factors: tuple[float, ...]


@dataclass(frozen=True)
class Solver:
    """``tolerance`` is the estimated relative displacement error at which to stop."""

    tolerance: float
    max_iterations: int | None
    preconditioner: str


@dataclass(frozen=True)
class Camera:
    """Pinhole camera: lengths in m, ``resolution`` (columns, rows) in px.

    ``principal_point_offset`` is right and down from the image's centre, on the sensor.
    """

    name: str
    sensor: tuple[float, float]
    resolution: tuple[int, int]
    focal: float
    position: Vec3
    target: Vec3
    up: Vec3
    principal_point_offset: tuple[float, float]


@dataclass(frozen=True)
class Light:
    """A lamp of radiant flux ``power`` (W); a point lamp has no ``target`` and ``size`` (0, 0).

    Type "ambient" has only a ``radiance`` (W / (m2 sr)).
    """

    name: str
    type: str
    position: Vec3
    target: Vec3 | None
    size: tuple[float, float]
    power: float
    radiance: float = 0.0


@dataclass(frozen=True)
class Render:
    """``error`` in grey levels of 8 bit; ``background`` radiance."""

    error: float
    background: float


@dataclass(frozen=True)
class Sensor:
    """``exposure``: fraction of full scale per unit of radiance, None to choose it from frame 0."""

    bits: int
    exposure: float | None
    format: str


@dataclass(frozen=True)
class Deflection:
    """Deflection line of the marker paints ``groups``, from the clamp; ``static`` ones stand still.

    ``direction`` ("+x" … "-z") is the positive sense; ``subset`` (px) is None to choose it.
    """

    name: str
    camera: str
    groups: tuple[str, ...]
    static: tuple[str, ...]
    subset: int | None
    direction: str


@dataclass(frozen=True)
class Output:
    """Truth layers by name, and whether to write VTU and STL files."""

    truth: tuple[str, ...]
    vtu: bool
    stl: bool
