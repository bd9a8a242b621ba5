"""Lines of a mesh on its surface: borders of elements, and edges where it is creased or ends."""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.mesh.polygons import unit_normals
from gpusim.surface import Skin
from gpusim.surface.surface import Surface

CREASE = np.cos(np.pi / 6)


def _ends(surface: Surface, edges: Bool) -> Float:
    """(n, 2, 3): where the edges (E,) that are wanted lie now."""
    topology = surface.topology
    # each edge once, from the first of its triangles
    number, first = np.unique(topology.edge.reshape(-1), return_index=True)
    triangle, corner = np.divmod(first[edges[number]], 3)
    ends = [topology.triangles[triangle, k] for k in (corner, (corner + 1) % 3)]
    return surface.points[np.stack(ends, axis=1)]


def element_edges(surface: Surface, skin: Skin) -> Float:
    """(n, 2, 3) m, world: the borders of a body's elements on its surface, where they are now.

    Curved borders come in pieces; what cuts a face into triangles is left out.

    Examples
    --------
    >>> from gpusim.visualization.mesh_edges import element_edges
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> skin = gs.Skin(bar, gs.mesh.boundary_faces(bar))
    >>> surface = skin.surface({"": gs.paint.Plain()}, np.zeros(6, np.int32), {}, "bar")
    >>> element_edges(surface, skin).shape
    (12, 2, 3)
    """
    topology = surface.topology
    face = skin.face_of_piece[topology.source]
    between = face[topology.first] != face[topology.second]
    return _ends(surface, between | ~topology.manifold)


def crease_edges(surface: Surface, eye: Float | None = None) -> Float:
    """(n, 2, 3) m, world: edges at which a surface turns by more than 30°, ends,
    changes its paint, or turns away from an ``eye`` (3,)."""
    topology = surface.topology
    corners = surface.points[topology.triangles]
    normal = unit_normals(corners)
    cosine = (normal[topology.first] * normal[topology.second]).sum(axis=1)
    region = surface.regions[topology.source]
    other = region[topology.first] != region[topology.second]
    if eye is not None:
        away = ((corners[:, 0] - eye) * normal).sum(axis=1) > 0.0
        other |= away[topology.first] != away[topology.second]
    return _ends(surface, (cosine < CREASE) | ~topology.manifold | other)
