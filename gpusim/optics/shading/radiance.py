"""Radiance of pixels whose albedo is known, in NumPy.

Twin of ``shaders/lib/light/surface.wgsl``.
"""

from __future__ import annotations

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.optics.camera.undistortion_table import undistorted
from gpusim.optics.shading.lighting import SharesOf
from gpusim.optics.shading.setup import Setup


def radiance_of(
    setup: Setup,
    triangle: Long,
    x: Float,
    y: Float,
    albedo: Float,
    printed: Float,
    sides: Float | None = None,
    shares: SharesOf | None = None,
) -> Float:
    """Radiance (bands, n) towards the eye at pixel positions; the mean ``albedo`` (bands, n) itself
    if unlit.

    ``printed``: share of the area that a glossy paint's matte pattern covers; ``sides`` (n, 2, 2),
    as columns: of the parallelogram that the light stands for, by those of the pixel's sensitive
    square; None for all of that; ``shares``
    tells what is seen of lamps, as `Shadows.shares` does, which is asked without.
    """
    if not setup.lit:
        return albedo
    ideal, bend = undistorted(setup.view.camera, np.stack([x, y], axis=1))
    records = setup.coefficients.of(triangle)
    d, planes = ideal - records.anchor, records.planes
    values = planes[:, 2:, 0] * d[:, :1] + planes[:, 2:, 1] * d[:, 1:] + planes[:, 2:, 2]
    depth = 1.0 / (values[:, 0] * records.mean_inverse)
    rays = setup.view.rays()
    position = depth[:, None] * (np.c_[ideal, np.ones(len(x))] @ rays.T)
    normal = values[:, 1:]
    normal = normal / np.linalg.norm(normal, axis=1)[:, None]
    rate = (planes[:, 2, :2] / values[:, :1])[:, None]
    change = depth[:, None, None] * rays[:, :2] - position[:, :, None] * rate
    widened = np.zeros(len(x))
    if setup.traits.bumps is not None:
        normal, widened = setup.traits.bumps.leaning(
            triangle, d, values[:, 0], planes[:, 2, :2], normal, change[:, :, 0], change[:, :, 1]
        )
    change = change @ bend if sides is None else change @ (bend @ sides)
    paint = setup.view.paint[triangle]
    shadows, seen = setup.lighting.shadows, None
    if shadows is not None:
        across, down = change[:, :, 0], change[:, :, 1]
        seen = (shares or shadows.shares)(x, y, position, normal, across, down, triangle)
    bare = np.clip(1.0 - printed, 0.0, 1.0)
    result = np.empty((len(setup.bands), len(x)))
    for k, (band, own_albedo) in enumerate(zip(setup.bands, albedo, strict=True)):
        reflected = band.lighting.reflect(triangle, paint, position, normal, widened, seen)
        result[k] = own_albedo * reflected.matte
        gloss = band.lighting.gloss
        if gloss is not None:
            whole = band.table.paints["featured"][paint] > 1
            ground = np.where(whole, own_albedo, band.table.paints["ground"][paint])
            shiny = (own_albedo - ground * bare) * reflected.matte
            shiny += bare * (ground * reflected.p + reflected.q)
            result[k] = np.where(gloss.glossy[paint], shiny, result[k])
    return result
