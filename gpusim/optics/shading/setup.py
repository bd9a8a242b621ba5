"""A view set up for shading: per-triangle coefficients, pattern tables and lamps, in float64."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from gpusim.arrays.array_types import Single
from gpusim.gpu import Device
from gpusim.optics.geometry.view import View
from gpusim.optics.light.lights import Light
from gpusim.optics.paint.bitmap import BitmapTable
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.shading.coefficients import CoefficientCache
from gpusim.optics.shading.lighting import Lighting
from gpusim.optics.shading.specialisation import Specialisation
from gpusim.optics.shading.spectrum import (
    SpectralBand,
    indexed,
    is_coloured_scene,
    regions_in_band,
    spectral_bands,
)
from gpusim.optics.shading.triangle_traits import TriangleTraits
from gpusim.surface.color import Color
from gpusim.surface.surface import Surface


@dataclass(frozen=True, eq=False)
class Setup:
    """A view with what its passes share: patterns, lamps, coefficients of its triangles.

    ``bands``: of the spectrum, one where all is grey. Where something has a colour, ``table`` has
    numbers of colours in ``palette`` (n, 4), and ``lighting`` and ``background`` are the bands'
    mean (`gpusim.optics.shading.spectrum`).
    """

    view: View
    table: FeatureGrid
    bitmaps: BitmapTable
    lighting: Lighting
    background: float
    lit: bool
    bands: tuple[SpectralBand, ...]
    palette: Single | None
    coefficients: CoefficientCache

    @staticmethod
    def build(
        view: View,
        lights: Sequence[Light] | None,
        background: Color,
        surfaces: Sequence[Surface] = (),
        device: Device | None = None,
    ) -> Setup:
        """Set up every triangle of ``view``; ``lights`` None shows the albedo itself.

        ``surfaces`` cast shadows and hide surroundings, which ``device`` looks at.
        """
        colored = is_coloured_scene([one.paint for one in view.paints], lights, background)
        regions = regions_in_band(view.paints, 0) if colored else view.paints
        table = FeatureGrid.build(regions, view.extent)
        bitmaps = BitmapTable.build(regions, table.paints)
        grey = [light.grey for light in lights] if colored and lights else lights
        lighting = Lighting.build(view, grey, surfaces, device)
        lit = lights is not None
        coefficients = CoefficientCache(view, table, bitmaps, lit)
        behind = np.mean(background)
        own = SpectralBand(table, bitmaps, lighting, float(behind))
        bands: tuple[SpectralBand, ...] = (own,)
        palette = None
        if colored:
            bands = spectral_bands(own, view.paints, lights, background)
            table, palette = indexed(bands)
            bitmaps = replace(bitmaps, bands=tuple(band.bitmaps for band in bands))
        return Setup(
            view, table, bitmaps, lighting, own.background, lit, bands, palette, coefficients
        )

    @cached_property
    def traits(self) -> TriangleTraits:
        """What its triangles are like."""
        return TriangleTraits(
            self.view, self.table, self.lighting.gloss, self.lit, self.coefficients
        )

    @cached_property
    def programs(self) -> Specialisation:
        """The programs that it takes."""
        return Specialisation(
            self.view, self.table, self.lighting, self.lit, self.palette is not None, self.traits
        )
