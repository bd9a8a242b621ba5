"""Paint coordinates of regions: of a plane, round a cylinder, or of any surface unfolded.

A pattern laid on by projection smears where the surface turns away, as in holes and on side faces.
Here lengths on the surface are lengths of the pattern. Where a surface closes upon itself, or can't
be unfolded, the pattern has a seam: a line across which it doesn't go on.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.arrays.unique import distinct
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.surface.topology import Topology
from gpusim.validation import require, unmasked

PLANAR_COSINE = float(np.cos(np.radians(1.0)))

ROUND = 0.02
"""Share of the radius by which the points of a cylinder may miss it."""
STRETCH = 0.02
"""Share of an edge by which an unfolded triangle may be out of shape to fit its neighbours."""


@unmasked()
@dataclass(frozen=True, eq=False)
class PaintFrame:
    """Paint coordinates of a planar region: s = (X - origin) . s_axis, t likewise.

    Examples
    --------
    >>> frame = gs.PaintFrame(np.zeros(3), np.array([1.0, 0, 0]), np.array([0.0, 0, 1]))
    >>> frame.coordinates(np.array([[0.2, 0.0, 0.3]]))
    array([[0.2, 0.3]])
    """

    origin: Float
    s_axis: Float
    t_axis: Float
    __repr__ = field_summary

    @staticmethod
    def facing(
        normal: Float,
        points: Float,
        up: npt.ArrayLike | None = None,
    ) -> PaintFrame:
        """The upright frame of a plane seen from outside, with its corner at the lowest s and t.

        t points along ``up`` as far as the plane allows (default +z, or +y if the plane is
        horizontal), s to the right of somebody who looks at the plane against ``normal``.
        """
        if up is None:
            up = (0.0, 0.0, 1.0) if abs(normal[2]) < 0.9 else (0.0, 1.0, 0.0)
        upward = np.asarray(up, np.float64)
        t_axis = upward - normal * (upward @ normal)
        length = float(np.linalg.norm(t_axis))
        if not length > 1e-9 * float(np.linalg.norm(upward)):
            raise InputError(f"paint frame up; got {upward.tolist()}, along the plane's normal")
        t_axis /= length
        s_axis = np.cross(t_axis, normal)
        s, t = points @ s_axis, points @ t_axis
        origin = s.min() * s_axis + t.min() * t_axis + (points @ normal).mean() * normal
        return PaintFrame(origin, s_axis, t_axis)

    def coordinates(self, points: Float) -> Float:
        """(…, 3) points to (…, 2) paint coordinates."""
        # no matrix product, whose rounding depends on where in the array a point is
        x, y, z = (points[..., k] - self.origin[k] for k in range(3))
        axes = (self.s_axis, self.t_axis)
        columns = np.stack([x * axis[0] + y * axis[1] + z * axis[2] for axis in axes])
        return np.moveaxis(columns, 0, -1)

    def of_triangles(self, corners: Float, number: Long) -> Float:
        """Corners (n, 3, 3) of triangles to (n, 3, 2)."""
        return self.coordinates(corners)


def plane_frame(
    points: Float,
    faces: Int,
    where: str,
    up: npt.ArrayLike | None = None,
) -> PaintFrame:
    """The upright frame of plane faces (F, 4); ``where`` names them in errors.

    Raises
    ------
    InputError
        The faces' normals differ by more than 1 degree.
    """
    normals = face_normals(points, faces)
    mean = normals.sum(axis=0)
    length = float(np.linalg.norm(mean))
    unit = mean / length if length > 0.0 else mean
    areas = np.linalg.norm(normals, axis=1)
    if not length > 0.0 or not (normals @ unit >= PLANAR_COSINE * areas).all():
        raise InputError(
            f"{where}: a pattern needs a plane region; got faces whose normals differ by more "
            "than 1 degree; expected those of one plane, as `where` chooses them, or `mapping` (in "
            "Python `frames`), which lays a pattern on curved ones"
        )
    return PaintFrame.facing(unit, points[used_vertices(faces, len(points))], up)


def used_vertices(faces: npt.NDArray[np.integer], count: int) -> Long:
    """The numbers of those of ``count`` vertices that faces (F, 3) or (F, 4) have, in order."""
    used = np.zeros(count + 1, bool)  # -1 is the last one
    used[faces] = True
    return np.flatnonzero(used[:count])


def face_normals(points: Float, faces: npt.NDArray[np.integer]) -> Float:
    """Outward normals (F, 3) of (F, 4) faces, as long as the face's area."""
    a, b, c, d = (np.ascontiguousarray(faces[:, k]) for k in range(4))
    triangle = d < 0
    # of a triangle: from its first corner to the others
    first = np.where(triangle, b, c), a
    second = np.where(triangle, c, d), np.where(triangle, a, b)
    columns = [np.ascontiguousarray(points[:, axis]) for axis in range(3)]
    (ux, uy, uz), (vx, vy, vz) = (
        [column[to] - column[start] for column in columns] for to, start in (first, second)
    )
    normals = np.empty((len(faces), 3))
    for axis, normal in enumerate((uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx)):
        normals[:, axis] = 0.5 * normal
    return normals


class Frame(Protocol):
    """Where the corners of a surface's triangles lie on the pattern."""

    def of_triangles(self, corners: Float, number: Long) -> Float:
        """Undeformed corners (n, 3, 3) of the surface's triangles ``number`` (n,), in the order of
        `triangulate`, to paint coordinates (n, 3, 2)."""
        ...


@unmasked()
@dataclass(frozen=True, eq=False)
class CylinderFrame:
    """Paint coordinates round a cylinder: s = radius x angle, t along ``axis``.

    ``origin`` is a point on the axis, where t is 0, and ``start`` the direction (across the axis)
    where s is 0; the seam lies opposite. Seen from outside with the axis up, s grows to the right;
    with ``inside`` (a bore), seen from within.

    Examples
    --------
    >>> origin, up, start = np.zeros(3), np.array([0.0, 0, 1]), np.array([1.0, 0, 0])
    >>> pipe = gs.CylinderFrame(origin, up, start, radius=0.1)
    >>> pipe.coordinates(np.array([[0, 0.1, 0.5]])).round(3)
    array([[0.157, 0.5  ]])
    """

    origin: Float
    axis: Float
    start: Float
    radius: float
    inside: bool = False
    __repr__ = field_summary

    def __post_init__(self) -> None:
        axis, start = np.asarray(self.axis, np.float64), np.asarray(self.start, np.float64)
        length = float(np.linalg.norm(axis))
        fits = axis.shape == (3,) and 0.0 < length < np.inf
        require(fits, "CylinderFrame axis", self.axis, "a direction (3,)")
        axis = axis / length
        across = start - axis * (start @ axis)
        size = float(np.linalg.norm(across))
        fits = size > 1e-9 * float(np.linalg.norm(start))
        require(fits, "CylinderFrame start", self.start, "one across the axis")
        fits = 0.0 < self.radius < np.inf
        require(fits, "CylinderFrame radius", self.radius, "a length above 0")
        object.__setattr__(self, "origin", np.asarray(self.origin, np.float64))
        object.__setattr__(self, "axis", axis)
        object.__setattr__(self, "start", across / size)

    @staticmethod
    def fit(
        points: Float, faces: Int, origin: npt.ArrayLike, axis: npt.ArrayLike,
        where: str,
    ) -> CylinderFrame:  # fmt: skip
        """The frame of a region's ``faces`` (F, 4) around a given axis; ``where`` names it.

        The radius is the mean one and t starts at the lowest point; s is 0 at the middle of the
        region or, if it goes all round, towards +x, +y or +z, whichever is most across the axis.

        Raises
        ------
        InputError
            The points aren't at one distance from the axis.
        """
        base, unit = np.asarray(origin, np.float64), np.asarray(axis, np.float64)
        unit = unit / float(np.linalg.norm(unit))
        used = points[distinct(faces[faces >= 0])] - base
        across = used - np.outer(used @ unit, unit)
        distance = np.linalg.norm(across, axis=1)
        radius = float(distance.mean())
        fits = (np.abs(distance - radius) <= ROUND * radius).all()
        got = f"points {distance.min():.6g} to {distance.max():.6g} away from it"
        expected = f"one distance within {ROUND:.0%}"
        require(fits, f"{where}: a region round an axis", got, expected)
        normals = face_normals(points, faces)
        last = np.where(faces[:, 3:] >= 0, faces[:, 3:], faces[:, 2:3])
        centre = points[np.concatenate([faces[:, :3], last], axis=1)].mean(axis=1) - base
        inside = bool(np.sum(normals * (centre - np.outer(centre @ unit, unit))) < 0.0)
        start = across.mean(axis=0)
        if not np.linalg.norm(start) > 0.1 * radius:
            start = np.eye(3)[int(np.argmin(np.abs(unit)))]
        lowest = float((used @ unit).min())
        return CylinderFrame(base + lowest * unit, unit, start, radius, inside)

    def coordinates(self, points: Float) -> Float:
        """(…, 3) points to (…, 2) paint coordinates; s from -pi to pi times the radius."""
        relative = points - self.origin
        right = np.cross(self.axis, self.start) * (-1.0 if self.inside else 1.0)
        angle = np.arctan2(relative @ right, relative @ self.start)
        return np.stack([self.radius * angle, relative @ self.axis], axis=-1)

    def of_triangles(self, corners: Float, number: Long) -> Float:
        """Each triangle lies on the side of the seam that its first corner is on."""
        st = self.coordinates(corners)
        turn = 2.0 * np.pi * self.radius
        st[..., 0] -= turn * np.rint((st[..., 0] - st[:, :1, 0]) / turn)
        return st


@unmasked()
@dataclass(frozen=True, eq=False)
class Atlas:
    """Paint coordinates ``st`` (T, 3, 2) of every triangle's corners; NaN where there are none.

    Examples
    --------
    >>> corners = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 1.0]]])
    >>> gs.Atlas(corners[:, :, :2]).st.shape
    (2, 3, 2)
    """

    st: Float
    __repr__ = field_summary

    @staticmethod
    def unfold(
        points: Float,
        faces: Int,
        wanted: Bool | None = None,
        up: npt.ArrayLike | None = None,
    ) -> Atlas:
        """Lay the ``wanted`` (F,) faces (F, 4) of a surface out flat.

        From the largest triangle on, neighbours are laid beside each other, those across the
        flattest and nearest edges first, each in its true shape. A corner that already has a place
        within 2 % of an edge's length of the right one takes it, so that the pattern goes on
        without a seam wherever the surface can be unfolded.
        """
        topology = Topology.of(faces)
        triangles, source = topology.triangles, topology.source
        used = np.ones(len(faces), bool) if wanted is None else np.asarray(wanted, bool)
        chosen = np.flatnonzero(used[source])
        st = np.full((len(triangles), 3, 2), np.nan)
        corners = points[triangles]
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        normal = np.cross(a, b)
        area = np.linalg.norm(normal, axis=1)
        unit = normal / np.where(area > 0.0, area, 1.0)[:, None]
        centre = corners.mean(axis=1)
        neighbours = _neighbours(topology.edge, chosen)
        order = chosen[np.argsort(-area[chosen], kind="stable")]
        done = np.zeros(len(triangles), bool)
        for first in order.tolist():
            if done[first]:
                continue
            frame = PaintFrame.facing(unit[first], points[triangles[chosen]].reshape(-1, 3), up)
            st[first] = frame.coordinates(corners[first])
            places: dict[int, list[Float]] = {}
            _grow(first, topology, corners, unit, centre, neighbours, st, done, places)
        return Atlas(st)

    def of_triangles(self, corners: Float, number: Long) -> Float:
        """The coordinates kept; the surface's triangles must be those that were unfolded."""
        last, count = number.max(initial=-1), len(self.st)
        require(last < count, "Atlas", f"triangle {last}", f"the {count} it was made for")
        st = self.st[number]
        if not np.isfinite(st).all():
            raise InputError("Atlas: got a triangle outside the faces that were unfolded")
        return st


def _neighbours(edge: Long, chosen: Long) -> dict[int, list[tuple[int, int]]]:
    """By edge, the ``chosen`` triangles that have it, and as which side."""
    of_edge: dict[int, list[tuple[int, int]]] = {}
    for number in chosen.tolist():
        for side, own in enumerate(edge[number].tolist()):
            of_edge.setdefault(own, []).append((number, side))
    return of_edge


def _grow(
    first: int,
    topology: Topology,
    corners: Float,
    unit: Float,
    centre: Float,
    neighbours: dict[int, list[tuple[int, int]]],
    st: Float,
    done: Bool,
    places: dict[int, list[Float]],
) -> None:
    """Lay out all that hangs together with triangle ``first``, which has its place."""
    heap: list[tuple[bool, float, int, int, int]] = []
    triangles = topology.triangles

    def settle(number: int, distance: float) -> None:
        done[number] = True
        for vertex, place in zip(triangles[number].tolist(), st[number], strict=True):
            places.setdefault(vertex, []).append(place)
        for edge in topology.edge[number].tolist():
            for other, own in neighbours[edge]:
                if not done[other]:
                    step = distance + float(np.linalg.norm(centre[other] - centre[number]))
                    crease = float(unit[other] @ unit[number]) < 0.8
                    heapq.heappush(heap, (crease, step, other, own, number))

    settle(first, 0.0)
    while heap:
        _, distance, number, side, parent = heapq.heappop(heap)
        if done[number]:
            continue
        v, above = triangles[number].tolist(), triangles[parent].tolist()
        i, j, k = side, (side + 1) % 3, (side + 2) % 3
        a, b = st[parent][above.index(v[i])], st[parent][above.index(v[j])]
        along, arm = (
            corners[number][j] - corners[number][i],
            corners[number][k] - corners[number][i],
        )
        length = float(np.linalg.norm(along))
        x = float(arm @ along) / length
        y = float(np.sqrt(max(float(arm @ arm) - x * x, 0.0)))
        e = (b - a) / max(float(np.linalg.norm(b - a)), 1e-300)
        # counter-clockwise corners stay so: the third lies to the left
        third = a + x * e + y * np.array([-e[1], e[0]])
        near = places.get(v[k], [])
        gaps = [float(np.hypot(*(place - third))) for place in near]
        if gaps and min(gaps) <= STRETCH * length:
            third = near[int(np.argmin(gaps))]
        st[number][i], st[number][j], st[number][k] = a, b, third
        settle(number, distance)
