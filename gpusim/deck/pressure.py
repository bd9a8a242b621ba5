"""Nodal forces of pressures on faces, integrated as CalculiX does."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.mesh import Faces, Mesh
from gpusim.mesh.quadrature import face_rule
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients

__all__ = ["face_points", "pressure_forces"]

Float = npt.NDArray[np.float64]


def pressure_forces(
    mesh: Mesh, faces: Faces, values: Float, formulation: Mapping[str, str]
) -> Float:
    """(N,3) consistent forces of ``values`` (F,), positive into the body, on undeformed faces."""
    forces = np.zeros((mesh.node_count, 3))
    for kind, first, block in mesh.blocks():
        inside = np.flatnonzero((faces.cell >= first) & (faces.cell < first + len(block)))
        if not inside.size:
            continue
        own = faces[inside]
        for name, rows in own.kinds():
            points, weight = face_rule(name, face_points(kind, formulation[kind], name))
            nodes = own.nodes[np.ix_(rows, np.array(FACE_TYPES[name]))]
            corners = mesh.points[nodes]
            tangent = np.einsum(
                "fki,qkj->fqij", corners - corners[:, :1], shape_gradients(name, points)
            )
            normal = np.cross(tangent[..., 0], tangent[..., 1]) * weight[:, None]
            share = np.einsum("qk,fqi->fki", shape_functions(name, points), normal)
            share *= -values[inside[rows]][:, None, None]
            add_to(forces, nodes, share)
    return forces


def face_points(kind: str, formulation: str, face: str) -> int:
    """Number of integration points on a face of an element.

    The rule counts where faces are curved. Found by running CalculiX 2.20 on curved elements:
    2x2 on C3D20R and C3D15, 3x3 on C3D20, three on the triangles of C3D10 and C3D15.
    """
    if face in ("tri3", "tri6"):
        return 3
    if face == "quad4" or kind == "wedge15" or formulation == "reduced":
        return 4
    return 9
