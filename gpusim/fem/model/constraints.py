"""Linear equations between displacements, as objects of a model: ties, and any others.

A tie joins surfaces whose meshes don't match: each node of one follows the nearest point of the
other (node to surface). Linear fields pass it exactly; a constant stress does where the following
mesh divides the other's faces, and within the error of discretisation elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csr_matrix, eye, kron

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.fem.model.loads import node_numbers
from gpusim.field_summary import field_summary
from gpusim.mesh import Faces, Mesh
from gpusim.mesh.nearest_places import nearest_on_surface
from gpusim.validation import require, require_one_of, unmasked

Kind = TypeVar("Kind")

# shares of a place below this are rounding
_ROUNDING = 1e-12
# of a face's size: how far off a node may lie where nothing is said, as in CalculiX
NEAR = 0.025


@unmasked()
@dataclass(frozen=True, eq=False)
class Equations:
    """Linear equations that displacements obey: ``matrix`` times u, flattened, equals ``right``.

    matrix : (m, 3N) sparse; column 3 n + k is component k of node n.
    right : (m,) float64, the same in all load cases.

    `gpusim.fem.tie` and `gpusim.fem.equations` make them. An equation gives up one displacement,
    which follows the others; what is fixed in the model counts as known.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> gs.fem.equations(bar, [([(19, "x", 1.0), (14, "x", -1.0)], 0.0)])
    Equations(matrix=float64 (1, 60), right=float64 (1,))
    """

    matrix: csr_matrix
    right: Float
    __repr__ = field_summary

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", csr_matrix(self.matrix, dtype=np.float64))
        object.__setattr__(self, "right", np.array(self.right, dtype=np.float64))

    @classmethod
    def build(
        cls, rows: Sequence[tuple[Sequence[int], Sequence[float], float]], unknowns: int
    ) -> Equations:
        """From (columns, factors, right side) of each equation."""
        number = np.repeat(np.arange(len(rows)), [len(columns) for columns, _, _ in rows])
        column = np.concatenate([columns for columns, _, _ in rows])
        factor = np.concatenate([factors for _, factors, _ in rows])
        matrix = coo_matrix((factor, (number, column)), shape=(len(rows), unknowns)).tocsr()
        return cls(matrix, np.array([right for _, _, right in rows]))

    def renumbered(self, order: Long) -> Equations:
        """The same where the k-th node is node ``order[k]`` (N,) of this one."""
        columns = (3 * order[:, None] + np.arange(3)).ravel()
        return Equations(self.matrix[:, columns], self.right)


def equations(
    mesh: Mesh, rows: Iterable[tuple[Iterable[tuple[int, str, float]], float]]
) -> Equations:
    """Equations between displacements, for ``Model.constraints``.

    rows : (terms, right side) of each equation; a term is (node, "x", "y" or "z", factor), and the
        sum of factors times displacements is the right side, in the model's unit of length times
        that of the factors.

    Raises InputError for nodes and axes that don't exist and numbers that aren't finite.

    Examples
    --------
    The end's corners move alike along x:

    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> end = np.flatnonzero(np.isclose(bar.points[:, 0], 1.0))
    >>> alike = [([(n, "x", 1.0), (end[0], "x", -1.0)], 0.0) for n in end[1:]]
    >>> gs.fem.equations(bar, alike).matrix.shape
    (3, 60)
    """
    built = []
    for number, (terms, right) in enumerate(rows):
        where = f"equations: row {number}"
        columns, factors = [], []
        for node, axis, factor in terms:
            require_one_of(f"{where}: axis", axis, ("x", "y", "z"))
            expected = f"0 … {mesh.node_count - 1}"
            fits = 0 <= node < mesh.node_count and node == int(node)
            require(fits, f"{where}: node", node, expected)
            columns.append(3 * int(node) + "xyz".index(axis))
            factors.append(float(factor))
        require(bool(columns), f"{where}: no terms", "none", "at least one")
        finite = np.isfinite([*factors, right]).all()
        require(bool(finite), f"{where}: factors", factors, "finite numbers")
        built.append((columns, factors, float(right)))
    require(bool(built), "equations: no rows", "none", "at least one")
    return Equations.build(built, 3 * mesh.node_count)


@unmasked()
def tie(
    mesh: Mesh,
    faces: Faces,
    nodes: Faces | npt.ArrayLike,
    *,
    tolerance: float | None = None,
) -> Equations:
    """Nodes that follow faces, as if glued to them, for ``Model.constraints``.

    Each node's displacement is that of the nearest point of the faces, by the shape functions of
    the face that holds it. Let the finer mesh follow the coarser one: the other way around stress
    beside the joint is several times as far off.

    faces : the surface that is followed, in parts of the mesh that needn't be connected to others.
    nodes : (n,) node numbers, or the faces whose nodes follow. Those that ``faces`` have, too, move
        along anyway.
    tolerance : how far off the faces a node may lie, in the mesh's unit; None: 0.025 of the size of
        its face (the root of its area). Nodes aren't moved: a gap stays, and resists turning.

    Raises InputError where a node lies further off, or beside the faces.

    Examples
    --------
    Two boxes whose meshes don't match:

    >>> lower = gs.mesh.box(size=(2, 2, 1), divisions=(2, 2, 1))
    >>> upper = gs.mesh.box(size=(2, 2, 1), divisions=(3, 3, 1), origin=(0, 0, 1))
    >>> cells = np.concatenate([lower.cells["hex8"], upper.cells["hex8"] + lower.node_count])
    >>> both = gs.Mesh(np.concatenate([lower.points, upper.points]), {"hex8": cells})
    >>> level = {"z_min": 1.0, "z_max": 1.0}
    >>> joint = [gs.mesh.select_faces(both, bounds=level, normal=n) for n in ("+z", "-z")]
    >>> gs.fem.tie(both, *joint)
    Equations(matrix=float64 (48, 150), right=float64 (48,))
    """
    require(len(faces) > 0, "tie: no faces", "an empty selection", "at least one face")
    followed = faces.node_numbers()
    given = nodes.node_numbers() if isinstance(nodes, Faces) else nodes
    following = np.setdiff1d(node_numbers("tie: nodes", mesh, given), followed)
    require(len(following) > 0, "tie: nodes", "none beside those of the faces", "at least one")
    face, distance, shares = nearest_on_surface(faces, mesh.points[following])
    reach = NEAR * np.sqrt(faces.areas[face]) if tolerance is None else tolerance
    off = np.flatnonzero(~(distance <= reach))
    if off.size:
        raise InputError(
            f"tie: {off.size} of {len(following)} nodes lie off the faces; got node "
            f"{following[off[0]]} at a distance of {distance[off[0]]:.3g} (inf: beside them); "
            "expected nodes on them, or a tolerance"
        )
    return follow(faces, following, face, shares)


def follow(faces: Faces, nodes: Long, face: Long, shares: Float) -> Equations:
    """Equations by which ``nodes`` (n,) move as the places on the faces numbered ``face`` (n,) in
    which these faces' nodes have ``shares`` (n,w)."""
    others = faces.nodes[face].astype(np.int64)
    weight = np.where((others >= 0) & (np.abs(shares) > _ROUNDING), shares, 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    row, slot = np.nonzero(weight)
    number = np.arange(len(nodes))
    values = np.concatenate([np.ones(len(nodes)), -weight[row, slot]])
    places = np.concatenate([number, row]), np.concatenate([nodes, others[row, slot]])
    by_node = coo_matrix((values, places), shape=(len(nodes), len(faces.points)))
    return Equations(csr_matrix(kron(by_node, eye(3))), np.zeros(3 * len(nodes)))


def objects_of(kind: type[Kind], given: Any, where: str, expected: str = "") -> tuple[Kind, ...]:
    """Objects of one ``kind``; one by itself as a tuple of one. Raises InputError naming what is
    none, and what is ``expected``."""

    def fits(thing: Any) -> bool:
        # a class has the same attributes as its instances
        return isinstance(thing, kind) and not isinstance(thing, type)

    several = isinstance(given, Iterable) and not fits(given)
    objects = tuple(given) if several else (given,)
    for number, one in enumerate(objects):
        place = f"{where}[{number}]" if several else where
        got = f"the class {one.__name__}" if isinstance(one, type) else type(one).__name__
        require(fits(one), place, got, expected or f"objects of {kind.__name__}")
    return objects


def checked_constraints(given: Any, unknowns: int) -> tuple[Equations, ...]:
    """Those of a model with so many unknowns; one by itself as a tuple of one. Raises InputError
    naming what is none."""
    constraints = objects_of(Equations, given, "Model.constraints")
    for number, one in enumerate(constraints):
        where = f"Model.constraints[{number}]"
        shape = one.matrix.shape
        fits = shape[1] == unknowns and one.right.shape == shape[:1]
        got = f"matrix {shape}, right {one.right.shape}"
        require(fits, f"{where}: wrong shape", got, f"(m, {unknowns}) and (m,)")
        finite = np.isfinite(one.matrix.data).all() and np.isfinite(one.right).all()
        require(bool(finite), where, "values that aren't finite", "finite numbers")
    return constraints


def touched(constraints: Sequence[Equations], shape: tuple[int, ...]) -> Bool:
    """(N,3) the displacements that stand in an equation."""
    result = np.zeros(shape, dtype=bool)
    for one in constraints:
        result.reshape(-1)[one.matrix.indices[one.matrix.data != 0.0]] = True
    return result
