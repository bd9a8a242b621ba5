"""What the triangles of a view are like: plain or near a feature, matte or glossy, in relief."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Single
from gpusim.optics.geometry.view import View
from gpusim.optics.light.microfacet_material import Gloss
from gpusim.optics.paint.checker_lines import matte_boards, within_fields
from gpusim.optics.paint.feature_grid import FeatureGrid
from gpusim.optics.paint.relief_normals import Bumps, bump_of
from gpusim.optics.shading.coefficients import CoefficientCache

GRAZING = 4
"""Added to the number of a group of triangles whose speckle is cut pixel by pixel."""


@dataclass(frozen=True, eq=False)
class TriangleTraits:
    """Traits of the triangles of a ``view``, each found when it is asked for.

    ``table``: the patterns of its paints; ``gloss``: None where all paints are matte; ``lit``:
    unlit triangles show neither gloss nor relief.
    """

    view: View
    table: FeatureGrid
    gloss: Gloss | None
    lit: bool
    coefficients: CoefficientCache

    @cached_property
    def _near_and_albedo(self) -> tuple[Bool, Single]:
        view = self.view
        boards = matte_boards(view.paints, self.gloss)
        near = self.table.near_features(view, boards)
        albedo = np.take(self.table.paints["ground"], view.paint, mode="clip")
        for number in boards:
            within_fields(view, number, self.table.fields(number), near, albedo)
        return near, albedo

    @property
    def near_feature(self) -> Bool:
        """(T,): whether a pixel in it can reach a feature of its pattern, or shows a bitmap."""
        return self._near_and_albedo[0]

    @property
    def albedo(self) -> Single:
        """(T,): of what isn't near a feature."""
        return self._near_and_albedo[1]

    @cached_property
    def groups(self) -> npt.NDArray[np.uint32]:
        """(T,) what a triangle's pixels may meet: 0 one albedo, else its paint's ``featured``.

        That plus `GRAZING` where speckle has larger footprints than its table was made for.
        """
        groups = np.take(
            self.table.paints["featured"].astype(np.uint32), self.view.paint, mode="clip"
        )
        groups *= self.near_feature
        for number, region in enumerate(self.view.paints):
            if region.grazing:
                larger = self.view.footprint > region.reach
                groups[(self.view.paint == number) & larger] += np.uint32(GRAZING)
        return groups

    def groups_present(self) -> list[int]:
        """The different `groups` there are."""
        most = int(self.groups.max(initial=0))
        return [group for group in range(most + 1) if (self.groups == group).any()]

    @cached_property
    def bumps(self) -> Bumps | None:
        """The fine relief of the triangles, if some of them have any and light shows it."""
        if not self.lit or all(bump_of(region) is None for region in self.view.paints):
            return None
        triangles = self.coefficients.all
        return Bumps.build(self.view, triangles.anchor, triangles.mean_inverse)

    @cached_property
    def bumpy(self) -> Bool:
        """(T,) whether a triangle has a fine relief."""
        return np.zeros(self.view.count, bool) if self.bumps is None else self.bumps.member

    @property
    def printed(self) -> Bool:
        """(T,) whether a triangle is near a feature of a print without a relief."""
        result: Bool = (self.groups == 1) & ~self.bumpy
        return result

    @cached_property
    def shiny(self) -> Bool:
        """(T,) whether a triangle's paint is glossy and lit."""
        if self.gloss is None or not self.lit:
            return np.zeros(self.view.count, bool)
        result: Bool = self.gloss.glossy[self.view.paint]
        return result
