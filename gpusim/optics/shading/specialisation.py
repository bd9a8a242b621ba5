"""What of the shaders' code a view needs: names of programs, and their override constants."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gpusim.optics.geometry.view import View
from gpusim.optics.paint.bitmap import BITMAP, PIECES, pieces_needed
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.shading.lighting import Lighting
from gpusim.optics.shading.triangle_traits import GRAZING, TriangleTraits
from gpusim.surface.color import in_band


@dataclass(frozen=True, eq=False)
class Specialisation:
    """Programs that leave out what a ``view`` has nothing of.

    ``table``: the patterns of its paints; ``coloured``: there are three bands in place of one.
    """

    view: View
    table: FeatureGrid
    lighting: Lighting
    lit: bool
    coloured: bool
    traits: TriangleTraits

    def name(self, file: str) -> str:
        """The name of a shader ``file`` that is compiled for as many bands as there are."""
        return f"{file}@rgb" if self.coloured else file

    @cached_property
    def _pattern_traits(self) -> tuple[bool, bool]:
        """Whether squares may be smaller than a pixel, and whether every disc is far larger."""
        fine, large = False, True
        for region, record in zip(self.view.paints, self.table.paints, strict=False):
            if record["featured"] == 1:
                features = in_band(region.paint, 0).features(region.low, region.high)
                assert features is not None
                patches = features.kind == 0
                # the footprint's extent along the axes of a turned patch
                angle = features.angle[patches]
                spread = 2.0 * region.reach * (np.abs(np.cos(angle)) + np.abs(np.sin(angle)))
                radius = features.size[features.kind == 1, 0]
                # region.reach bounds the half diagonal of every footprint from above
                large &= bool(radius.min(initial=np.inf) > 3.0 * region.reach)
                fine |= bool((spread > features.size[patches].min(axis=1)).any())
        return fine, large

    @cached_property
    def _bitmap_variant(self) -> int:
        """2 where a pixel may span so many texels that they are taken all at once, else 1."""
        rows = np.flatnonzero(self.traits.groups == BITMAP)
        widest = 0.0
        for corner in range(3):
            at = self.view.screen[rows, corner]
            _, _, ex, ey, _ = self.traits.coefficients.footprint(rows, at[:, 0], at[:, 1])
            widest = max(widest, pieces_needed(ex, ey))
        # footprints change little more between the corners of a triangle
        return 2 if 1.2 * widest > PIECES else 1

    @property
    def fine(self) -> bool:
        """Whether squares of a pattern may be smaller than a pixel."""
        return self._pattern_traits[0]

    @cached_property
    def looks(self) -> tuple[bool, bool]:
        """Whether some triangles are glossy, and whether some have a relief."""
        return bool(self.traits.shiny.any()), bool(self.traits.bumpy.any())

    def light_constants(self, glossy: bool, bumpy: bool) -> dict[str, float]:
        """Override constants of how triangles are lit; whether some of them are ``glossy`` or
        ``bumpy``."""
        return {
            "distorted": float(self.view.camera.lens is not None),
            "aperture": self.view.camera.pixel_side,
            "bumpy": float(bumpy),
            **self.lighting.constants(glossy),
        }

    def constants(self, groups: Collection[int], glossy: bool, bumpy: bool) -> dict[str, float]:
        """Override constants that leave out of a shader what ``groups`` of triangles don't have.

        ``glossy`` and ``bumpy``: whether some of them have glossy paint, or a relief.
        """
        kept = set(groups)
        kinds = self.table.kinds() if 1 in groups else set()
        fine, large = self._pattern_traits if 1 in groups else (False, False)
        return {
            "lit": float(self.lit),
            "patterned": float(any(groups)),
            "speckle": float(bool({2, 2 + GRAZING} & kept) + 2 * bool({3, 3 + GRAZING} & kept)),
            "grazing": float(bool({2 + GRAZING, 3 + GRAZING} & kept)),
            **self.light_constants(glossy, bumpy),
            "checkers": float(0 in kinds),
            "discs": float((2 if large else 1) if 1 in kinds else 0),
            "sectors": float(2 in kinds),
            "fine": float(fine),
            "bitmaps": float(self._bitmap_variant if BITMAP in groups else 0),
        }
