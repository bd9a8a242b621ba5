"""Meshes: points and cells, boundary faces, selections, builders, quality.

In the order in which data passes:

- `cell_types`: Cell types: node order (VTK = Abaqus), edges, faces, and parents of midside nodes.
  Pure data.
- `shape_functions`: Shape functions of cells and faces, as polynomials that are 1 at one node and
  0 at the others.
- `quadrature`: Quadrature on the reference cells and faces of ``gpusim.mesh.shape_functions``.
  Pure data.
- `boundary`: Boundary faces of a mesh, outward oriented, with normals and areas.
- `nearest_places`: Where on a face, flat or curved, the nearest place to a point is.
- `quality`: Jacobians of the map from a reference cell, aspect ratio, distortion, bad cells.
- `polygons`: Polygons as triangles and quadrilaterals within them, cut at their dents; normals.
- `mesh`: The mesh: points, cells by type, and named sets.
- `selection`: Named and geometric selections of nodes and faces.
- `builders`: Meshes made by number, and meshes made from other meshes.
- `file_content`: What mesh files of other programs have in common.
- `formats`: Mesh files of other programs.
- `part_outline`: The outline of a part: its sizes and faces, for a first scene.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from gpusim.mesh.boundary import Faces, boundary_faces, set_faces
from gpusim.mesh.builders.conversion import quadratic, split
from gpusim.mesh.builders.grids import beam, box, crane
from gpusim.mesh.builders.notches import Notch, notched
from gpusim.mesh.builders.plates import bracket, plate_with_hole
from gpusim.mesh.cell_types import CELL_TYPES, CellType
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.quality import Quality, mesh_quality
from gpusim.mesh.selection import select_faces, select_nodes

if TYPE_CHECKING:
    from gpusim.mesh.formats.cad import check_gmsh, mesh_cad
    from gpusim.mesh.formats.element_sizes import SizeBox
    from gpusim.mesh.formats.reader import read_mesh
    from gpusim.mesh.formats.surfaces import read_surface
    from gpusim.mesh.formats.textures import read_textured

__all__ = [
    "CELL_TYPES",
    "CellType",
    "Faces",
    "Mesh",
    "Notch",
    "Quality",
    "SizeBox",
    "beam",
    "boundary_faces",
    "box",
    "bracket",
    "check_gmsh",
    "crane",
    "mesh_cad",
    "mesh_quality",
    "notched",
    "plate_with_hole",
    "quadratic",
    "read_mesh",
    "read_surface",
    "read_textured",
    "select_faces",
    "select_nodes",
    "set_faces",
    "split",
]


# two dozen readers, which a mesh that is built by number does without
_FORMATS = {
    "SizeBox": "element_sizes",
    "check_gmsh": "cad",
    "mesh_cad": "cad",
    "read_mesh": "reader",
    "read_surface": "surfaces",
    "read_textured": "textures",
}


def __getattr__(name: str) -> Any:
    if name in _FORMATS:
        return getattr(importlib.import_module(f"gpusim.mesh.formats.{_FORMATS[name]}"), name)
    raise AttributeError(f"module 'gpusim.mesh' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
