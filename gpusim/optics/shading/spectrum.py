"""Bands of the spectrum: what each of them has of its own, and how the device is told of three.

A grey scene has one band. A coloured one has red, green and blue, and a grey picture of each would
do: the twins make those. The device makes all three at once, as all but albedos and strengths of
light is the same. It reads the tables of a grey scene, in which the numbers of colours in a palette
stand for albedos, and by how much more, or less, light there is in each band. Twin of
``shaders/lib/light/color_rgb.wgsl``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gpusim.arrays.array_types import Float, Single
from gpusim.optics.geometry.pixel_footprint import RegionPaint
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.paint.bitmap import BitmapTable
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.shading.lighting import MAX_EMITTERS, Lighting
from gpusim.surface.color import BANDS, Color, in_band, is_colored


@dataclass(frozen=True, eq=False)
class SpectralBand:
    """Patterns, bitmaps, light and background of a view as one band of the spectrum has them."""

    table: FeatureGrid
    bitmaps: BitmapTable
    lighting: Lighting
    background: float


def is_coloured_scene(
    paints: Sequence[object], lights: Sequence[Light] | None, background: Color
) -> bool:
    """Whether some of it isn't grey."""
    return any(map(is_colored, (background, *paints, *(lights or ()))))


def spectral_bands(
    first: SpectralBand,
    regions: Sequence[RegionPaint],
    lights: Sequence[Light] | None,
    background: Color,
) -> tuple[SpectralBand, ...]:
    """Red, green and blue of coloured ``regions`` and ``lights``; ``first`` is of the former's red
    and of the latter's means."""
    result = []
    for band in BANDS:
        band_regions, lighting = regions_in_band(regions, band), first.lighting
        if lights is not None:
            lamps = [lamp.light for lamp in lamps_of(lights)]
            share = np.array([1.0 if light.color is None else light.color[band] for light in lamps])
            lighting = lighting.with_strengths_of([in_band(one, band) for one in lights], share)
        bitmaps = BitmapTable({n: band_regions[n].paint for n in first.bitmaps.images})  # type: ignore[misc]
        table = first.table.with_albedos_of(band_regions)
        result.append(SpectralBand(table, bitmaps, lighting, in_band(background, band)))
    return tuple(result)


def regions_in_band(regions: Sequence[RegionPaint], band: int) -> list[RegionPaint]:
    """The same with the grey paints of a band."""
    return [replace(region, paint=in_band(region.paint, band)) for region in regions]


def indexed(bands: Sequence[SpectralBand]) -> tuple[FeatureGrid, Single]:
    """The bands' patterns with numbers of colours for albedos, and the palette (n, 4) of these."""
    tables = [band.table for band in bands]
    first = tables[0]
    values = np.stack([
        np.concatenate([
            table.paints["ground"], table.paints["dot"], table.features[:, 8], table.features[:, 9],
        ])
        for table in tables
    ], axis=1).astype(np.float32)  # fmt: skip
    colors, number = np.unique(values, axis=0, return_inverse=True)
    number = number.reshape(-1).astype(np.float64)
    palette = np.zeros((len(colors), 4), np.float32)
    palette[:, :3] = colors
    count = len(first.paints)
    paints, features = first.paints.copy(), first.features.copy()
    paints["ground"], paints["dot"] = number[:count], number[count : 2 * count]
    features[:, 8:10] = number[2 * count :].reshape(2, -1).T
    return replace(first, paints=paints, features=features), palette


def tints(mean: Lighting, bands: Sequence[SpectralBand]) -> dict[str, Float]:
    """The uniform ``tints``: by what each band's light differs from that of ``mean``."""

    def by_band(values: Sequence[float], of: float) -> Float:
        share = np.zeros(4)
        share[:3] = np.array(values) / of if of else 0.0
        return share

    emitters = np.zeros((MAX_EMITTERS, 4))
    count = len(mean.emitters)
    whole = mean.emitters[:, 3]
    linear, diagonal, mixed = np.zeros((3, 4)), np.zeros((3, 4)), np.zeros((3, 4))
    for k, band in enumerate(bands):
        emitters[:count, k] = band.lighting.emitters[:, 3] / whole
        sky = band.lighting.environment
        if sky is not None:
            linear[k] = *sky.linear, sky.constant
            square = sky.quadratic
            diagonal[k, :3] = np.diag(square)
            mixed[k, :3] = square[1, 2], square[2, 0], square[0, 1]
    return {
        "even": by_band([band.lighting.ambient for band in bands], mean.ambient),
        "behind": np.array([*(band.background for band in bands), 0.0]),
        "linear": linear, "diagonal": diagonal, "mixed": mixed, "emitters": emitters,
    }  # fmt: skip
