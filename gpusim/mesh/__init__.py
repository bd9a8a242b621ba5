"""Meshes: points and cells, boundary faces, selections, builders, quality."""

from __future__ import annotations

from gpusim.mesh.build import beam, box, crane
from gpusim.mesh.cad import check_gmsh, mesh_cad
from gpusim.mesh.cad_sizes import SizeBox
from gpusim.mesh.cells import CELL_TYPES, CellType
from gpusim.mesh.faces import Faces, boundary_faces, set_faces
from gpusim.mesh.faces_file import read_surface
from gpusim.mesh.mesh import Mesh
from gpusim.mesh.notch import Notch, notched
from gpusim.mesh.plate import bracket, plate_with_hole
from gpusim.mesh.quadratic import quadratic
from gpusim.mesh.quality import Quality, mesh_quality
from gpusim.mesh.read import read_mesh
from gpusim.mesh.select import select_faces, select_nodes
from gpusim.mesh.split import split

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
    "select_faces",
    "select_nodes",
    "set_faces",
    "split",
]
