"""Supports: planes of symmetry, and which rigid-body motions supports leave free."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakSet

import numpy as np
import numpy.typing as npt
from scipy.ndimage import label
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.unique import distinct, mix
from gpusim.errors import InputError
from gpusim.fem.lattice.lattice import Lattice
from gpusim.fem.model.elimination import normalised_equations
from gpusim.fem.model.model import Model
from gpusim.mesh import Faces, Mesh
from gpusim.mesh.cell_types import CELL_TYPES
from gpusim.validation import require

# models that have passed: they and their arrays can't change
_HELD: WeakSet[Model] = WeakSet()
# beyond this many face-connected parts in one body, parts are taken as joined at shared nodes
_MOST_PARTS = 60
_AS_ONE = 1e-6  # parts whose free motions differ by less move together
_THINNEST = 1e-7  # of its length: squared, a side's part in the rows is rounding


def symmetry(mesh: Mesh, faces: Faces) -> Bool:
    """(N,3) bool for ``Model.fixed``: the displacement along the normal of flat ``faces``.

    The faces must lie in one plane x, y or z = constant (1e-6 of the mesh's extent): supports are
    along the axes. Raises InputError otherwise, saying what the faces look like.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.fem.symmetry(bar, gs.mesh.select_faces(bar, name="y_min")).sum(axis=0)
    array([0, 6, 0])
    """
    require(len(faces) > 0, "symmetry: no faces", "an empty selection", "at least one face")
    normals = faces.normals
    mean = normals.mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    nodes = faces.node_numbers()
    along = mesh.points[nodes, axis]
    extent = float((mesh.bounds[1] - mesh.bounds[0]).max())
    thickness = float(along.max() - along.min())
    tilted = normals[np.argmin(np.abs(normals[:, axis]))]
    shown = ", ".join(f"{value:.4g}" for value in tilted)
    require(
        thickness <= 1e-6 * extent,
        f"symmetry: the {len(faces)} faces aren't in one plane across an axis",
        f"{'xyz'[axis]} from {along.min():.6g} to {along.max():.6g}, a normal ({shown})",
        "a flat selection that looks along x, y or z (turn the mesh so that the plane of symmetry "
        "does)",
    )
    fixed = np.zeros((mesh.node_count, 3), dtype=bool)
    fixed[nodes, axis] = True
    return fixed


def rigid_modes(points: Float, origin: Float, length: float) -> Float:
    """(N,3,6): translations x y z, rotations about x y z through ``origin``, over ``length``."""
    modes = np.zeros((len(points), 3, 6))
    modes[:, [0, 1, 2], [0, 1, 2]] = 1.0
    x, y, z = ((points - origin) / length).T
    modes[:, 1, 3], modes[:, 2, 3] = -z, y
    modes[:, 0, 4], modes[:, 2, 4] = z, -x
    modes[:, 0, 5], modes[:, 1, 5] = -y, x
    return modes


@dataclass(frozen=True, eq=False)
class FreeMotions:
    """Of one body that supports and constraints don't hold: its nodes ``node`` (n,), once for each
    ``part`` (n,) that has them, and ``motions`` (P,6,k) of the parts, in `rigid_modes` about
    ``origin`` over ``length``; ``as_one``: all parts move alike, as a rigid body, translations
    first, and not as a mechanism. ``how`` parts are joined."""

    node: Long
    part: Long
    motions: Float
    as_one: bool
    origin: Float
    length: float
    how: str

    @property
    def names(self) -> list[str]:
        """In plain words."""
        count = self.motions.shape[2]
        if not self.as_one:
            return [f"{count} motions"]
        return [_name(mode, self.origin, self.length) for mode in self.motions[0].T]

    def displacements(self, points: Float) -> Float:
        """(k,N,3) of the mesh's ``points`` (N,3)."""
        modes = rigid_modes(points[self.node], self.origin, self.length)
        u = np.zeros((self.motions.shape[2], *points.shape))
        u[:, self.node] = np.einsum("naj,njk->kna", modes, self.motions[self.part])
        return u


def check_supports(model: Model, lattice: Lattice | None = None) -> None:
    """Refuse a model that can move without deforming; ``lattice`` of its cells, if it is known.

    Cells are joined into parts through shared faces, and parts into bodies through shared nodes
    (a hinge). For each body the rank of all constraints on the six rigid-body motions of every
    part is found: one row per fixed degree of freedom, three per node that parts share, one per
    equation; bodies that equations join are looked at together.

    A model that has passed isn't looked at again. Raises InputError naming the free motions
    ("translation x", "rotation about z through …").
    """
    if model in _HELD:
        return
    for free in free_motions(model, lattice):
        nodes, parts = len(distinct(free.node)), len(free.motions)
        where = "" if parts == 1 else f" (its {parts} parts {free.how})"
        x, y, z = free.origin
        raise InputError(
            f"supports: the body with {nodes} nodes around ({x:.6g}, {y:.6g}, {z:.6g}){where} can "
            f"move freely; got free {', '.join(free.names)}; expected supports that hold all six "
            "rigid-body motions"
        )
    _HELD.add(model)


def check_still(model: Model, what: str) -> None:
    """Raises InputError, naming ``what``, for a model with displacements that are given."""
    got = type(model).__name__
    require(isinstance(model, Model), f"{what}: model", got, "a Model")
    given = [model.prescribed_cases, *(one.right for one in model.constraints)]
    expected = "0 of supports, which the ground (base) may move, and constraints with right = 0"
    still = not any(one.any() for one in given)
    require(still, f"{what}: model", "displacements that are given", expected)


def free_motions(model: Model, lattice: Lattice | None = None) -> Iterator[FreeMotions]:
    """Of each body that isn't held, see `check_supports`."""
    if model in _HELD:
        return
    part_of_cell = _parts(model.mesh) if lattice is None else _lattice_parts(lattice)
    count = model.mesh.node_count
    parts = int(part_of_cell.max()) + 1
    if parts == 1 and not model.constraints:
        used = np.ones(count, dtype=bool)
        used[model.mesh.dangling_nodes] = False
        node = np.flatnonzero(used)
        yield from _free_of_body(model, node, np.zeros(len(node), dtype=np.int64), 1, None)
        return
    node, part = _incidence(model.mesh, part_of_cell)
    body = _connected(count, node, part)[count:]
    _, first, body = np.unique(body, return_index=True, return_inverse=True)
    # a body of very many parts is taken as one
    crowded = np.bincount(body)[body] > _MOST_PARTS
    part = np.where(crowded, first[body], np.arange(parts))[part]
    equations, _ = normalised_equations(model)
    # nodes of no cell that stand in equations are parts of their own
    loose = np.intersect1d(model.mesh.dangling_nodes, equations.indices // 3)
    parts += len(loose)
    key = np.concatenate(
        [node * parts + part, loose * parts + np.arange(parts - len(loose), parts)]
    )
    node, part = np.divmod(distinct(key), parts)
    row = np.repeat(np.arange(equations.shape[0]), np.diff(equations.indptr))
    group = _connected(
        count,
        np.concatenate([node, equations.indices // 3]),
        np.concatenate([part, parts + row]),
    )
    group_of_row = group[count + parts :]
    for number in np.unique(group[node]):
        inside = group[node] == number
        members, local = np.unique(part[inside], return_inverse=True)
        own = equations[group_of_row == number]
        own = own if own.shape[0] else None
        yield from _free_of_body(model, node[inside], local, len(members), own)


def _connected(count: int, node: Long, other: Long) -> Long:
    """Number of the component of each of ``count`` nodes, and of all others that they are linked
    to: ``node`` (k,) with ``other`` (k,)."""
    size = count + int(other.max(initial=-1)) + 1
    graph = coo_matrix((np.ones(len(node)), (node, count + other)), shape=(size, size))
    return np.asarray(connected_components(graph.tocsr(), directed=False)[1], dtype=np.int64)


def _lattice_parts(lattice: Lattice) -> Long:
    """The same as ``_parts``, by cells beside one another."""
    present = lattice.cell >= 0
    number, _ = label(present)
    result = np.empty(int(present.sum()), dtype=np.int64)
    result[lattice.cell[present]] = number[present] - 1
    return result


def _parts(mesh: Mesh) -> Long:
    """(M,) number of the face-connected part of each cell."""
    # a face is known by the sum of its corners' hashes, whatever their order
    code = np.append(mix(np.arange(mesh.node_count), 6), np.uint64(0))
    keys: list[npt.NDArray[np.uint64]] = []
    owner: list[Long] = []
    for kind, first, block in mesh.blocks():
        template = CELL_TYPES[kind].faces[:, :4]
        total = np.zeros((len(block), len(template)), dtype=np.uint64)
        for corner in template.T:
            picked = np.where(corner >= 0, block[:, np.maximum(corner, 0)], -1)
            total += code[picked]
        keys.append(total.ravel())
        owner.append(np.repeat(np.arange(first, first + len(block)), len(template)))
    key, cell = np.concatenate(keys), np.concatenate(owner)
    order = np.argsort(key)
    same = np.flatnonzero(key[order][1:] == key[order][:-1])
    graph = coo_matrix(
        (np.ones(len(same), np.int8), (cell[order][same], cell[order][same + 1])),
        shape=(mesh.cell_count,) * 2,
    )
    return np.asarray(connected_components(graph.tocsr(), directed=False)[1], dtype=np.int64)


def _incidence(mesh: Mesh, part_of_cell: Long) -> tuple[Long, Long]:
    """Distinct (node, part) pairs, sorted by node."""
    parts = int(part_of_cell.max()) + 1
    keys = [
        (block.astype(np.int64) * parts + part_of_cell[first : first + len(block), None]).ravel()
        for _, first, block in mesh.blocks()
    ]
    key = distinct(np.concatenate(keys))
    return key // parts, key % parts


def _free_of_body(
    model: Model, node: Long, local: Long, parts: int, equations: csr_matrix | None
) -> Iterator[FreeMotions]:
    """``node`` (n,) of the body, ascending, once for each of its ``parts``, ``local`` (n,), which
    ``equations`` (m,3N) may join."""
    first = np.concatenate([[True], node[1:] != node[:-1]])
    points = model.mesh.points[node[first]]
    origin = points.mean(axis=0)
    length = float(np.abs(points - origin).max())
    rows = [np.zeros((0, 6 * parts))]
    assert model.fixed is not None
    held = model.fixed[node]
    for axis in range(3):
        chosen = np.flatnonzero(held[:, axis])
        rows.append(
            _placed(model.mesh.points[node[chosen]], origin, length, axis, local[chosen], parts)
        )
    again = np.flatnonzero(~first)
    for axis in range(3):
        one = _placed(model.mesh.points[node[again]], origin, length, axis, local[again], parts)
        two = _placed(model.mesh.points[node[again]], origin, length, axis, local[again - 1], parts)
        rows.append(one - two)
    matrix = np.concatenate(rows)
    gram = matrix.T @ matrix
    loose = np.zeros(parts, dtype=bool)
    if equations is not None:
        loose[local[np.isin(node, model.mesh.dangling_nodes)]] = True
        place = np.zeros(model.mesh.node_count, dtype=np.int64)
        place[node] = local
        modes = rigid_modes(model.mesh.points, origin, length)
        gram += _equation_gram(coo_matrix(equations), place, modes, loose)
    values, vectors = np.linalg.eigh(gram)
    scale = max(float(values[-1]), 1.0)
    free = vectors[:, ~(values > 1e-14 * scale)]
    if free.shape[1] == 0:
        return
    size = np.ptp(points, axis=0)
    if not (loose.all() or size.min() > _THINNEST * length):
        raise InputError(
            f"supports: the body with {len(points)} nodes is too thin to be held: what keeps it "
            f"from turning is lost in rounding; got sides of {size[0]:.3g} x {size[1]:.3g} x "
            f"{size[2]:.3g}; expected sides of at least {_THINNEST:g} of the longest (are they all "
            "in one unit?)"
        )
    how = "touch only along edges or at nodes" if equations is None else "are joined by constraints"
    motions = free.reshape(parts, 6, -1)
    solid = motions[~loose] if not loose.all() else motions
    as_one = bool((np.abs(solid - solid[0]) <= _AS_ONE).all())
    motions = _ordered(motions, solid[0]) if as_one else motions
    yield FreeMotions(node, local, motions, as_one, origin, length, how)


def _equation_gram(term: coo_matrix, part: Long, modes: Float, loose: Bool) -> Float:
    """(6P,6P) products of what equations say of the motions of parts, with ``modes`` (N,3,6) of
    nodes, which belong to one ``part`` (N,) each. Parts that are ``loose`` nodes have those
    displacements alone that equations ask for."""
    node, axis = np.divmod(term.col, 3)
    values = (term.data[:, None] * modes[node, axis]).ravel()
    column = (6 * part[node, None] + np.arange(6)).ravel()
    shape = (term.shape[0], 6 * len(loose))
    rows = coo_matrix((values, (np.repeat(term.row, 6), column)), shape=shape).tocsr()
    exists = np.repeat(~loose[:, None], 6, axis=1)
    exists[part[node], axis] = True
    return np.asarray((rows.T @ rows).toarray() + np.diag(~exists.ravel()))


def _placed(
    points: Float, origin: Float, length: float, axis: int, local: Long, parts: int
) -> Float:
    """Rows of one displacement component in the columns of its part."""
    result = np.zeros((len(points), parts, 6))
    result[np.arange(len(points)), local] = rigid_modes(points, origin, length)[:, axis]
    return result.reshape(len(points), 6 * parts)


def _ordered(motions: Float, body: Float) -> Float:
    """Free motions (P,6,k) of parts that move as the ``body`` (6,k) does recombined: translations
    first, then rotations, along or about the axes where these are free."""
    # singular vectors of the rotations: what they leave over is pure translation
    _, sizes, turned = np.linalg.svd(body[3:])
    rotating = int((sizes > _AS_ONE).sum())
    parts = (turned[rotating:].T, slice(0, 3)), (turned[:rotating].T, slice(3, 6))
    mixed = [one @ _along_axes(body @ one, part) for one, part in parts]
    return np.asarray(motions @ np.hstack(mixed))


def _along_axes(modes: Float, part: slice) -> Float:
    """(k,m) how to recombine (6,k) modes so that ``part`` lies along coordinate axes where it
    can."""
    if modes.shape[1] < 2:
        return np.eye(modes.shape[1])
    chosen = []
    for axis in np.eye(3):
        mix, *_ = np.linalg.lstsq(modes[part], axis, rcond=None)
        if np.abs(modes[part] @ mix - axis).max() < 1e-6:
            chosen.append(mix)
    return np.stack(chosen, axis=1) if len(chosen) == modes.shape[1] else np.eye(modes.shape[1])


def _name(mode: Float, origin: Float, length: float) -> str:
    """Of a rigid-body motion (6,)."""
    spin = mode[3:] / length
    if not np.abs(mode[3:]).max() > _AS_ONE * np.abs(mode).max():
        return f"translation {axis_name(mode[:3])}"
    # the axis: where the motion is parallel to the spin
    point = origin + np.cross(spin, mode[:3]) / float(spin @ spin)
    point = np.where(np.abs(point) > 1e-9 * length, point, 0.0)  # 0, not 4e-16
    return (
        f"rotation about {axis_name(spin)} through ({point[0]:.4g}, {point[1]:.4g}, {point[2]:.4g})"
    )


def axis_name(vector: Float) -> str:
    """ "x", "y", "z", or a direction's components."""
    unit = vector / np.linalg.norm(vector)
    for axis, name in enumerate("xyz"):
        if abs(unit[axis]) > 1.0 - 1e-6:
            return name
    if unit[np.argmax(np.abs(unit))] < 0.0:
        unit = -unit
    return f"({unit[0]:.3f}, {unit[1]:.3f}, {unit[2]:.3f})"
