"""Ties between surfaces whose meshes don't match: each node of one follows a point of the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from gpusim.errors import InputError
from gpusim.mesh import Faces, set_faces
from gpusim.mesh.formats.abaqus.cards import Card
from gpusim.mesh.formats.abaqus.content import InpContent
from gpusim.mesh.formats.abaqus.reader import LabelledMesh
from gpusim.mesh.formats.abaqus.values import number
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients

__all__ = ["TieRow", "read_tie"]

Float = npt.NDArray[np.float64]
Int = npt.NDArray[np.int64]
# columns (3 node + axis), factors and right side of one equation
TieRow = tuple[Sequence[int], Sequence[float], float]

_CANDIDATES = 12
# how far outside of a face, in its reference coordinates, a node may lie
_OUTSIDE = 1e-3


def read_tie(card: Card, content: InpContent, labelled: LabelledMesh) -> list[TieRow]:
    """*TIE: dependent surface (of faces or nodes), independent surface (of faces).

    Each dependent node's displacement equals that of the nearest point of the independent surface,
    interpolated with the shape functions of the face that holds it. A node may lie up to POSITION
    TOLERANCE away (default 0.025 of the face's size, as in CalculiX) with ADJUST=NO; otherwise
    the surfaces must touch, for nodes aren't moved. Raises InputError.
    """
    where = card.where()
    rows = [row for _, row in card.rows()]
    if len(rows) != 1 or len(rows[0]) != 2:
        raise InputError(f"{where}: got {len(rows)} lines; expected one with two surfaces")
    adjust = card.parameters.get("ADJUST", "YES").upper()
    if adjust not in ("YES", "NO"):
        raise InputError(f"{where}: ADJUST={adjust}; expected YES or NO")
    mesh = labelled.mesh
    pairs = labelled.face_pairs(content.surfaces.get(rows[0][1], where))
    faces = set_faces(mesh, pairs)
    if rows[0][0] in content.surfaces:
        own = content.surfaces.get(rows[0][0], where)
        nodes = set_faces(mesh, labelled.face_pairs(own)).node_numbers().astype(np.int64)
    else:
        members = content.node_sets.get(rows[0][0], where)
        nodes = np.searchsorted(content.node_labels, members)
    given = card.parameters.get("POSITIONTOLERANCE", "")
    size = np.sqrt(faces.areas)
    reach = np.full(len(faces), number(given, where)) if given else 0.025 * size
    closed = np.minimum(reach, 1e-6 * size) if adjust == "YES" else reach
    found: list[TieRow] = []
    near = cKDTree(faces.centroids)
    for node in nodes.tolist():
        _, order = near.query(mesh.points[node], k=min(_CANDIDATES, len(faces)))
        face, weights, gap = _nearest(faces, np.atleast_1d(order), mesh.points[node])
        label = content.nodes.shown(labelled.node_labels[node])
        if face < 0 or not gap <= reach[face]:
            raise InputError(
                f"{where}: node {label} lies off the surface {rows[0][1]}; got a distance of "
                f"{gap:.3g}; expected every node of {rows[0][0]} on it"
            )
        if not gap <= closed[face]:
            raise InputError(
                f"{where}: node {label} would have to be moved by {gap:.3g}; expected surfaces "
                "that touch, or ADJUST=NO"
            )
        own_nodes = _own(faces, face)
        for axis in range(3):
            columns = [3 * node + axis, *(3 * own_nodes + axis).tolist()]
            found.append((columns, [1.0, *(-weights).tolist()], 0.0))
    return found


def _kind(nodes: npt.NDArray[np.int32]) -> str:
    corners = "tri" if nodes[3] < 0 else "quad"
    count = int((nodes >= 0).sum())
    return f"{corners}{count}"


def _own(faces: Faces, face: int) -> Int:
    """The nodes of one face, in the order of its shape functions."""
    nodes = faces.nodes[face]
    return np.asarray(nodes[list(FACE_TYPES[_kind(nodes)])], dtype=np.int64)


def _nearest(faces: Faces, candidates: Int, point: Float) -> tuple[int, Float, float]:
    """Face (-1: none), weights of its nodes, and distance of the nearest point inside of it."""
    best, best_weights, best_gap = -1, np.zeros(0), np.inf
    for face in candidates.tolist():
        kind = _kind(faces.nodes[face])
        corners = faces.points[_own(faces, face)]
        xi = _foot(kind, corners, point)
        if not _inside(kind, xi):
            continue
        weights = shape_functions(kind, xi[None])[0]
        gap = float(np.linalg.norm(weights @ corners - point))
        if gap < best_gap:
            best, best_weights, best_gap = face, weights, gap
    return best, best_weights, best_gap


def _foot(kind: str, nodes: Float, point: Float) -> Float:
    """(2,) reference coordinates of the point of a face nearest to ``point``, by Gauss-Newton."""
    xi = np.full(2, 1.0 / 3.0) if kind.startswith("tri") else np.zeros(2)
    for _ in range(30):
        offset = point - shape_functions(kind, xi[None])[0] @ nodes
        slope = nodes.T @ shape_gradients(kind, xi[None])[0]
        change = np.linalg.lstsq(slope, offset, rcond=None)[0]
        xi = np.clip(xi + change, -3.0, 3.0)
        if np.abs(change).max() <= 1e-13:
            break
    return xi


def _inside(kind: str, xi: Float) -> bool:
    if kind.startswith("tri"):
        return bool(xi.min() >= -_OUTSIDE and xi.sum() <= 1.0 + _OUTSIDE)
    return bool(np.abs(xi).max() <= 1.0 + _OUTSIDE)
