"""Ground truth per pixel, at the pixel's centre and unfiltered, in float64."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Int, Long
from gpusim.field_summary import field_summary
from gpusim.mesh.polygons import unit_normals
from gpusim.optics.geometry.triangle_corners import NORMAL, POSITION, REFERENCE
from gpusim.optics.geometry.view import View
from gpusim.validation import require

DEPTH_TOLERANCE = 1e-3
"""Relative depth by which a point may lie behind what its pixel sees and still count as seen."""
BAND = 256
"""Rows that are evaluated together: those of a chunk of truth.h5."""
_CHUNK = 1 << 15  # pixels whose values stay in the cache
# columns of the attribute table
_WIDTH, _REFERENCE, _DISPLACEMENT, _NORMAL = 10, slice(1, 4), slice(4, 7), slice(7, 10)


@dataclass(frozen=True, eq=False)
class Truth:
    """What each of n pixels sees (Eulerian: the values belong to the pixel in this frame).

    ``row``, ``column`` (n,); ``depth`` (n,) along the optical axis; ``reference`` (n, 3)
    undeformed position of the material point seen, world; ``displacement`` (n, 3) of that point,
    world; ``flow`` (n, 2) px from this pixel to where the undeformed point projects; ``normal``
    (n, 3) unit normal on the side seen, world: smooth if the frame is lit, else the triangle's;
    ``face``, ``region`` (n,) numbers; ``shape`` (H, W).

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> truth = gs.render([wall], camera, backend="numpy").truth()
    >>> truth.image("depth").shape, float(truth.depth[0])
    ((4, 6), 2.0)
    """

    shape: tuple[int, int]
    row: Long
    column: Long
    depth: Float
    reference: Float
    displacement: Float
    flow: Float
    normal: Float
    face: Int
    region: Int
    __repr__ = field_summary

    LAYERS = ("depth", "reference", "displacement", "flow", "normal", "face", "region")

    def image(self, layer: str) -> Float:
        """A layer as an (H, W) or (H, W, k) image; pixels that see nothing hold NaN."""
        expected = f"one of {list(self.LAYERS)}"
        require(layer in self.LAYERS, "truth layer", repr(layer), expected)
        values = getattr(self, layer)
        image = np.full((*self.shape, *values.shape[1:]), np.nan)
        image[self.row, self.column] = values
        return image


class TruthMap:
    """The truth of a view, evaluated a band of rows at a time from its visibility ids (H, W).

    ``faces`` (first, stop) keeps only pixels that see these faces, counted over all surfaces.
    """

    def __init__(
        self, view: View, ids: npt.NDArray[np.uint32], faces: tuple[int, int] | None = None
    ) -> None:
        self.view, self.ids = view, ids
        seen = np.zeros(view.count + 1, bool)
        for first in range(0, len(ids), BAND):
            seen[ids[first : first + BAND]] = True
        seen[0] = False
        if faces is not None:
            seen[1:] &= (view.face >= faces[0]) & (view.face < faces[1])
        self._wanted = seen
        self._triangles = np.flatnonzero(seen[1:])
        self._place = np.cumsum(seen) - 1
        self._planes = _attribute_planes(view, self._triangles)

    def bands(self) -> Iterator[Truth]:
        """The whole image from top to bottom; the next band is made while one is used."""
        firsts = range(0, len(self.ids), BAND)
        with ThreadPoolExecutor(1) as pool:
            coming = pool.submit(self.rows, 0, BAND)
            for first in firsts:
                band = coming.result()
                if first + BAND < len(self.ids):
                    coming = pool.submit(self.rows, first + BAND, first + 2 * BAND)
                yield band

    def rows(self, first: int, stop: int) -> Truth:
        """The truth of the pixels in rows ``first`` … ``stop - 1``."""
        view, camera = self.view, self.view.camera
        ids = self.ids[first:stop]
        row, column = np.nonzero(self._wanted[ids])
        place = self._place[ids[row, column]]
        row += first
        pixels = np.stack([column, row], axis=1).astype(np.float64)
        values = np.empty((len(row), _WIDTH))
        flow = np.empty((len(row), 2))
        for start in range(0, len(row), _CHUNK):
            part = slice(start, start + _CHUNK)
            own = values[part] = self._evaluate(place[part], camera.undistort(pixels[part]))
            flow[part] = camera.project(own[:, _REFERENCE]) - pixels[part]
        triangle = self._triangles[place]
        values[:, _REFERENCE] += view.origin
        return Truth(
            shape=(camera.height, camera.width),
            row=row,
            column=column,
            depth=values[:, 0],
            reference=values[:, _REFERENCE],
            displacement=values[:, _DISPLACEMENT],
            flow=flow,
            normal=values[:, _NORMAL],
            face=view.face[triangle],
            region=view.paint[triangle],
        )

    def _evaluate(self, place: Long, pixels: Float) -> Float:
        """Depth and attributes (n, 10) at ideal pixels (n, 2) of the triangles at ``place``."""
        result: Float = self._planes[0].take(place, axis=0)
        result *= pixels[:, :1]
        other = self._planes[1].take(place, axis=0)
        other *= pixels[:, 1:]
        result += other
        result += self._planes[2].take(place, axis=0)
        depth = 1.0 / result[:, 0]
        result *= depth[:, None]
        result[:, 0] = depth
        normal = result[:, _NORMAL]
        normal /= np.sqrt(np.einsum("na,na->n", normal, normal))[:, None]
        return result


def truth_of(
    view: View, ids: npt.NDArray[np.uint32], faces: tuple[int, int] | None = None
) -> Truth:
    """The truth of a view's whole image at once, from its visibility ids (H, W)."""
    return TruthMap(view, ids, faces).rows(0, len(ids))


def _attribute_planes(view: View, triangles: Long) -> Float:
    """(3, T, 10): coefficients of x, y and 1 for 1 / z, and for every attribute times 1 / z."""
    corners = view.corners[triangles]
    T = view.camera.camera_from_world
    world = (corners[:, :, POSITION] - T[:3, 3]) @ T[:3, :3]
    # relative to the origin here: far from zero, planes would leave few of their digits
    reference = corners[:, :, REFERENCE] - view.origin
    normal = corners[:, :, NORMAL]
    if not normal.any():  # not lit: the triangles' own
        normal = np.repeat(unit_normals(world)[:, None], 3, axis=1)
    values = np.concatenate(
        [np.ones((*corners.shape[:2], 1)), reference, world - reference, normal], axis=2
    )
    basis = view.planes_of(triangles)
    planes: Float = np.ascontiguousarray(np.einsum("tia,tik->kta", values, basis))
    return planes


def seen_in(view: View, ids: npt.NDArray[np.uint32], points: Float) -> Bool:
    """Whether world points (n, 3) on the surfaces of ``view`` are seen there, not hidden."""
    camera, points = view.camera, points - view.origin
    at = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = np.all((at >= -0.5) & (at < [camera.width - 0.5, camera.height - 0.5]), axis=1)
    pixel = np.rint(np.where(inside[:, None], at, 0.0)).astype(np.int64)
    number = ids[pixel[:, 1], pixel[:, 0]].astype(np.int64)
    rows = np.flatnonzero(inside & (number > 0))
    planes = view.planes_of(number[rows] - 1).sum(axis=1)
    # the seen triangle's depth at the point's own place: a steep face isn't in front of itself
    ideal = camera.without_distortion().project(points[rows])
    inverse = np.sum(planes * np.concatenate([ideal, np.ones((len(rows), 1))], 1), axis=1)
    hidden = np.zeros(len(points), bool)
    z = camera.to_camera(points[rows])[:, 2]
    hidden[rows] = z * inverse > 1.0 + DEPTH_TOLERANCE
    return np.asarray(inside & ~hidden)
