"""Meshes: points and cells, boundary faces, selections, builders, quality."""

from __future__ import annotations

from gpusim.mesh.build import box, crane
from gpusim.mesh.cells import CELL_TYPES, CellType
from gpusim.mesh.faces import Faces, boundary_faces, set_faces
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.quality import Quality, mesh_quality
from gpusim.mesh.select import select_faces, select_nodes

__all__ = [
    "CELL_TYPES",
    "CellType",
    "Faces",
    "Mesh",
    "Quality",
    "boundary_faces",
    "box",
    "crane",
    "mesh_quality",
    "select_faces",
    "select_nodes",
    "set_faces",
]
