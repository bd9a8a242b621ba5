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

import typing as _typing

from gpusim.mesh.boundary import Faces as Faces
from gpusim.mesh.boundary import boundary_faces as boundary_faces
from gpusim.mesh.boundary import set_faces as set_faces
from gpusim.mesh.builders.conversion import quadratic as quadratic
from gpusim.mesh.builders.conversion import split as split
from gpusim.mesh.builders.grids import beam as beam
from gpusim.mesh.builders.grids import box as box
from gpusim.mesh.builders.grids import crane as crane
from gpusim.mesh.builders.notches import Notch as Notch
from gpusim.mesh.builders.notches import notched as notched
from gpusim.mesh.builders.plates import bracket as bracket
from gpusim.mesh.builders.plates import plate_with_hole as plate_with_hole
from gpusim.mesh.cell_types import CELL_TYPES as CELL_TYPES
from gpusim.mesh.cell_types import CellType as CellType
from gpusim.mesh.mesh import Mesh as Mesh
from gpusim.mesh.quality import Quality as Quality
from gpusim.mesh.quality import mesh_quality as mesh_quality
from gpusim.mesh.selection import select_faces as select_faces
from gpusim.mesh.selection import select_nodes as select_nodes
from gpusim.public_names import public_names as _public_names

if _typing.TYPE_CHECKING:
    from gpusim.mesh.formats.cad import check_gmsh as check_gmsh
    from gpusim.mesh.formats.cad import mesh_cad as mesh_cad
    from gpusim.mesh.formats.element_sizes import SizeBox as SizeBox
    from gpusim.mesh.formats.reader import read_mesh as read_mesh
    from gpusim.mesh.formats.surfaces import read_surface as read_surface
    from gpusim.mesh.formats.textures import read_textured as read_textured


# two dozen readers, which a mesh that is built by number does without
_FORMATS = {
    "gpusim.mesh.formats.cad": "check_gmsh mesh_cad",
    "gpusim.mesh.formats.element_sizes": "SizeBox",
    "gpusim.mesh.formats.reader": "read_mesh",
    "gpusim.mesh.formats.surfaces": "read_surface",
    "gpusim.mesh.formats.textures": "read_textured",
}

__all__, __getattr__, __dir__ = _public_names(__name__, _FORMATS)
