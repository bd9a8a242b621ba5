"""Fine relief on the triangles of a view: how it turns the normal over a pixel.

A wave of wave vector k has, where k . X changes by (p, q) from column to column and row to row, the
mean slope -(p, q) a sin(k . X + phase) sinc(p/2) sinc(q/2) over a pixel: the filter of its area,
in closed form. The variance of slope that the filter takes away is still there for the light:
microfacets lean by it, too, and GGX's alpha^2 grows by twice its mean over both directions
(Olano and Baker, "LEAN mapping", 2010).

Twin of ``shaders/lib/paint/relief_normals.wgsl``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long, Single
from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.geometry.triangle_corners import REFERENCE, corner_mean
from gpusim.optics.geometry.view import View
from gpusim.surface.features import PERIOD, WAVES, Bump, bump_waves


def bump_of(region: RegionPaint) -> Bump | None:
    """The relief of a paint, if it has one."""
    bump: Bump | None = getattr(region.paint, "bump", None)
    return bump


@dataclass(frozen=True, eq=False)
class Bumps:
    """``member`` (T,): the triangles with a relief. ``planes`` (T, 3, 3): its coordinates over the
    depth, affine in the offset (dx, dy, 1) from the anchor; ``amplitude`` (T,): of each wave.
    ``side``: px, of a pixel's sensitive square."""

    member: Bool
    planes: Float
    amplitude: Float
    side: float

    @staticmethod
    def build(view: View, anchor: Float, mean_inverse: Float) -> Bumps:
        """``anchor`` (T, 2) and ``mean_inverse`` (T,) as of `optics.shading.coefficients`."""
        member = np.zeros(view.count, bool)
        planes, amplitude = np.zeros((view.count, 3, 3)), np.zeros(view.count)
        for number, region in enumerate(view.paints):
            bump = bump_of(region)
            if bump is None:
                continue
            rows = np.flatnonzero(view.paint == number)
            member[rows] = True
            amplitude[rows] = bump.height * np.sqrt(2.0 / WAVES)
            at = view.corners[rows][:, :, REFERENCE] @ bump.unit().T + bump.shift()
            # whole periods make no difference, but cost digits
            at -= np.round(corner_mean(at) / PERIOD)[:, None] * PERIOD
            basis = view.planes_of(rows) / mean_inverse[rows, None, None]
            slopes = np.einsum("tca,tck->tak", at, basis)
            slopes[:, :, 2] += np.einsum("tak,tk->ta", slopes[:, :, :2], anchor[rows])
            planes[rows] = slopes
        return Bumps(member, planes, amplitude, view.camera.pixel_side)

    def texels(self) -> Single:
        """(3 T, 4) as lib/paint/relief_normals.wgsl reads them."""
        rows = np.zeros((max(len(self.member), 1), 12), np.float32)
        rows[: len(self.member), :9] = self.planes[:, :, [2, 0, 1]].reshape(-1, 9)
        rows[: len(self.member), 9] = self.amplitude
        return rows.reshape(-1, 4)

    def leaning(
        self,
        triangle: Long,
        d: Float,
        w: Float,
        rate: Float,
        normal: Float,
        across: Float,
        down: Float,
    ) -> tuple[Float, Float]:
        """Unit normals (n, 3) under the relief, and what alpha^2 grows by (n,).

        ``d`` (n, 2): offsets from the anchors; ``w`` (n,), ``rate`` (n, 2): the reciprocal depth
        there relative to the triangle's, and its change per column and row; ``across``, ``down``
        (n, 3): how the place changes.
        """
        normal, widened = normal.copy(), np.zeros(len(triangle))
        rows = np.flatnonzero(self.member[triangle])
        planes, w = self.planes[triangle[rows]], w[rows, None]
        place = np.einsum("nak,nk->na", planes, np.c_[d[rows], np.ones(len(rows))]) / w
        ex = (planes[:, :, 0] - place * rate[rows, :1]) / w
        ey = (planes[:, :, 1] - place * rate[rows, 1:]) / w
        dx, dy = across[rows], down[rows]
        xx, xy, yy = (np.einsum("ni,ni->n", a, b) for a, b in ((dx, dx), (dx, dy), (dy, dy)))
        inverse = np.stack([yy, -xy, xx]) / np.maximum(xx * yy - xy * xy, 1e-30)
        slope, lost_slope = np.zeros((2, len(rows))), np.zeros(len(rows))
        for *vector, phase in bump_waves():
            p, q = ex @ vector, ey @ vector
            kept = np.prod([np.sinc(self.side / (2.0 * np.pi) * turn) for turn in (p, q)], axis=0)
            slope -= np.stack([p, q]) * (kept * np.sin(place @ vector + phase))
            steep = inverse[0] * p * p + 2.0 * inverse[1] * p * q + inverse[2] * q * q
            lost_slope += (1.0 - kept * kept) * steep
        amplitude = self.amplitude[triangle[rows]]
        rise = amplitude * np.stack(
            [
                inverse[0] * slope[0] + inverse[1] * slope[1],
                inverse[1] * slope[0] + inverse[2] * slope[1],
            ]
        )
        turned = normal[rows] - rise[0][:, None] * dx - rise[1][:, None] * dy
        normal[rows] = turned / np.linalg.norm(turned, axis=1)[:, None]
        widened[rows] = 0.5 * amplitude**2 * lost_slope
        return normal, widened


def bump_uniform(bumps: Bumps | None) -> dict[str, Float | int]:
    """The waves as the shaders' uniform ``relief``."""
    return {"waves": np.zeros((WAVES, 4)) if bumps is None else bump_waves(), "count": WAVES}


def bump_texels(device: Device, bumps: Bumps | None) -> Texels:
    """The triangles' reliefs on the device."""
    if bumps is None:
        return device.no_texels("rgba32float")
    rows = bumps.texels()
    texels = device.texels(len(rows), "rgba32float", "shade.bumps")
    texels.write(rows)
    return texels
