"""A mesh: its counts, sets and quality, and its skin."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from gpusim.mesh import Mesh, boundary_faces, mesh_quality
from gpusim.notebook.axes import METAL, draw_faces, space_axes
from gpusim.notebook.page import Picture, page, quantity
from gpusim.notebook.shading import fitted_camera, shaded
from gpusim.surface import Skin, Surface
from gpusim.surface.paint import Plain

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MOST_CELLS = 400_000
"""Of a mesh that is shown without being asked for: about a second to find its skin."""
_MOST_JUDGED = 100_000
_MOST_SETS = 6
UNIT_NOTE = "Lengths are in the mesh's own unit: m where a scene made it."


def html(mesh: Mesh) -> str:
    """Counts, extent, quality, named sets; the skin."""
    rows = [
        ("nodes", f"{mesh.node_count:,}"),
        ("cells", ", ".join(f"{len(block):,} {kind}" for kind, block in mesh.cells.items())),
        *box_rows(mesh.bounds),
    ]
    if mesh.cell_count <= _MOST_JUDGED:
        quality = mesh_quality(mesh)
        rows.append(("least scaled Jacobian", quantity(quality.scaled_jacobian.min(), digits=3)))
        rows.append(("greatest aspect ratio", quantity(quality.aspect.max(), digits=3)))
    for name, sets in (
        ("node sets", mesh.node_sets),
        ("face sets", mesh.face_sets),
        ("cell sets", mesh.cell_sets),
    ):
        if sets:
            shown = [f"{key} ({len(sets[key]):,})" for key in list(sets)[:_MOST_SETS]]
            rows.append((name, ", ".join(shown) + (", …" if len(sets) > _MOST_SETS else "")))
    if len(mesh.dangling_nodes):
        rows.append(("nodes of no cell", f"{len(mesh.dangling_nodes):,}"))
    if mesh.cell_count > MOST_CELLS:
        return page("Mesh", rows, notes=[UNIT_NOTE, "Not drawn for its size: plot() draws it."])
    return page("Mesh", rows, [partial(mesh_picture, mesh)], [UNIT_NOTE])


def plot(mesh: Mesh, ax: Axes | None, *, unit: str = "m", **style: Any) -> Any:
    """The skin with the edges of its cells, in axes of three dimensions."""
    space = space_axes(ax, unit)
    skin = skin_of(mesh)
    draw_faces(space, skin.at_vertices(mesh.points), skin.pieces, **style)
    return space


def box_rows(bounds: np.ndarray[Any, Any]) -> list[tuple[str, str]]:
    """Rows that say where something (2, 3) is, and how large."""
    sides = " x ".join(quantity(side) for side in bounds[1] - bounds[0])
    corner = ", ".join(quantity(value) for value in bounds[0])
    return [("size along x, y, z", sides), ("lowest corner", corner)]


def skin_of(mesh: Mesh) -> Skin:
    """The mesh's boundary."""
    return Skin(mesh, boundary_faces(mesh))


def metal_surface(skin: Skin) -> Surface:
    """A skin without paint."""
    region = np.zeros(len(skin.faces), np.int32)
    return skin.surface({"skin": Plain(METAL[1])}, region, {}, "skin")


def mesh_picture(mesh: Mesh) -> Picture:
    """The skin with the edges of its cells, seen by a fitted camera."""
    skin = skin_of(mesh)
    surface = metal_surface(skin)
    camera = fitted_camera(surface.points)
    pixels = shaded(
        [surface], camera, lambda truth: np.broadcast_to(METAL, (len(truth.row), 3)),
        skin.face_of_piece,
    )  # fmt: skip
    return Picture("the mesh's skin", pixels)
