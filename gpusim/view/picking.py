"""What is under a pixel: the body or prop, its element, node and sets, and the material point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
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
    >>> from gpusim.view.picking import pick
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
    corners = view.corners_of(np.array([triangle]))[0]
    number = int(view.body[triangle])
    surface = surfaces[number]
    face = int(view.face[triangle]) - sum(len(one.faces) for one in surfaces[:number])
    reference = _shares(view, triangle, column, row) @ corners[:, REFERENCE]
    first = sum(len(one.topology.triangles) for one in surfaces[:number])
    vertices = surface.topology.triangles[int(view.source[triangle]) - first]
    weights = barycentric(reference[None, None], surface.rest[vertices][None])[0, 0]
    element = node = None
    sets: tuple[str, ...] = ()
    if number < len(skins):
        sets = _face_sets(skins[number], face)
        element, node = _element(skins[number], face, reference)
    paint = list(surface.paints)[surface.regions[face]]
    return Pick(
        number, surface.name, paint, face, vertices, weights, reference, element, node, sets
    )


def _shares(view: View, triangle: int, column: float, row: float) -> Float:
    """Weights (3,) of a triangle's corners at a pixel position."""
    x, y = view.camera.undistort([column, row])
    over_depth = view.planes_of(np.array([triangle]))[0] @ [x, y, 1.0]
    return np.asarray(over_depth / over_depth.sum())


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
