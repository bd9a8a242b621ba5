"""The true displacement of all that a region of interest sees, as subsets see it.

"Levelled" is the truth at a point filtered as the subset around it filters (`subset_filter`), so
that what is left of a difference isn't the smoothing of the settings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.measure.correlation.strain import StrainKind, strain_of_tangents, strain_tensor
from gpusim.measure.correlation.subset_filter import FilteredField, filtered_by_subsets
from gpusim.pipeline.measurements.material_points import MaterialPoints, TrueMotion
from gpusim.pipeline.measurements.region_of_interest import RegionOfInterest
from gpusim.scene.description import model as m

_PIXELS = 1 << 24
"""Of the fields that are filtered together."""
ALIGNED = 1e-9
"""Components of axes that differ by less from a world axis only do so by rounding."""
LEAST_AREA = 1e-3
"""Of a pixel's square along two axes over its sides squared; below, it is seen edge-on."""


@dataclass(frozen=True, eq=False)
class TrueField:
    """What a ``camera`` sees at ``points`` (M, 2) px of its reference picture, and in the region
    ``roi`` around them; ``material``: the points on their surfaces."""

    motion: TrueMotion
    camera: str
    roi: RegionOfInterest
    points: Float
    material: MaterialPoints

    @staticmethod
    def of(motion: TrueMotion, camera: str, roi: RegionOfInterest, points: Float) -> TrueField:
        """Of points that the camera sees."""
        return TrueField(motion, camera, roi, points, motion.seen_at(camera, points))

    def shift(self, frame: int) -> Float:
        """How far the points went in the picture, (M, 2) px."""
        return self.motion.pixels(self.material, self.camera, frame) - self.points

    def field(self, frame: int) -> Float:
        """The same of every pixel of the region, (H, W, 2) px, NaN outside."""
        row, column = np.nonzero(self.roi.mask)
        now = self.motion.pixels(self.roi.points, self.camera, frame)
        return self.roi.image(now - np.stack([column, row], axis=1))

    def levelled(
        self, picture: npt.NDArray[Any], frames: tuple[int, ...], spec: m.DicTable
    ) -> FilteredField:
        """How far the points go as subsets of the reference ``picture`` see it, (F, M, 2) px."""
        together = max(_PIXELS // self.roi.mask.size, 1)
        parts = [
            filtered_by_subsets(
                picture, self.points, [self.field(one) for one in frames[first : first + together]],
                subset=spec.subset_px, shape=spec.shape, mask=self.roi.mask, blur_px=spec.blur_px,
            )
            for first in range(0, len(frames), together)
        ]  # fmt: skip
        moved = np.concatenate([part.displacement for part in parts])
        return replace(parts[0], displacement=moved)

    def surface_strain(self, frame: int, kind: StrainKind) -> Float:
        """Strain (M, 2, 2) at the points themselves, axes as `gpusim.measure.surface_strain`."""
        before, now = (self._slopes(self._places(one)) for one in (0, frame))
        return strain_of_tangents(before, now - before, kind)[0]

    def picture_strain(self, frame: int, kind: StrainKind) -> Float:
        """Strain (M, 2, 2) of what the picture shows, along its axes."""
        seen = self.motion.camera(self.camera).project(self._places(frame))
        return strain_tensor(self._slopes(seen) - np.eye(2), kind)

    def plane_strain(self, frame: int, kind: StrainKind, axes: Float) -> Float:
        """Strain (M, 2, 2) along two ``axes`` (2, 3) of the world in whose plane the surface
        lies; NaN where it is seen edge-on there."""
        before, now = (axes @ self._slopes(self._places(one)) for one in (0, frame))
        return strain_tensor((now - before) @ inverse_slopes(before), kind)

    def resolution(self) -> float:
        """Width of a pixel on the surface, m: the median of the points."""
        return float(np.median(np.sqrt(np.linalg.norm(self._normals(), axis=1))))

    def picture_axes(self) -> Float:
        """Directions (2, 3) in the world, at right angles, that are as near to the picture's right
        and down as directions within the surface can be, which is flat on the whole."""
        normal = np.nanmean(self._normals(), axis=0)
        normal /= np.linalg.norm(normal)
        axes = self.motion.camera(self.camera).camera_from_world[:2, :3]
        left, _, right = np.linalg.svd(axes @ (np.eye(3) - np.outer(normal, normal)), False)
        found = left @ right
        # a camera that is aligned with the world is so exactly
        return np.asarray(np.where(np.abs(found - np.rint(found)) < ALIGNED, np.rint(found), found))

    def _normals(self) -> Float:
        """(M, 3) m^2: of the surface at the points, as long as a pixel's area there."""
        slopes = self._slopes(self._places(0))
        return np.cross(slopes[:, :, 0], slopes[:, :, 1])

    def _places(self, frame: int) -> Float:
        """(4, M, 3) m: where material half a pixel to the right of the points, left, below and
        above is."""
        return np.array([self.motion.position(one, frame) for one in self._around])

    @cached_property
    def _around(self) -> list[MaterialPoints]:
        """These places, on the points' own triangles."""
        return [
            self.motion.on_triangles(self.material, self.camera, self.points + np.array(offset))
            for offset in ((0.5, 0.0), (-0.5, 0.0), (0.0, 0.5), (0.0, -0.5))
        ]

    @staticmethod
    def _slopes(values: Float) -> Float:
        """Differences (M, K, 2) per px along the picture's x and y, of `_places`."""
        return np.stack([values[0] - values[1], values[2] - values[3]], axis=2)


def inverse_slopes(slopes: Float) -> Float:
    """Inverses of (M, 2, 2); NaN where a direction is all but lost."""
    lost = ~(np.abs(np.linalg.det(slopes)) > LEAST_AREA * np.square(slopes).sum(axis=(1, 2)))
    inverse = np.linalg.inv(np.where(lost[:, None, None], np.eye(2), slopes))
    inverse[lost] = np.nan
    return inverse


def region_of_second_camera(
    motion: TrueMotion, roi: RegionOfInterest, first: str, second: str
) -> RegionOfInterest:
    """What the ``second`` camera sees of the region of the ``first`` one."""
    camera = motion.camera(second)
    shape = camera.height, camera.width
    row, column = np.indices(shape).reshape(2, -1)
    points = motion.seen_at(second, np.stack([column, row], axis=1).astype(np.float64))
    mask = points.seen
    x, y = np.rint(np.nan_to_num(motion.pixels(points[mask], first, 0), nan=-1.0)).T
    high, wide = roi.mask.shape
    inside = (x >= 0) & (x < wide) & (y >= 0) & (y < high)
    place = np.where(inside, y, 0).astype(np.int64), np.where(inside, x, 0).astype(np.int64)
    mask[mask] = inside & roi.mask[place]
    mask[mask] = motion.visible(points[mask], first, 0)
    return RegionOfInterest(mask.reshape(shape), points[mask])
