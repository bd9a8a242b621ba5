"""The faces that may cast shadows, and how each lamp sees them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import products
from gpusim.optics.emitters import Lamp
from gpusim.optics.merging import merge_flat, neighbours, rows_of
from gpusim.optics.rows import Rows
from gpusim.surface.surface import Surface, face_normals
from gpusim.surface.topology import Topology

__all__ = ["Casters", "LampFaces"]

Array = npt.NDArray[np.float64]
MOST_WALLS, WALL = 32, 1e-3
"""Faces of open surfaces that are looked at one by one, and their least share of the area."""

BENT = 1e-7
"""Of a face's size: a corner's distance from the plane of the others that makes it bent."""


class _Known(NamedTuple):
    """Of faces (F, 4): what is across their edges and whether something is across all, see
    `neighbours`; and their rows."""

    beside: npt.NDArray[np.int64]
    closed: bool
    rows: tuple[Rows, Rows]


_KNOWN: WeakKeyDictionary[Topology, dict[int, _Known]] = WeakKeyDictionary()

FLAT = 1e-9
"""Distance from a face's plane, per distance and face size, that counts as on it."""


@dataclass(frozen=True, eq=False)
class LampFaces:
    """``face`` (n,): the faces that may hide a lamp from something.

    ``rim`` (n, 4): the edges at which visibility may change; across all others a shadow goes on
    without a gap. ``side`` (n,): 1 if the whole lamp is before the face's plane, -1 behind it,
    0 if the plane meets the lamp.
    """

    face: npt.NDArray[np.int64]
    rim: npt.NDArray[np.bool_]
    side: npt.NDArray[np.int64]

    def __getitem__(self, kept: npt.NDArray[np.bool_]) -> LampFaces:
        """Those that are ``kept`` (n,)."""
        return LampFaces(self.face[kept], self.rim[kept], self.side[kept])


@dataclass(frozen=True, eq=False)
class Casters:
    """Faces of all surfaces, flat parts joined.

    ``points`` (N, 3) world; ``faces`` (F, 4) of them, a triangle's last one twice; ``normal``
    (F, 3) outward, as long as the area; ``both_sides`` (F,): of surfaces that aren't closed;
    ``body`` (F,): the number of the surface. Of the edges of the surfaces' own faces that aren't
    inside a joined one: ``edge`` (E, 2) joined face and place among its edges, ``beside`` (E,) the
    joined face across, -1 for none or several, -2 where a triangle has no fourth edge, ``ends``
    (E, 2) of ``points``, in the joined face's direction. ``into`` (n, 2): the joined face, or two,
    that each face of all surfaces is part of, in their order; -1 for none.
    """

    points: Array
    faces: npt.NDArray[np.int64]
    normal: Array
    both_sides: npt.NDArray[np.bool_]
    body: npt.NDArray[np.int64]
    edge: npt.NDArray[np.int64]
    beside: npt.NDArray[np.int64]
    ends: npt.NDArray[np.int64]
    into: npt.NDArray[np.int64]

    @cached_property
    def corners(self) -> Array:
        """(F, 4, 3) world, a triangle's last one twice."""
        return self.points[self.faces]

    @staticmethod
    def of(
        surfaces: Sequence[Surface],
        flatness: Callable[[Array], Array] | None = None,
        without: Collection[int] = (),
    ) -> Casters:
        """Collect the faces of ``surfaces``, ``without`` those of some numbers.

        ``flatness``: how far joined faces may pass from points (N, 3), (N,); None joins none.
        """
        points, faces = [np.zeros((0, 3))], [np.zeros((0, 4), np.int64)]
        normals, both = [np.zeros((0, 3))], [np.zeros(0, bool)]
        bodies = [np.zeros(0, np.int64)]
        edges, beside = [np.zeros((0, 2), np.int64)], [np.zeros(0, np.int64)]
        into, ends = [np.zeros((0, 2), np.int64)], [np.zeros((0, 2), np.int64)]
        first = vertex = 0
        several = sum(len(v.faces) for n, v in enumerate(surfaces) if n not in without) > 1
        for number, surface in enumerate(surfaces):
            if number in without:
                into.append(np.full((len(surface.faces), 2), -1))
                continue
            used = surface.faces.astype(np.int64)
            parts = np.arange(len(used)).repeat(2).reshape(-1, 2)
            if not surface.topology.closed and _bent(surface.points, used):
                # both their sides hide: from its mean plane a bent face would hide part of itself
                triangles = surface.topology.triangles
                used = np.column_stack([triangles, np.full(len(triangles), -1)])
                source = surface.topology.source
                parts = np.stack(
                    [np.searchsorted(source, parts[:, 0]),
                     np.searchsorted(source, parts[:, 0], side="right") - 1], axis=1,
                )  # fmt: skip
            own = np.where(used >= 0, used, np.roll(used, 1, axis=1))
            known, corner = _known(surface.topology, own), own
            across = known.beside.reshape(-1)
            normal = face_normals(surface.points, used)
            edge, owner = np.arange(len(across)), None
            if flatness is not None and several:
                merged = merge_flat(
                    surface.points, own, flatness(surface.points), known.beside, rows=known.rows
                )
                own, normal, owner = merged.faces, merged.total(normal), merged.owner
                edge = np.flatnonzero(~merged.inner.reshape(-1))
                parts = owner[parts]
            count = len(own)
            points.append(surface.points)
            faces.append(own + vertex)
            normals.append(normal)
            both.append(np.full(count, not known.closed))
            bodies.append(np.full(count, number))
            face, place, other = edge >> 2, edge & 3, across[edge]
            ends.append(
                np.stack([corner[face, place], corner[face, (place + 1) & 3]], axis=1) + vertex
            )
            if owner is not None:
                face, other = owner[face], np.where(other >= 0, owner[np.maximum(other, 0)], other)
            into.append(parts + first)
            edges.append(np.stack([face + first, place], axis=1))
            beside.append(np.where(other >= 0, other + first, other))
            first += count
            vertex += len(surface.points)
        return Casters(
            np.concatenate(points), np.concatenate(faces), np.concatenate(normals),
            np.concatenate(both), np.concatenate(bodies), np.concatenate(edges),
            np.concatenate(beside), np.concatenate(ends), np.concatenate(into),
        )  # fmt: skip

    def seen_by(self, lamp: Lamp, receivers: Array) -> LampFaces:
        """The faces that may hide ``lamp`` from some of ``receivers`` (3, R), world.

        Of closed bodies those that turn their outside to no part of the lamp, or only to some:
        a shadow begins where a ray enters a body from behind, as seen from the lamp.
        """
        corner = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        places = lamp.centre + corner[:, :1] * lamp.u + corner[:, 1:] * lamp.v
        if not lamp.extended:
            places = places[:1]
        near = 0.0 if lamp.far else 1.0
        to = places[None] - near * self.corners[:, :1]
        height = np.einsum("fka,fa->fk", to, self.normal)
        scale = np.linalg.norm(to, axis=2).max(axis=1) * np.linalg.norm(self.normal, axis=1)
        lit = (height >= -FLAT * scale[:, None]).all(axis=1)
        dark = (height <= FLAT * scale[:, None]).all(axis=1)
        side = np.where(dark, -1, np.where(lit, 1, 0))
        caster = self.both_sides | (side < 1)
        # a wall that has all receivers and the lamp before it hides nothing
        walls = np.flatnonzero(self.both_sides & lit)
        area = np.linalg.norm(self.normal[walls], axis=1)
        walls = walls[area >= WALL * area.sum()][:MOST_WALLS]
        if len(walls) and receivers.shape[1]:
            # where the corners of a box round all receivers are before a wall they are, too
            ends = np.stack([receivers.min(axis=1), receivers.max(axis=1)])
            box = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)
            ahead = np.einsum(
                "rfa,fa->fr", box[:, None] - self.corners[walls, 0], self.normal[walls]
            )
            clear = (ahead >= 0.0).all(axis=1)
            caster[walls[clear]] = False
            walls = walls[~clear]
        for face in walls:
            way = receivers - self.corners[face, 0][:, None]
            ahead = products(way, self.normal[face])
            reach = float(np.abs(way).max(initial=0.0))
            size = float(np.linalg.norm(self.normal[face]))
            caster[face] = bool((ahead < -1e-7 * reach * size).any())
        # a face goes on into its neighbour where both turn the same side to the lamp
        own = side[self.edge[:, 0]]
        goes_on = (self.beside >= 0) & (side[np.maximum(self.beside, 0)] == own) & (own != 0)
        rim = np.zeros((len(side), 4), bool)
        ends = ~goes_on & (self.beside != -2)
        rim[self.edge[ends, 0], self.edge[ends, 1]] = True
        face = np.flatnonzero(caster)
        return LampFaces(face, rim[face], side[face])


def _bent(points: Array, faces: npt.NDArray[np.int64]) -> bool:
    """Whether corners of some face (F, 4), -1 in the last column for triangles, leave a plane."""
    a, b, c, d = (points[corner] for corner in faces[faces[:, 3] >= 0].T)
    normal = np.cross(c - a, d - b)
    size = np.linalg.norm(normal, axis=1)
    gap = np.abs(np.einsum("fa,fa->f", normal, b - a))
    return bool((gap > BENT * size * np.sqrt(size)).any())


def _known(topology: Topology, faces: npt.NDArray[np.int64]) -> _Known:
    """What is known of a topology's faces, or of its triangles, for all frames."""
    found = _KNOWN.setdefault(topology, {})
    if len(faces) not in found:
        beside, closed = neighbours(faces)
        found[len(faces)] = _Known(beside, closed, rows_of(faces, beside))
    return found[len(faces)]
