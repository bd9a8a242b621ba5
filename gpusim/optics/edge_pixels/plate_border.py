"""Edge pixels of one flat plate before the background, where it shows one albedo: shares of areas.

Unlit, such a pixel is as bright as the share of its square that the plate covers: one side of a
line for most, the areas of the triangles over it at corners. Nothing has to be sorted, nor looked
up (`gpusim.optics.edge_pixels.resolve` does that for all other views).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import MARGIN, segment_hits
from gpusim.optics.frame import Band, write_pixels
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.geometry.polygon_clipping import (
    clip_square,
    half_plane_share,
    half_planes,
    moments,
)
from gpusim.optics.geometry.triangle_corners import ST
from gpusim.optics.geometry.view import View
from gpusim.surface.paint import Checker, Plain

MAX_EDGES = 64
"""Of a plate; where they are more, so are the pixels with two of them."""

MAX_TRIANGLES = 4096


@dataclass(frozen=True, eq=False)
class Border:
    """All edge pixels of a view: ``pixel`` (n,) linear indices, radiance ``value`` (n,)."""

    pixel: Long
    value: Float

    @staticmethod
    def suits(view: View) -> bool:
        """Whether an unlit view shows one flat plate, and its ground alone along the border."""
        if view.camera.lens is not None or not 0 < len(view.edges) <= MAX_EDGES:
            return False
        if view.count > MAX_TRIANGLES or not view.flat or np.ptp(view.paint):
            return False
        return _even(view, view.paints[view.paint[0]])

    @staticmethod
    def of(view: View, background: float) -> Border:
        """Those of a view that suits."""
        width, height = view.camera.width, view.camera.height
        pixel, segment = segment_hits(view.edges, width, height)
        order = np.argsort(pixel, kind="stable")
        pixel, segment = pixel[order], segment[order]
        new = np.concatenate([[True], pixel[1:] != pixel[:-1], [True]])
        at = np.stack([pixel % width, pixel // width], axis=1).astype(np.float64)
        side = view.camera.pixel_side
        a, b = ((view.edges[segment, end] - at) / side for end in (0, 1))
        # one that ends here isn't all that there is
        near = (np.abs([a, b]) <= 0.5 + 2.0 * MARGIN).all(axis=2).any(axis=0)
        alone = new[:-1] & new[1:] & ~near
        corner = np.flatnonzero(new[:-1] & ~alone)
        other = _covered(view, at[corner])
        a, b = a[alone], b[alone]
        along = b - a
        inwards = np.stack([-along[:, 1], along[:, 0]]) * _turn(view)
        inwards /= np.hypot(*along.T)
        share = half_plane_share(-(inwards[0] * a[:, 0] + inwards[1] * a[:, 1]), *inwards)
        share = np.concatenate([share, other])
        ground = view.paints[view.paint[0]].paint.ground
        value = background + share * (ground - background)
        return Border(np.concatenate([pixel[alone], pixel[corner]]), value)


class PlateBorderPass:
    """Those pixels in a picture: in place of `gpusim.optics.edge_pixels.resolve.EdgePixelPass`."""

    def __init__(self, device: Device, view: View, background: float) -> None:
        self._device, self._width = device, view.camera.width
        self._border = Border.of(view, background)

    def find(self) -> None:
        """There is nothing for the device."""

    host_pass = find

    def write(self, bands: Sequence[Band]) -> None:
        """Write the pixels into ``bands``."""
        value = self._border.value[None].astype(np.float32)
        write_pixels(self._device, bands, self._width, self._border.pixel, value)


def _covered(view: View, at: Float) -> Float:
    """Share (n,) of the squares of pixels ``at`` (n, 2) that lie under triangles."""
    low, high = view.box
    over = (low < at[:, None] + 0.5).all(axis=2) & (high > at[:, None] - 0.5).all(axis=2)
    pixel, triangle = np.nonzero(over)
    corners = (view.screen[triangle] - at[pixel][:, None]) / view.camera.pixel_side
    area = moments(clip_square(half_planes(corners))[0])[0]
    return np.minimum(np.bincount(pixel, area, len(at)), 1.0)


def _turn(view: View) -> float:
    """1 where the triangles' corners go round counter-clockwise in x, y of the image, else -1."""
    a, b = view.screen[:, 1] - view.screen[:, 0], view.screen[:, 2] - view.screen[:, 0]
    return float(np.sign((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()))


def _even(view: View, region: RegionPaint) -> bool:
    """Whether the paint shows its ground alone along all edges; False for those that may not."""
    paint = region.paint
    if isinstance(paint, Plain):
        return True
    if not isinstance(paint, Checker):
        return False
    triangle, corner = view.edge_source.T
    ends = np.stack([corner, (corner + 1) % 3], axis=1)
    st = view.corners[triangle[:, None], ends][:, :, ST] - np.array(paint.origin)
    # straight lines stay straight: beyond one side at both ends is beyond it everywhere
    away = 3.0 * region.reach
    beyond = np.zeros(len(st), bool)
    for axis, many in enumerate((paint.columns, paint.rows)):
        if many is not None:
            beyond |= (st[:, :, axis] < -away).all(axis=1)
            beyond |= (st[:, :, axis] > many * paint.size + away).all(axis=1)
    return bool(beyond.all())
