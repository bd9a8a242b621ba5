"""A scene's ``where`` as nodes, faces and cells of a mesh."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim import mesh
from gpusim.errors import InputError
from gpusim.mesh import Faces, Mesh
from gpusim.scene.description import model as m
from gpusim.surface.surface import face_normals

__all__ = ["cells_of", "faces_of", "nodes_of", "surface_faces_of"]


_FACING = np.deg2rad(30.0)  # as `mesh.select_faces` has it


def nodes_of(grid: Mesh, where: m.Where) -> npt.NDArray[np.int32]:
    """Node numbers. Raises InputError if there are none."""
    return mesh.select_nodes(
        grid,
        bounds=_bounds(where),
        normal=where.normal,
        name=where.set,
        tolerance=where.tolerance,
    )


def faces_of(grid: Mesh, faces: Faces, where: m.Where) -> Faces:
    """Of the boundary ``faces``, or of a named set. Raises InputError if there are none."""
    return mesh.select_faces(
        grid,
        bounds=_bounds(where),
        normal=where.normal,
        name=where.set,
        tolerance=where.tolerance,
        faces=None if where.set is not None else faces,
    )


def surface_faces_of(
    points: npt.NDArray[np.float64], faces: npt.NDArray[np.int32], where: m.Where, told: str
) -> npt.NDArray[np.int64]:
    """Numbers of the faces (F, 4) of a surface without solids, by bounds and outward normal.

    Raises InputError if there are none, or the surface is asked for a named set.
    """
    if where.set is not None:
        raise InputError(f"{told}: where; got set {where.set!r}; expected bounds or a normal: a "
                         "file of faces has no sets")  # fmt: skip
    low = np.array(where.lower) - where.tolerance
    high = np.array(where.upper) + where.tolerance
    inside = np.asarray((points >= low) & (points <= high)).all(axis=1).reshape(-1)
    keep = (inside[np.maximum(faces, 0)] | (faces < 0)).all(axis=1)
    if where.normal is not None:
        normals = face_normals(points, faces)
        along = normals[:, "xyz".index(where.normal[1])] * (1 if where.normal[0] == "+" else -1)
        keep &= along >= np.cos(_FACING) * np.linalg.norm(normals, axis=1)
    if not keep.any():
        raise InputError(
            f"{told}: where: no faces found; expected something inside the surface, from "
            f"{points.min(axis=0).tolist()} m to {points.max(axis=0).tolist()} m"
        )
    return np.flatnonzero(keep)


def cells_of(grid: Mesh, where: m.Where) -> npt.NDArray[np.int64]:
    """Global numbers of the cells whose middle is there. Raises InputError if there are none."""
    low = np.array(where.lower) - where.tolerance
    high = np.array(where.upper) + where.tolerance
    keep = np.zeros(grid.cell_count, dtype=bool)
    for kind, first, block in grid.blocks():
        corners = block[:, : mesh.CELL_TYPES[kind].corners]
        middle = grid.points[corners].mean(axis=1)
        keep[first : first + len(block)] = ((middle >= low) & (middle <= high)).all(axis=1)
    if where.set is not None:
        if where.set not in grid.cell_sets:
            known = ", ".join(sorted(grid.cell_sets))
            expected = f"one of {known}" if known else "no set: the mesh has none of elements"
            raise InputError(f"unknown set of elements; got {where.set!r}; expected {expected}")
        inside = np.zeros_like(keep)
        inside[grid.cell_sets[where.set]] = True
        keep &= inside
    found = np.flatnonzero(keep)
    if not found.size:
        raise InputError(
            f"no elements found; got bounds {_bounds(where) or 'none'}, set {where.set!r}; "
            f"expected something inside the mesh, from {grid.bounds[0].tolist()} m to "
            f"{grid.bounds[1].tolist()} m"
        )
    return found


def _bounds(where: m.Where) -> dict[str, float]:
    """Only the finite limits."""
    limits = {}
    for axis, low, high in zip("xyz", where.lower, where.upper, strict=True):
        limits[f"{axis}_min"], limits[f"{axis}_max"] = low, high
    return {key: value for key, value in limits.items() if np.isfinite(value)}
