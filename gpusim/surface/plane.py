"""Paint coordinates of plane regions, and the normals of faces."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError

__all__ = ["PaintFrame", "face_normals", "plane_frame"]

PLANAR_COSINE = float(np.cos(np.radians(1.0)))


@dataclass(frozen=True, eq=False)
class PaintFrame:
    """Paint coordinates of a planar region: s = (X - origin) . s_axis, t likewise."""

    origin: npt.NDArray[np.float64]
    s_axis: npt.NDArray[np.float64]
    t_axis: npt.NDArray[np.float64]

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
        relative = points - self.origin
        return np.stack([relative @ self.s_axis, relative @ self.t_axis], axis=-1)

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
    return PaintFrame.facing(unit, points[np.unique(faces[faces >= 0])], up)


def face_normals(
    points: npt.NDArray[np.float64], faces: npt.NDArray[np.int32]
) -> npt.NDArray[np.float64]:
    """Outward normals (F, 3) of (F, 4) faces, as long as the face's area."""
    last = np.where(faces[:, 3] >= 0, faces[:, 3], faces[:, 2])
    a, b, c, d = (points[index] for index in (faces[:, 0], faces[:, 1], faces[:, 2], last))
    normals: npt.NDArray[np.float64] = 0.5 * np.cross(c - a, d - b)
    triangle = faces[:, 3] < 0
    normals[triangle] = 0.5 * np.cross(b - a, c - a)[triangle]
    return normals
