"""Paint coordinates of plane regions, and the normals of faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.validation import unmasked

__all__ = ["PaintFrame", "face_normals", "plane_frame", "used_vertices"]

PLANAR_COSINE = float(np.cos(np.radians(1.0)))


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

    origin: npt.NDArray[np.float64]
    s_axis: npt.NDArray[np.float64]
    t_axis: npt.NDArray[np.float64]
    __repr__ = field_summary

    @staticmethod
    def facing(
        normal: npt.NDArray[np.float64],
        points: npt.NDArray[np.float64],
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

    def coordinates(self, points: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """(…, 3) points to (…, 2) paint coordinates."""
        # no matrix product, whose rounding depends on where in the array a point is
        x, y, z = (points[..., k] - self.origin[k] for k in range(3))
        axes = (self.s_axis, self.t_axis)
        columns = np.stack([x * axis[0] + y * axis[1] + z * axis[2] for axis in axes])
        return np.moveaxis(columns, 0, -1)

    def of_triangles(
        self, corners: npt.NDArray[np.float64], number: npt.NDArray[np.int64]
    ) -> npt.NDArray[np.float64]:
        """Corners (n, 3, 3) of triangles to (n, 3, 2)."""
        return self.coordinates(corners)


def plane_frame(
    points: npt.NDArray[np.float64],
    faces: npt.NDArray[np.int32],
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
            "than 1 degree; split the region or give frames"
        )
    return PaintFrame.facing(unit, points[used_vertices(faces, len(points))], up)


def used_vertices(faces: npt.NDArray[np.integer], count: int) -> npt.NDArray[np.int64]:
    """The numbers of those of ``count`` vertices that faces (F, 3) or (F, 4) have, in order."""
    used = np.zeros(count + 1, bool)  # -1 is the last one
    used[faces] = True
    return np.flatnonzero(used[:count])


def face_normals(
    points: npt.NDArray[np.float64], faces: npt.NDArray[np.integer]
) -> npt.NDArray[np.float64]:
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
