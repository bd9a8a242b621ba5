"""What a view's vertices carry and where they are on the image, as far as somebody asks for it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.triangle_corners import POSITION, ST, at_corners

__all__ = ["Vertices"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]

ROUGH = 0.02
"""px by which two of the places `Vertices.about` together may be off."""


class Vertices:
    """``columns`` (V, 11): camera-space position, paint coordinates, world normal, undeformed world
    position, or less of that; ``place`` (V, 2) px, through the lens."""

    def __init__(self, columns: Array, place: Array) -> None:
        self._columns, self._place = columns, place

    @property
    def columns(self) -> Array:
        """(V, 11): see `Vertices`."""
        return self._columns

    @property
    def place(self) -> Array:
        """(V, 2) px."""
        return self._place

    @property
    def about(self) -> list[npt.NDArray[np.floating]]:
        """Columns and rows (V,) each, px, maybe roughly."""
        return list(self.place.T)

    @property
    def position(self) -> Array:
        """(V, 3) in camera space."""
        return self.columns[:, POSITION]

    @property
    def shown(self) -> Array:
        """(V, 5): position and paint coordinates."""
        return self.columns[:, : ST.stop]

    def at_corners(self, columns: slice, corner: list[Numbers]) -> Array:
        """Some ``columns`` at the corners of triangles: (n, 3, …), as
        `triangle_corners.at_corners`."""
        return at_corners(self.columns[:, columns], corner)

    def places_at(self, corner: list[Numbers]) -> Array:
        """(n, 3, 2) px: places at the corners of triangles."""
        return at_corners(self.place, corner)

    def some(self, numbers: Numbers) -> Vertices:
        """Vertices ``numbers`` (n,), again and again where they are."""
        return Vertices(self.columns.T[:, numbers].T, self.place.T[:, numbers].T)
