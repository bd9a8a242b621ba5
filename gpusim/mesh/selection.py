"""Named and geometric selections of nodes and faces.

A selection that finds nothing is an InputError that says where the mesh is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Annotated

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int
from gpusim.errors import InputError, nearest_name
from gpusim.mesh.boundary import Faces, boundary_faces, set_faces
from gpusim.mesh.mesh import Mesh
from gpusim.validation import FromZero, by_number, checked, require, require_one_of, within

Bounds = Mapping[str, float]
Plane = tuple[npt.ArrayLike, npt.ArrayLike]

_AXES = {
    "+x": (1.0, 0.0, 0.0), "-x": (-1.0, 0.0, 0.0), "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0), "+z": (0.0, 0.0, 1.0), "-z": (0.0, 0.0, -1.0),
}  # fmt: skip
_BOUND_KEYS = tuple(f"{axis}_{side}" for axis in "xyz" for side in ("min", "max"))


class UnknownSet(InputError):
    """The mesh has no set of that name."""


class EmptySelection(InputError):
    """Nothing of the mesh is where it was asked for."""


@checked
def select_nodes(
    mesh: Mesh,
    *,
    bounds: Bounds | None = None,
    plane: Plane | None = None,
    normal: str | npt.ArrayLike | None = None,
    name: str | None = None,
    tolerance: FromZero | None = None,
) -> Int:
    """Numbers of the nodes that meet every given condition, sorted, (K,) int32.

    bounds : any of ``x_min … z_max`` -> coordinate, inclusive within ``tolerance``.
    plane : (point, normal); nodes nearer than ``tolerance``.
    normal : nodes of the boundary faces that look this way (see ``select_faces``).
    name : a node set, else a face set or a cell set (its nodes).
    tolerance : length; default 1e-6 of the mesh's largest extent.

    Dangling nodes are never selected by geometry. Raises InputError when nothing is found.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.mesh.select_nodes(bar, bounds={"x_max": 0.0})
    array([0, 3, 6, 9], dtype=int32)
    """
    length = _tolerance(mesh, tolerance)
    keep = np.ones(mesh.node_count, dtype=bool)
    keep[mesh.dangling_nodes] = False
    if name is not None:
        keep[:] = False
        keep[_named_nodes(mesh, name)] = True
    if bounds is not None:
        keep &= _inside(mesh.points, bounds, length)
    if plane is not None:
        keep &= _on_plane(mesh.points, plane, length)
    if normal is not None:
        facing = np.zeros(mesh.node_count, dtype=bool)
        facing[select_faces(mesh, normal=normal).node_numbers()] = True
        keep &= facing
    return _found(mesh, np.flatnonzero(keep).astype(np.int32), "nodes", bounds, plane, name, normal)


@checked
def select_faces(
    mesh: Mesh,
    *,
    bounds: Bounds | None = None,
    plane: Plane | None = None,
    normal: str | npt.ArrayLike | None = None,
    angle: Annotated[float, within(0.0, np.pi, "rad")] = np.deg2rad(30.0),
    name: str | None = None,
    tolerance: FromZero | None = None,
    faces: Faces | None = None,
) -> Faces:
    """The boundary faces that meet every given condition.

    bounds, plane : every node of the face must meet them (see ``select_nodes``).
    normal : "+x" … "-z" or a vector; outward normals within ``angle`` (rad) of it.
    name : a face set of the mesh; else the boundary faces of a cell set, or those whose corners
        are all in a node set.
    faces : start from these instead of ``boundary_faces(mesh)``.

    Raises InputError when nothing is found.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> float(gs.mesh.select_faces(bar, normal="+z").areas.sum())
    2.0
    """
    length = _tolerance(mesh, tolerance)
    if name is not None:
        faces = _named_faces(mesh, name, faces)
    elif faces is None:
        faces = boundary_faces(mesh)
    keep = np.ones(len(faces), dtype=bool)
    real = faces.nodes >= 0
    nodes = np.maximum(faces.nodes, 0)
    if bounds is not None:
        keep &= (_inside(mesh.points, bounds, length)[nodes] | ~real).all(axis=1)
    if plane is not None:
        keep &= (_on_plane(mesh.points, plane, length)[nodes] | ~real).all(axis=1)
    if normal is not None:
        keep &= faces.normals @ _direction(normal) >= np.cos(angle) - 1e-12
    found = np.flatnonzero(keep)
    return faces[_found(mesh, found.astype(np.int32), "faces", bounds, plane, name, normal)]


def _tolerance(mesh: Mesh, tolerance: float | None) -> float:
    if tolerance is None:
        return 1e-6 * float((mesh.bounds[1] - mesh.bounds[0]).max())
    return float(tolerance)


def _named_nodes(mesh: Mesh, name: str) -> Int:
    if name in mesh.node_sets:
        return mesh.node_sets[name]
    if name in mesh.face_sets:
        return set_faces(mesh, mesh.face_sets[name]).node_numbers()
    if name in mesh.cell_sets:
        inside = np.zeros(mesh.node_count, dtype=bool)
        chosen = _chosen_cells(mesh, name)
        for _, first, block in mesh.blocks():
            inside[block[chosen[first : first + len(block)]].ravel()] = True
        return np.flatnonzero(inside).astype(np.int32)
    raise _unknown_set("select_nodes", mesh, name)


def _named_faces(mesh: Mesh, name: str, faces: Faces | None) -> Faces:
    if name in mesh.face_sets:
        return set_faces(mesh, mesh.face_sets[name])
    if name not in mesh.node_sets and name not in mesh.cell_sets:
        raise _unknown_set("select_faces", mesh, name)
    faces = boundary_faces(mesh) if faces is None else faces
    if name in mesh.cell_sets:
        return faces[np.flatnonzero(_chosen_cells(mesh, name)[faces.cell])]
    inside = np.zeros(mesh.node_count, dtype=bool)
    inside[mesh.node_sets[name]] = True
    corners = faces.nodes[:, :4]
    whole = (inside[np.maximum(corners, 0)] | (corners < 0)).all(axis=1)
    return faces[np.flatnonzero(whole)]


def _chosen_cells(mesh: Mesh, name: str) -> Bool:
    chosen = np.zeros(mesh.cell_count, dtype=bool)
    chosen[mesh.cell_sets[name]] = True
    return chosen


def _unknown_set(where: str, mesh: Mesh, name: str) -> InputError:
    known = {*mesh.node_sets, *mesh.face_sets, *mesh.cell_sets}
    return UnknownSet(f"{where}: unknown set; got {name!r}; expected {_one_of(name, known)}")


def _one_of(name: str, known: Iterable[str]) -> str:
    """The names there are, and the one that was probably meant."""
    names = by_number(known)
    if not names:
        return "no name: the mesh has no sets"
    shown = ", ".join(names[:30]) + (", …" if len(names) > 30 else "")
    return f"one of {shown}{nearest_name(repr(name), map(repr, names))}"


def _inside(points: Float, bounds: Bounds, tolerance: float) -> Bool:
    keep = np.ones(len(points), dtype=bool)
    for key, value in bounds.items():
        require_one_of("selection: unknown bound", key, _BOUND_KEYS)
        require(np.isfinite(value), f"selection: {key}", value, "a finite coordinate")
        coordinate = points[:, "xyz".index(key[0])]
        if key.endswith("min"):
            keep &= coordinate >= value - tolerance
        else:
            keep &= coordinate <= value + tolerance
    return keep


def _on_plane(points: Float, plane: Plane, tolerance: float) -> Bool:
    origin = np.asarray(plane[0], dtype=np.float64)
    if origin.shape != (3,) or not np.isfinite(origin).all():
        raise InputError(f"selection: plane point; got {plane[0]}; expected 3 finite numbers")
    distance = (points - origin) @ _direction(plane[1])
    return np.asarray(np.abs(distance) <= tolerance)


def _direction(value: str | npt.ArrayLike) -> Float:
    if isinstance(value, str):
        expected = f"one of {', '.join(_AXES)} or a vector"
        require(value in _AXES, "selection: unknown direction", repr(value), expected)
        return np.array(_AXES[value])
    vector = np.asarray(value, dtype=np.float64)
    length = float(np.linalg.norm(vector)) if vector.shape == (3,) else 0.0
    if not (np.isfinite(length) and length > 0.0):
        raise InputError(f"selection: direction; got {value}; expected a non-zero 3-vector")
    return vector / length


def _found(mesh: Mesh, found: Int, what: str, *conditions: object) -> Int:
    if found.size:
        return found
    labels = ("bounds", "plane", "name", "normal")
    asked = ", ".join(
        f"{label} {value}"
        for label, value in zip(labels, conditions, strict=True)
        if value is not None
    )
    raise EmptySelection(
        f"selection: no {what} found; got {asked or 'no condition'}; expected something inside the "
        f"mesh, {extents(mesh.bounds)}"
    )


def extents(bounds: Float) -> str:
    """What a message says of bounds (2,3)."""
    return ", ".join(f"{axis} {a:.6g} … {b:.6g}" for axis, a, b in zip("xyz", *bounds, strict=True))
