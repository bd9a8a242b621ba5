"""How a body's mesh is made: frozen, lengths in m."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = [
    "BeamMesh",
    "BoxMesh",
    "BracketMesh",
    "CraneMesh",
    "FieldMesh",
    "FileMesh",
    "MeshRecipe",
    "NotchRecipe",
    "PlateMesh",
]

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class NotchRecipe:
    """A slot across ``axis`` at ``position``, cut ``depth`` deep into ``side`` ("+x" … "-z")."""

    position: float
    width: float
    depth: float
    axis: str
    side: str
    cells: int


@dataclass(frozen=True)
class BoxMesh:
    """``divisions`` elements along x, y, z from the lowest corner ``origin``."""

    size: Vec3
    divisions: tuple[int, int, int]
    origin: Vec3
    cells: str = "hex8"
    notches: tuple[NotchRecipe, ...] = ()


@dataclass(frozen=True)
class BeamMesh:
    """A bar along x, its axis on the x axis; the section tapers to width and height at its end."""

    length: float
    width: float
    height: float
    end_width: float
    end_height: float
    divisions: tuple[int, int, int]
    cells: str = "hex8"
    notches: tuple[NotchRecipe, ...] = ()


@dataclass(frozen=True)
class CraneMesh:
    """Column and beam; see the scene file's ``crane`` builder."""

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
    cells: str = "hex8"


@dataclass(frozen=True)
class PlateMesh:
    """A plate with a round hole in the middle; element counts around and away from the hole."""

    length: float
    width: float
    thickness: float
    hole_diameter: float
    around: int
    radial: int
    through: int
    cells: str = "hex8"


@dataclass(frozen=True)
class BracketMesh:
    """An L-bracket of bent plate with a hole in each leg."""

    base_length: float
    wall_height: float
    width: float
    thickness: float
    fillet_radius: float
    hole_diameter: float
    around: int
    radial: int
    through: int
    bend: int
    cells: str = "hex8"


@dataclass(frozen=True)
class FileMesh:
    """A mesh or CAD file (absolute ``path``); ``scale`` is metres per unit of the file.

    ``order`` 2 makes linear cells quadratic. ``size`` (m), ``hexahedra``, ``hex_dominant`` and
    ``curvature`` (elements around a circle) are for CAD files only; a mesh file has no size (None).
    Meshing is given up after ``time_limit`` (s).
    """

    path: str
    scale: float
    order: int
    size: float | None
    hexahedra: bool
    hex_dominant: bool
    curvature: int
    time_limit: float = 600.0


@dataclass(frozen=True)
class FieldMesh:
    """Mesh and displacements of a result file (absolute ``path``) of another program.

    ``scale`` is metres per unit of the file, ``magnify`` a factor on the displacements,
    ``variable`` the displacement's name (None: a usual one).
    """

    path: str
    scale: float
    magnify: float
    variable: str | None


MeshRecipe = BoxMesh | BeamMesh | CraneMesh | PlateMesh | BracketMesh | FileMesh | FieldMesh
