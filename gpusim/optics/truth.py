"""Ground truth per pixel, at the pixel's centre and unfiltered, in float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.optics.view import NORMAL, POSITION, REFERENCE, View

__all__ = ["Truth", "seen_in", "truth_of"]

DEPTH_TOLERANCE = 1e-3
"""Relative depth by which a point may lie behind what its pixel sees and still count as seen."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What each of n pixels sees (Eulerian: the values belong to the pixel in this frame).

    ``row``, ``column`` (n,); ``depth`` (n,) along the optical axis; ``reference`` (n, 3)
    undeformed position of the material point seen, world; ``displacement`` (n, 3) of that point,
    world; ``flow`` (n, 2) px from this pixel to where the undeformed point projects; ``normal``
    (n, 3) unit normal on the side seen, world: smooth if the frame is lit, else the triangle's;
    ``face``, ``region`` (n,) numbers; ``shape`` (H, W).
    """

    shape: tuple[int, int]
    row: npt.NDArray[np.int64]
    column: npt.NDArray[np.int64]
    depth: npt.NDArray[np.float64]
    reference: npt.NDArray[np.float64]
    displacement: npt.NDArray[np.float64]
    flow: npt.NDArray[np.float64]
    normal: npt.NDArray[np.float64]
    face: npt.NDArray[np.int32]
    region: npt.NDArray[np.int32]

    LAYERS = ("depth", "reference", "displacement", "flow", "normal", "face", "region")

    def image(self, layer: str) -> npt.NDArray[np.float64]:
        """A layer as an (H, W) or (H, W, k) image; pixels that see nothing hold NaN."""
        if layer not in self.LAYERS:
            raise InputError(f"truth layer; got {layer!r}; expected one of {list(self.LAYERS)}")
        values = getattr(self, layer)
        image = np.full((*self.shape, *values.shape[1:]), np.nan)
        image[self.row, self.column] = values
        return image


def truth_of(
    view: View, ids: npt.NDArray[np.uint32], faces: tuple[int, int] | None = None
) -> Truth:
    """Evaluate the truth of a view from its visibility ids (H, W)."""
    wanted = np.ones(view.count + 1, bool)
    wanted[0] = False
    if faces is not None:
        wanted[1:] = (view.face >= faces[0]) & (view.face < faces[1])
    row, column = np.nonzero(wanted[ids])
    triangle = ids[row, column].astype(np.int64) - 1
    pixels = np.stack([column, row], axis=1).astype(np.float64)
    ideal = np.ones((len(row), 3))
    ideal[:, :2] = view.camera.undistort(pixels)
    b = np.einsum("nik,nk->ni", view.planes[triangle], ideal)
    inverse = b.sum(axis=1)
    weights = b / inverse[:, None]
    corners = view.corners[triangle]
    reference = np.einsum("ni,nia->na", weights, corners[:, :, REFERENCE])
    seen = np.einsum("ni,nia->na", weights, corners[:, :, POSITION])
    T = view.camera.camera_from_world
    position = (seen - T[:3, 3]) @ T[:3, :3]
    return Truth(
        shape=(view.camera.height, view.camera.width),
        row=row,
        column=column,
        depth=1.0 / inverse,
        reference=reference,
        displacement=position - reference,
        flow=view.camera.project(reference) - pixels,
        normal=_normals(view, triangle, weights),
        face=view.face[triangle],
        region=view.paint[triangle],
    )


def _normals(
    view: View, triangle: npt.NDArray[np.int64], weights: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Smooth normals where the view has them (it is lit), else those of the triangles."""
    if view.corners[:, :, NORMAL].any():
        normal = np.einsum("ni,nia->na", weights, view.corners[triangle][:, :, NORMAL])
    else:
        p = view.corners[:, :, POSITION]
        flat = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        normal = (flat @ view.camera.camera_from_world[:3, :3])[triangle]
    length = np.linalg.norm(normal, axis=1)
    result: npt.NDArray[np.float64] = normal / length[:, None]
    return result


def seen_in(
    view: View, ids: npt.NDArray[np.uint32], points: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Whether world points (n, 3) on the surfaces of ``view`` are seen there, not hidden."""
    camera = view.camera
    at = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = np.all((at >= -0.5) & (at < [camera.width - 0.5, camera.height - 0.5]), axis=1)
    pixel = np.rint(np.where(inside[:, None], at, 0.0)).astype(np.int64)
    number = ids[pixel[:, 1], pixel[:, 0]].astype(np.int64)
    rows = np.flatnonzero(inside & (number > 0))
    planes = view.planes[number[rows] - 1].sum(axis=1)
    # the seen triangle's depth at the point's own place: a steep face isn't in front of itself
    ideal = camera.without_distortion().project(points[rows])
    inverse = np.sum(planes * np.concatenate([ideal, np.ones((len(rows), 1))], 1), axis=1)
    hidden = np.zeros(len(points), bool)
    z = camera.to_camera(points[rows])[:, 2]
    hidden[rows] = z * inverse > 1.0 + DEPTH_TOLERANCE
    return np.asarray(inside & ~hidden)
