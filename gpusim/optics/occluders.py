"""The faces that may hide surroundings; flat parts are joined as for shadows
(`gpusim.optics.merging`)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gpusim.optics.casters import Casters
from gpusim.optics.contours import Contours
from gpusim.optics.facets import Facets
from gpusim.optics.view import View
from gpusim.surface.surface import Surface

__all__ = ["Occluders"]

FLATNESS = 0.05
"""px at the nearest surface, that joined faces may pass from the surface."""


@dataclass(frozen=True, eq=False)
class Occluders:
    """``contours``, relative to the eye; ``sag``: how far faces may pass from the surface."""

    contours: Contours
    sag: float

    @staticmethod
    def of(view: View, surfaces: Sequence[Surface]) -> Occluders:
        """Those of ``surfaces``, to what ``view`` can tell."""
        depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
        sag = FLATNESS * depth / float(np.abs(np.diag(view.camera.K)[:2]).max())
        casters = Casters.of(surfaces, lambda points: np.full(len(points), sag))
        points = casters.points - view.camera.eye
        facets = Facets.of(points, casters.faces, casters.both_sides)
        return Occluders(Contours.of(facets), sag)
