"""A scene's mesh recipe turned into a mesh, and what is said of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gpusim import mesh
from gpusim.errors import InputError
from gpusim.field import read_field
from gpusim.files.input_file import Reader, read_input
from gpusim.mesh import Mesh
from gpusim.report import MeshSummary
from gpusim.scene.description import model as m
from gpusim.scene.plausibility import size_warnings

__all__ = ["build_mesh", "mesh_summary", "size_warnings_of"]

_SPLIT = {"tet4": "tet4", "tet10": "tet4", "wedge6": "wedge6", "wedge15": "wedge6"}
_WORST, _LISTED = 5, 20


def build_mesh(recipe: m.MeshRecipe, read: Reader = read_input) -> Mesh:
    """The mesh that a recipe describes, in m; ``read``: how its file is read.

    Raises InputError for a file that can't be read or meshed, and for notches that don't fit.
    """
    if isinstance(recipe, m.FieldMesh):
        return read_field(read(recipe.path), name=recipe.variable, scale=recipe.scale).mesh
    if isinstance(recipe, m.FileMesh):
        return _from_file(recipe, read)
    if isinstance(recipe, m.PlateMesh | m.BracketMesh):
        # midside nodes of bricks lie on the curves
        curved = recipe.cells if recipe.cells in ("hex20", "hex27") else "hex8"
        return _of_cells(_holed(recipe, curved), recipe.cells)
    return _of_cells(_straight(recipe), recipe.cells)


def _straight(recipe: m.BoxMesh | m.BeamMesh | m.CraneMesh) -> Mesh:
    if isinstance(recipe, m.BoxMesh):
        notches = _notches(recipe.notches)
        return mesh.box(recipe.size, recipe.divisions, recipe.origin, notches)
    if isinstance(recipe, m.BeamMesh):
        return mesh.beam(
            recipe.length,
            recipe.width,
            recipe.height,
            recipe.divisions,
            end_width=recipe.end_width,
            end_height=recipe.end_height,
            notches=_notches(recipe.notches),
        )
    return mesh.crane(
        height=recipe.height,
        foot=recipe.foot,
        length=recipe.length,
        column_thickness=recipe.column_thickness,
        beam_thickness=recipe.beam_thickness,
        width=recipe.width,
        load_length=recipe.load_length,
        element_size=recipe.element,
        through=recipe.through,
        across=recipe.across,
    )


def _holed(recipe: m.PlateMesh | m.BracketMesh, element: str) -> Mesh:
    if isinstance(recipe, m.PlateMesh):
        return mesh.plate_with_hole(
            recipe.length,
            recipe.width,
            recipe.thickness,
            recipe.hole_diameter,
            around=recipe.around,
            radial=recipe.radial,
            through=recipe.through,
            element=element,
        )
    return mesh.bracket(
        base_length=recipe.base_length,
        wall_height=recipe.wall_height,
        width=recipe.width,
        thickness=recipe.thickness,
        fillet_radius=recipe.fillet_radius,
        hole_diameter=recipe.hole_diameter,
        around=recipe.around,
        radial=recipe.radial,
        through=recipe.through,
        bend=recipe.bend,
        element=element,
    )


def _notches(recipes: tuple[m.NotchRecipe, ...]) -> list[mesh.Notch]:
    return [mesh.Notch(r.position, r.width, r.depth, r.axis, r.side, r.cells) for r in recipes]


def _of_cells(bricks: Mesh, cells: str) -> Mesh:
    """Bricks turned into the wanted type of element."""
    if cells in bricks.cells:
        return bricks
    grid = mesh.split(bricks, _SPLIT[cells]) if cells in _SPLIT else bricks
    if cells in grid.cells:
        return grid
    return mesh.quadratic(grid, serendipity=cells != "hex27")


def _from_file(recipe: m.FileMesh, read: Reader) -> Mesh:
    file = read(recipe.path)
    if recipe.size is not None:
        return mesh.mesh_cad(
            file,
            size=recipe.size,
            order=recipe.order,
            hexahedra=recipe.hexahedra,
            hex_dominant=recipe.hex_dominant,
            curvature=recipe.curvature,
            time_limit=recipe.time_limit,
            scale=recipe.scale,
        )
    grid = mesh.read_mesh(file, scale=recipe.scale)
    linear = [kind for kind in grid.cells if mesh.CELL_TYPES[kind].linear == kind]
    if recipe.order == 1 or not linear:
        return grid
    if len(linear) < len(grid.cells):
        raise InputError(
            f"{Path(recipe.path).name}: order 2 for a mesh of mixed order; got "
            f"{', '.join(grid.cells)}; expected linear cells"
        )
    return mesh.quadratic(grid)


def size_warnings_of(name: str, recipe: m.MeshRecipe, grid: Mesh) -> list[str]:
    """What is implausible in the size of a mesh from a file; of others the plan has said it."""
    if not isinstance(recipe, m.FileMesh | m.FieldMesh):
        return []
    x, y, z = (float(side) for side in np.ptp(grid.points, axis=0))
    return size_warnings(name, (x, y, z))


def mesh_summary(name: str, grid: Mesh) -> tuple[MeshSummary, list[str]]:
    """What a report says of a body's mesh, and warnings that name the bad cells by number."""
    quality = mesh.mesh_quality(grid)
    bad = quality.bad_cells()
    warnings = []
    if len(bad):
        worst = ", ".join(
            f"{cell} (scaled Jacobian {quality.scaled_jacobian[cell]:.3g}, "
            f"aspect {quality.aspect[cell]:.3g})"
            for cell in bad[:_WORST]
        )
        more = f" and {len(bad) - _WORST} more" if len(bad) > _WORST else ""
        warnings.append(f"body {name!r}: {len(bad)} cells of bad shape: {worst}{more}")
    summary = MeshSummary(
        body=name,
        nodes=grid.node_count,
        cells={kind: len(block) for kind, block in grid.cells.items()},
        least_jacobian=float(quality.scaled_jacobian.min()),
        greatest_aspect=float(quality.aspect.max()),
        bad_count=len(bad),
        bad_cells=tuple(int(cell) for cell in bad[:_LISTED]),
        remark=quality.describe(),
        extent=float(np.linalg.norm(np.ptp(grid.points, axis=0))),
    )
    return summary, warnings
