"""A scene's mesh recipe turned into a mesh; its ``where`` as nodes, faces and cells of that."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from gpusim import mesh
from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.errors import InputError
from gpusim.field import Field, read_field
from gpusim.files.input_file import InputFile, Reader, read_input
from gpusim.mesh import Faces, Mesh
from gpusim.mesh.formats.cad_cache import cached_cad_mesh, is_kept
from gpusim.mesh.selection import EmptySelection, UnknownSet
from gpusim.pipeline.scene_objects.arguments import arguments_of
from gpusim.report import MeshSummary
from gpusim.scene.description import model as m
from gpusim.scene.plausibility import size_warnings
from gpusim.surface.surface import face_normals
from gpusim.validation import by_number, require

_SPLIT = {"tet4": "tet4", "tet10": "tet4", "wedge6": "wedge6", "wedge15": "wedge6"}
_WORST, _LISTED = 5, 20
BUILDERS: dict[type, Callable[..., Mesh]] = {
    m.BoxMeshTable: mesh.box,
    m.BeamMeshTable: mesh.beam,
    m.CraneMeshTable: mesh.crane,
    m.PlateMeshTable: mesh.plate_with_hole,
    m.BracketMeshTable: mesh.bracket,
}


@contextmanager
def naming_place(where: str) -> Iterator[None]:
    """Say of which entry of the scene an error is."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def build_mesh(recipe: m.MeshRecipe, read: Reader = read_input) -> Mesh:
    """The mesh that a recipe describes, in m; ``read``: how its file is read.

    Raises InputError for a file that can't be read or meshed, and for notches that don't fit.
    """
    if isinstance(recipe, m.FieldMeshTable):
        return read_given_field(recipe, read).mesh
    if isinstance(recipe, m.FileMeshTable):
        return _from_file(recipe, read)
    builder = BUILDERS[type(recipe)]
    values = arguments_of(builder, recipe)
    if isinstance(recipe, m.BoxMeshTable | m.BeamMeshTable):
        notches = [arguments_of(mesh.Notch, notch) for notch in recipe.notches]
        values["notches"] = [mesh.Notch(**notch) for notch in notches]
    if isinstance(recipe, m.CraneMeshTable):
        values["element_size"] = recipe.element
    elif isinstance(recipe, m.PlateMeshTable | m.BracketMeshTable):
        # midside nodes of bricks lie on the curves
        values["element"] = recipe.cells if recipe.cells in ("hex20", "hex27") else "hex8"
    return _of_cells(builder(**values), recipe.cells)


def read_given_field(recipe: m.FieldMeshTable, read: Reader = read_input) -> Field:
    """The displacements that a body is given, on their mesh."""
    return read_field(
        read(recipe.path), name=recipe.variable, scale=recipe.scale, magnify=recipe.magnify
    )


def _of_cells(bricks: Mesh, cells: str) -> Mesh:
    """Bricks turned into the wanted type of element."""
    if cells in bricks.cells:
        return bricks
    grid = mesh.split(bricks, _SPLIT[cells]) if cells in _SPLIT else bricks
    if cells in grid.cells:
        return grid
    return mesh.quadratic(grid, serendipity=mesh.CELL_TYPES[cells].serendipity)


def _from_file(recipe: m.FileMeshTable, read: Reader) -> Mesh:
    file = read(recipe.path)
    if recipe.size is not None:
        return cached_cad_mesh(**_cad_arguments(recipe, file))
    grid = mesh.read_mesh(file, scale=recipe.scale)
    linear = [kind for kind in grid.cells if mesh.CELL_TYPES[kind].linear == kind]
    if recipe.order == 1 or not linear:
        return grid
    what = f"{Path(recipe.path).name}: order 2 for a mesh of mixed order"
    require(len(linear) == len(grid.cells), what, ", ".join(grid.cells), "linear cells")
    return mesh.quadratic(grid)


def _cad_arguments(recipe: m.FileMeshTable, file: InputFile) -> dict[str, Any]:
    return {**arguments_of(mesh.mesh_cad, recipe), "path": file}


def waits_for_gmsh(recipe: m.MeshRecipe, read: Reader = read_input) -> bool:
    """Whether a mesh is that of a CAD file which hasn't been meshed before."""
    if not isinstance(recipe, m.FileMeshTable) or recipe.size is None:
        return False
    return not is_kept(**_cad_arguments(recipe, read(recipe.path)))


def size_warnings_of(name: str, recipe: m.MeshRecipe, grid: Mesh) -> list[str]:
    """What is implausible in the size of a mesh from a file; of others the plan has said it."""
    if not isinstance(recipe, m.FileMeshTable | m.FieldMeshTable):
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


_FACING = np.deg2rad(30.0)  # as `mesh.select_faces` has it


def nodes_of(grid: Mesh, where: m.WhereTable) -> Int:
    """Node numbers. Raises InputError if there are none."""
    with _in_words_of_scenes("nodes", where, grid):
        return mesh.select_nodes(grid, **_conditions(where))


def faces_of(grid: Mesh, faces: Faces, where: m.WhereTable) -> Faces:
    """Of the boundary ``faces``, or of a named set. Raises InputError if there are none."""
    among = None if where.set is not None else faces
    with _in_words_of_scenes("faces", where, grid):
        return mesh.select_faces(grid, faces=among, **_conditions(where))


@contextmanager
def _in_words_of_scenes(what: str, where: m.WhereTable, grid: Mesh) -> Iterator[None]:
    """Errors of a selection of ``what`` by keys of a ``where``."""
    try:
        yield
    except EmptySelection as error:
        raise _none_found(what, where, grid.points) from error
    except UnknownSet as error:
        raise InputError(f"where.set: {str(error).partition(': ')[2]}") from error


def surface_faces_of(points: Float, faces: Int, where: m.WhereTable) -> Long:
    """Numbers of the faces (F, 4) of a surface without solids, by bounds and outward normal.

    Raises InputError if there are none, or the surface is asked for a named set.
    """
    expected = "bounds or a normal: a file of faces has no sets"
    require(where.set is None, "where", f"set {where.set!r}", expected)
    inside = _within(points, where)
    keep = (inside[np.maximum(faces, 0)] | (faces < 0)).all(axis=1)
    if where.normal is not None:
        normals = face_normals(points, faces)
        along = normals[:, "xyz".index(where.normal[1])] * (1 if where.normal[0] == "+" else -1)
        keep &= along >= np.cos(_FACING) * np.linalg.norm(normals, axis=1)
    if not keep.any():
        raise _none_found("faces", where, points)
    return np.flatnonzero(keep)


def cells_of(grid: Mesh, where: m.WhereTable) -> Long:
    """Global numbers of the cells whose middle is there. Raises InputError if there are none."""
    keep = np.zeros(grid.cell_count, dtype=bool)
    for kind, first, block in grid.blocks():
        corners = block[:, : mesh.CELL_TYPES[kind].corners]
        middle = grid.points[corners].mean(axis=1)
        keep[first : first + len(block)] = _within(middle, where)
    if where.set is not None:
        if where.set not in grid.cell_sets:
            known = ", ".join(by_number(grid.cell_sets))
            expected = f"one of {known}" if known else "no set: the mesh has none of elements"
            raise InputError(f"unknown set of elements; got {where.set!r}; expected {expected}")
        inside = np.zeros_like(keep)
        inside[grid.cell_sets[where.set]] = True
        keep &= inside
    found = np.flatnonzero(keep)
    if not found.size:
        raise _none_found("elements", where, grid.points)
    return found


def _within(points: Float, where: m.WhereTable) -> Bool:
    low = np.array(where.lower) - where.tolerance
    high = np.array(where.upper) + where.tolerance
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _none_found(what: str, where: m.WhereTable, points: Float) -> InputError:
    """In the words and units of a scene file."""
    asked = [f"{key}_mm {1e3 * value:.6g}" for key, value in _bounds(where).items()]
    asked += [f"normal {where.normal}"] * (where.normal is not None)
    asked += [f"set {where.set!r}"] * (where.set is not None)
    low, high = 1e3 * points.min(axis=0), 1e3 * points.max(axis=0)
    there = ", ".join(f"{axis} {low[k]:.6g} … {high[k]:.6g}" for k, axis in enumerate("xyz"))
    return InputError(
        f"where: no {what} found; got {', '.join(asked) or 'no condition'}; expected a part of "
        f"{there} mm"
    )


def _conditions(where: m.WhereTable) -> dict[str, Any]:
    """As `mesh.select_nodes` and `mesh.select_faces` take them."""
    return {
        "bounds": _bounds(where),
        "normal": where.normal,
        "name": where.set,
        "tolerance": where.tolerance,
    }


def _bounds(where: m.WhereTable) -> dict[str, float]:
    """Those that are given."""
    names = [f"{axis}_{end}" for axis in "xyz" for end in ("min", "max")]
    limits = {name: getattr(where, name) for name in names}
    return {name: value for name, value in limits.items() if value is not None}
