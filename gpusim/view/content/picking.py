"""What is under a pixel: the body or prop, its element, node and sets, and the material point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.field_summary import field_summary
from gpusim.optics.geometry.triangle_corners import REFERENCE
from gpusim.optics.geometry.view import View
from gpusim.surface import Skin
from gpusim.surface.surface import Surface
from gpusim.visualization.field_colors import barycentric


@dataclass(frozen=True, eq=False)
class Pick:
    """What a pixel sees.

    ``surface``: its number among those of the view; ``name``, ``paint``: of the surface and of its
    region; ``face``: of the surface. ``vertices`` (3,), ``weights`` (3,): of the surface's
    triangle, which follow the material point to wherever it moves. ``reference`` (3,): the point
    before it moved, m, world. Of bodies, else None: ``element`` (number of the cell), ``node`` (the
    nearest one of the element's face seen), ``sets``: names of those that the element's face is in.
    """

    surface: int
    name: str
    paint: str
    face: int
    vertices: npt.NDArray[np.integer]
    weights: Float
    reference: Float
    element: int | None = None
    node: int | None = None
    sets: tuple[str, ...] = ()
    __repr__ = field_summary


class MaterialPoints(NamedTuple):
    """Points (n, k) on surfaces.

    ``surface``, ``face`` (n,): numbers of the surface and of its face. ``vertices`` (n, 3),
    ``weights`` (n, k, 3): of the surface's triangle, which follow the points to wherever they move.
    ``reference`` (n, k, 3): before they moved, m, world.
    """

    surface: Long
    face: Long
    vertices: Long
    weights: Float
    reference: Float


def material_points(
    view: View, surfaces: Sequence[Surface], triangles: Long, pixels: Float
) -> MaterialPoints:
    """The points that a view sees at ``pixels`` (n, k, 2) in the planes of its ``triangles`` (n,),
    which may be beside them there."""
    ideal = view.camera.undistort(pixels.reshape(-1, 2)).reshape(pixels.shape)
    ideal = np.concatenate([ideal, np.ones_like(ideal[..., :1])], axis=2)
    over_depth = np.einsum("nij,nkj->nki", view.planes_of(triangles), ideal)
    shares = over_depth / over_depth.sum(axis=2, keepdims=True)
    reference = shares @ view.corners_of(triangles, REFERENCE)
    number = view.body[triangles].astype(np.int64)
    faces, pieces = (
        np.cumsum([0, *counts])[number]
        for counts in ([len(one.faces) for one in surfaces],
                       [len(one.topology.triangles) for one in surfaces])
    )  # fmt: skip
    source = view.source[triangles] - pieces
    vertices, rest = np.empty((len(number), 3), np.int64), np.empty((len(number), 3, 3))
    for one in np.unique(number):
        own = number == one
        vertices[own] = surfaces[one].topology.triangles[source[own]]
        rest[own] = surfaces[one].rest[vertices[own]]
    face = view.face[triangles] - faces
    return MaterialPoints(number, face, vertices, barycentric(reference, rest), reference)


def pick(
    view: View,
    ids: npt.NDArray[np.uint32],
    surfaces: Sequence[Surface],
    column: float,
    row: float,
    skins: Sequence[Skin] = (),
) -> Pick | None:
    """What is seen at a pixel; None for nothing, or outside of the image.

    Parameters
    ----------
    view, ids : of a frame, ``frame.view`` and ``frame.ids()``; ids of the pixel's neighbourhood are
        enough.
    surfaces : those that were rendered, in order.
    column, row : pixel coordinates: whole numbers are the middles of pixels.
    skins : of the first surfaces, which are bodies.

    Everything is found in float64 at the very place asked for, in the plane of the triangle that
    the pixel's centre sees.

    Examples
    --------
    >>> from gpusim.view.content.picking import pick
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (60, 40), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> frame = gs.render([wall], camera, backend="numpy")
    >>> found = pick(frame.view, frame.ids(), [wall], 29.5, 19.5)
    >>> found.name, (found.reference + 0.0).round(9).tolist()
    ('surface', [0.0, 0.0, 0.0])
    """
    i, j = int(np.floor(column + 0.5)), int(np.floor(row + 0.5))
    if not (0 <= i < view.camera.width and 0 <= j < view.camera.height):
        return None
    triangle = int(ids[j, i]) - 1
    if triangle < 0:
        return None
    found = material_points(view, surfaces, np.array([triangle]), np.array([[[column, row]]]))
    number, face, vertices = int(found.surface[0]), int(found.face[0]), found.vertices[0]
    surface, reference, weights = surfaces[number], found.reference[0, 0], found.weights[0, 0]
    element = node = None
    sets: tuple[str, ...] = ()
    if number < len(skins):
        sets = _face_sets(skins[number], face)
        element, node = _element(skins[number], face, reference)
    paint = list(surface.paints)[surface.regions[face]]
    return Pick(
        number, surface.name, paint, face, vertices, weights, reference, element, node, sets
    )


def _face_sets(skin: Skin, face: int) -> tuple[str, ...]:
    """Names of the face sets that a surface's face is in."""
    number = skin.face_of_piece[face]
    own = (skin.faces.cell[number], skin.faces.local[number])
    return tuple(name for name, pairs in skin.mesh.face_sets.items()
                 if (pairs == own).all(axis=1).any())  # fmt: skip


def _element(skin: Skin, face: int, reference: Float) -> tuple[int, int]:
    """The cell that a surface's face is of, and the nearest node of its boundary face."""
    nodes = skin.faces.nodes[skin.face_of_piece[face]]
    nodes = nodes[nodes >= 0]
    nearest = np.argmin(((skin.mesh.points[nodes] - reference) ** 2).sum(axis=1))
    return int(skin.cell_of_piece[face]), int(nodes[nearest])
