"""Consistent nodal forces: each function returns (N,3) float64, to be added up freely.

Loads act on the undeformed mesh. Forces that belong to strains are in ``thermal_loads``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.fem.elements.element import ELEMENTS, face_groups
from gpusim.fem.elements.isoparametric_map import add_to, volumes
from gpusim.mesh import CELL_TYPES, Faces, Mesh
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import finite_numbers, require, unmasked

_CHUNK = 16384
# Gauss points on [-1, 1]; the nodes of an edge are at -1, 1 and, if it has a midside node, 0
_PLACE = np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
_WEIGHT = np.array([5.0, 8.0, 5.0]) / 9.0
_SHAPE = {
    2: np.stack([0.5 * (1.0 - _PLACE), 0.5 * (1.0 + _PLACE)], axis=1),
    3: np.stack([0.5 * _PLACE * (_PLACE - 1), 0.5 * _PLACE * (_PLACE + 1), 1 - _PLACE**2], axis=1),
}
_SLOPE = {
    2: np.full((3, 2), [-0.5, 0.5]),
    3: np.stack([_PLACE - 0.5, _PLACE + 0.5, -2.0 * _PLACE], axis=1),
}


@unmasked()
@one_blas_thread()
def nodal_force(mesh: Mesh, nodes: npt.ArrayLike, total: npt.ArrayLike) -> Float:
    """``total`` (3,) shared equally by ``nodes`` (K,).

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> float(gs.fem.nodal_force(bar, gs.mesh.select_nodes(bar, name="x_max"), (0, 0, -10)).min())
    -2.5
    """
    numbers = node_numbers("nodal_force: nodes", mesh, nodes)
    forces = np.zeros((mesh.node_count, 3))
    forces[numbers] = vector("nodal_force: total", total) / len(numbers)
    return forces


def node_numbers(what: str, mesh: Mesh, nodes: npt.ArrayLike) -> Long:
    """(K,) distinct ones, ascending. Raises InputError naming ``what`` if there are none, or some
    that the mesh doesn't have."""
    given = np.asarray(nodes)
    whole = not given.size or given.dtype.kind in "iu"
    require(whole, what, given.dtype, "integer node numbers")
    numbers = distinct(given.astype(np.int64))
    inside = numbers.size > 0 and numbers[0] >= 0 and numbers[-1] < mesh.node_count
    got = f"{numbers.size} numbers {numbers[:3].tolist()}…"
    require(bool(inside), what, got, f"at least one in 0 … {mesh.node_count - 1}")
    return numbers


@unmasked()
@one_blas_thread()
def face_force(mesh: Mesh, faces: Faces, total: npt.ArrayLike) -> Float:
    """``total`` (3,) spread uniformly over the area of ``faces``.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> end = gs.mesh.select_faces(bar, name="x_max")
    >>> gs.fem.face_force(bar, end, total=(0, 0, -10)).sum(axis=0)
    array([  0.,   0., -10.])
    """
    force = vector("face_force: total", total)
    weights = _integrate(mesh, faces, _area)
    return np.asarray(weights * (force / weights[:, 0].sum()))


@unmasked()
@one_blas_thread()
def traction(mesh: Mesh, faces: Faces, value: npt.ArrayLike) -> Float:
    """Force per area ``value`` (3,) on the undeformed ``faces``.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> end = gs.mesh.select_faces(bar, name="x_max")
    >>> gs.fem.traction(bar, end, (5.0, 0, 0)).sum(axis=0).round(6)
    array([5., 0., 0.])
    """
    stress = vector("traction: value", value)
    return _integrate(mesh, faces, _area) * stress


def pressure(mesh: Mesh, faces: Faces, value: float) -> Float:
    """Pressure ``value`` (positive pushes into the body) on the undeformed ``faces``.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> top = gs.mesh.select_faces(bar, normal="+z")
    >>> gs.fem.pressure(bar, top, 3.0).sum(axis=0).round(6) + 0.0
    array([ 0.,  0., -6.])
    """
    require(np.isfinite(value), "pressure: value", value, "a finite number")
    return _integrate(mesh, faces, lambda normal: -value * normal)


@unmasked()
@one_blas_thread()
def body_force(
    mesh: Mesh,
    density: npt.ArrayLike,
    acceleration: npt.ArrayLike,
    *,
    formulation: Mapping[str, str] | None = None,
) -> Float:
    """Gravity and the like: ``density`` times ``acceleration`` (3,).

    density : scalar or (M,) per cell.
    formulation : cell type -> formulation whose stiffness rule integrates (other programs do so);
        None: a rule that is exact on straight cells.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.fem.body_force(bar, density=1000.0, acceleration=(0, 0, -9.81)).sum(axis=0).round(3)
    array([     0.,      0., -19620.])
    """
    constant = vector("body_force: acceleration", acceleration)

    def everywhere(place: Float) -> Float:
        return np.broadcast_to(constant, place.shape)

    return _inertia_force("body_force", mesh, density, everywhere, formulation)


@unmasked()
@one_blas_thread()
def centrifugal(
    mesh: Mesh,
    density: npt.ArrayLike,
    axis_point: npt.ArrayLike,
    axis: npt.ArrayLike,
    omega: float,
    *,
    formulation: Mapping[str, str] | None = None,
) -> Float:
    """Steady rotation: density omega^2 times the distance vector from the axis, outward.

    density : scalar or (M,) per cell.
    axis_point, axis : (3,) a point on the axis and its direction (any length > 0).
    omega : angular velocity, rad per unit of time; its sign doesn't matter.
    formulation : as for ``body_force``.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1), origin=(0, -0.5, -0.5))
    >>> forces = gs.fem.centrifugal(bar, 1000.0, axis_point=(0, 0, 0), axis=(0, 0, 1), omega=10.0)
    >>> print(f"{forces[:, 0].sum():.1f}")
    200000.0
    """
    origin = vector("centrifugal: axis_point", axis_point)
    direction = vector("centrifugal: axis", axis)
    length = float(np.linalg.norm(direction))
    require(length > 0.0, "centrifugal: axis", axis, "a direction that isn't zero")
    require(np.isfinite(omega), "centrifugal: omega", omega, "a finite number")
    direction = direction / length

    def acceleration(place: Float) -> Float:
        arm = place - origin
        return np.asarray(omega**2 * (arm - (arm @ direction)[..., None] * direction))

    return _inertia_force("centrifugal", mesh, density, acceleration, formulation)


def _inertia_force(
    what: str,
    mesh: Mesh,
    density: npt.ArrayLike,
    acceleration: Callable[[Float], Float],
    formulation: Mapping[str, str] | None,
) -> Float:
    """Integral of shape function x density x ``acceleration`` of the place (…,3) -> (…,3)."""
    shape = (mesh.cell_count,)
    expected = f"a finite number or {shape} of them"
    rho = finite_numbers(density, f"{what}: density", ((), shape), expected)
    rho = np.broadcast_to(rho, shape)
    forces = np.zeros((mesh.node_count, 3))
    for kind, first, block in mesh.blocks():
        element = ELEMENTS[kind]
        name = (formulation or {}).get(kind)
        rule = element.mass if name is None else element.rule(name)
        for start in range(0, len(block), _CHUNK):
            cells = block[start : start + _CHUNK]
            nodes = mesh.points[cells]
            mass = volumes(nodes, rule)
            mass *= rho[first + start : first + start + len(cells), None]
            load = acceleration(np.matmul(rule.shape, nodes)) * mass[..., None]
            add_to(forces, cells, np.matmul(rule.shape.T, load))
    return forces


def vector(where: str, value: npt.ArrayLike) -> Float:
    """(3,) finite float64, or InputError."""
    return finite_numbers(value, where, [(3,)], "3 finite numbers")


def _area(normal: Float) -> Float:
    size = np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.broadcast_to(size, normal.shape)


def _integrate(mesh: Mesh, faces: Faces, density: Callable[[Float], Float]) -> Float:
    """(N,3) nodal integrals of shape function x density(area vectors (…,3)) over the faces."""
    require(len(faces) > 0, "face load: no faces", "an empty selection", "at least one face")
    forces = np.zeros((mesh.node_count, 3))
    for element, _, nodes in face_groups(faces):
        share = np.matmul(element.shape.T, density(element.area_vectors(mesh.points, nodes)))
        add_to(forces, nodes, share)
    return forces


@unmasked()
@one_blas_thread()
def line_force(mesh: Mesh, nodes: npt.ArrayLike, total: npt.ArrayLike) -> Float:
    """``total`` (3,) spread uniformly over the length of the line through ``nodes``: (N,3).

    nodes : (K,) node numbers in any order. The line is made of the cell edges whose nodes are all
        among them; it may have several pieces but no branches, and each node must lie on it.
        Corners of a straight edge get 1/2 of its share; with a midside node 1/6, 1/6 and 2/3.

    Raises InputError if the nodes don't form a line.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> edge = gs.mesh.select_nodes(bar, bounds={"x_min": 2.0, "z_min": 1.0})
    >>> gs.fem.line_force(bar, edge, total=(0, 0, -10)).sum(axis=0)
    array([  0.,   0., -10.])
    """
    force = vector("line_force: total", total)
    edges = node_line(mesh, nodes)
    nodal = np.zeros(mesh.node_count)
    for width in (2, 3):
        line_edges = edges[(edges[:, 2] >= 0) == (width == 3)][:, :width]
        points = mesh.points[line_edges]
        points = points - points[:, :1]
        length = np.linalg.norm(np.einsum("eki,qk->eqi", points, _SLOPE[width]), axis=2) * _WEIGHT
        share = length @ _SHAPE[width]
        nodal += np.bincount(line_edges.ravel(), share.ravel(), minlength=mesh.node_count)
    return np.asarray(nodal[:, None] * (force / nodal.sum()))


def node_line(mesh: Mesh, nodes: npt.ArrayLike) -> Int:
    """(E,3) edges (end, end, midside or -1) of the line through ``nodes``; see `line_force`."""
    given = np.asarray(nodes)
    fits = given.ndim == 1 and given.dtype.kind in "iu" and given.size > 0
    got = f"shape {given.shape}, {given.dtype}"
    require(fits, "line_force: nodes", got, "(K,) integer node numbers")
    first, last = given.min(), given.max()
    inside = first >= 0 and last < mesh.node_count
    require(inside, "line_force: nodes", f"{first} … {last}", f"0 … {mesh.node_count - 1}")
    chosen = np.zeros(mesh.node_count, dtype=bool)
    chosen[given] = True
    edges = np.unique(_edges_between(mesh, chosen), axis=0)
    ends = np.bincount(edges[:, :2].ravel(), minlength=mesh.node_count)
    covered = np.zeros(mesh.node_count, dtype=bool)
    covered[edges[edges >= 0]] = True
    alone = np.flatnonzero(chosen & ~covered)
    if alone.size:
        raise InputError(
            f"line_force: {alone.size} nodes aren't joined to the others by a cell edge; got node "
            f"{alone[0]} at {mesh.points[alone[0]].tolist()}; expected the nodes of a line of edges"
        )
    what = "line_force: the nodes form an area or branches, not a line"
    got = f"{ends.max()} edges at node {int(np.argmax(ends))}"
    require(ends.max() <= 2, what, got, "at most two")
    return edges


def _edges_between(mesh: Mesh, chosen: Bool) -> Int:
    """(E,3) cell edges with all of their nodes chosen, ends ascending, midside or -1."""
    chosen_edges = [np.zeros((0, 3), dtype=np.int32)]
    for kind, _, block in mesh.blocks():
        cell = CELL_TYPES[kind]
        middle = {frozenset(p): cell.corners + k for k, p in enumerate(cell.parents)}
        for a, b in cell.edges.tolist():
            between = middle.get(frozenset((a, b)))
            ends = np.sort(block[:, [a, b]], axis=1)
            keep = chosen[ends].all(axis=1)
            last = np.full(len(block), -1, dtype=np.int32)
            if between is not None:
                last = block[:, between]
                keep &= chosen[last]
            chosen_edges.append(np.column_stack([ends, last])[keep])
    return np.concatenate(chosen_edges)
