"""What loads and holds a body, and of what material it is: SI, as in ``model``."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "Amplitude",
    "Centrifugal",
    "Force",
    "Gravity",
    "Isotropic",
    "LineForce",
    "Load",
    "Material",
    "NodalForce",
    "Orthotropic",
    "Part",
    "Pressure",
    "Support",
    "Thermal",
    "Traction",
    "Vec3",
    "Where",
]

Vec3 = tuple[float, float, float]
Amplitude = tuple[float, ...]


@dataclass(frozen=True)
class Isotropic:
    """Linear elastic, isotropic: Pa, -, kg/m3, 1/K."""

    name: str
    youngs_modulus: float
    poissons_ratio: float
    density: float
    expansion: float


@dataclass(frozen=True)
class Orthotropic:
    """Linear elastic, orthotropic: Pa, -, kg/m3, 1/K along the material axes (rows of ``axes``).

    Ratios are nu12, nu23, nu31, shear moduli G12, G23, G31.
    """

    name: str
    youngs_moduli: Vec3
    poissons_ratios: Vec3
    shear_moduli: Vec3
    density: float
    expansion: Vec3
    axes: tuple[Vec3, Vec3, Vec3]


Material = Isotropic | Orthotropic


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
class Part:
    """Elements whose middle is at ``where`` are of another material than their body."""

    material: Material
    where: Where


@dataclass(frozen=True)
class Support:
    """Nodes held in ``axes`` (of "xyz") at ``displacement`` (m) from the unloaded shape.

    With ``symmetry`` the faces' nodes are held along the faces' normal instead. ``amplitude`` has
    one factor per frame, those of the analysis where the scene says nothing else.
    """

    name: str
    where: Where
    axes: tuple[str, ...]
    displacement: Vec3
    symmetry: bool
    amplitude: Amplitude


@dataclass(frozen=True)
class Force:
    """A total force (N), spread evenly over the area of the faces."""

    name: str
    where: Where
    force: Vec3
    amplitude: Amplitude


@dataclass(frozen=True)
class NodalForce:
    """The same force (N) on every node."""

    name: str
    where: Where
    force: Vec3
    amplitude: Amplitude


@dataclass(frozen=True)
class Pressure:
    """A pressure (Pa) on faces; positive pushes into the body."""

    name: str
    where: Where
    pressure: float
    amplitude: Amplitude


@dataclass(frozen=True)
class Traction:
    """A force per area (Pa) on faces."""

    name: str
    where: Where
    traction: Vec3
    amplitude: Amplitude


@dataclass(frozen=True)
class Gravity:
    """The body's weight, by acceleration (m/s2)."""

    name: str
    acceleration: Vec3
    amplitude: Amplitude


@dataclass(frozen=True)
class LineForce:
    """A total force (N), spread evenly over the length of a line of element edges."""

    name: str
    where: Where
    force: Vec3
    amplitude: Amplitude


@dataclass(frozen=True)
class Centrifugal:
    """Steady rotation (rad/s) about an axis through a point (m)."""

    name: str
    axis_point: Vec3
    axis: Vec3
    omega: float
    amplitude: Amplitude


@dataclass(frozen=True)
class Thermal:
    """A temperature change (K) of the whole body."""

    name: str
    temperature_change: float
    amplitude: Amplitude


Load = Force | NodalForce | LineForce | Pressure | Traction | Gravity | Centrifugal | Thermal
"""``amplitude`` has one factor per frame: the load's own, or the analysis' load factors."""
