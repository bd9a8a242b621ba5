"""What stays the same of a surface wherever its vertices go: for views that the device projects.

Which vertices triangles have, their paint, which edges end it, and where its pattern lies follow
from its topology and its shape at rest. A series of images of one surface finds them here.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.geometry.feature_edges import feature_edges
from gpusim.optics.geometry.single_layer import border_of
from gpusim.optics.geometry.surface_normals import Shape
from gpusim.optics.geometry.vertex_attributes import FEW
from gpusim.optics.raster.triangle_records import BLOCK
from gpusim.optics.series.normals import Around
from gpusim.surface.paint import Checker, Plain
from gpusim.surface.plane import PaintFrame
from gpusim.surface.speckle import Speckle
from gpusim.surface.surface import Surface

__all__ = ["Steady"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Short = npt.NDArray[np.int32]


class Steady:
    """A surface whose triangles share all their vertices, as far as paint is concerned.

    ``paint`` and ``body`` (T,): as a view has them; ``border``: vertices at which sides without a
    neighbour begin and end, (n,) each; ``frame``: of the one pattern that there is, or None.
    """

    def __init__(self, surface: Surface) -> None:
        topology = surface.topology
        self._still = surface.rest is surface.points
        # copies: somebody may edit them in place
        self.topology, self.regions = topology, surface.regions.copy()
        self.rest = surface.rest if self._still else surface.rest.copy()
        self.paints = list(surface.paints.values())
        self.paint: Short = np.take(surface.regions, topology.source, mode="clip")
        self.body: Short = np.zeros(len(self.paint), np.int32)
        self.border = border_of(topology, None)
        frames = [surface.paint_frame(number) for number in surface.extents]
        self.frame = frames[0] if frames else None
        self._corners: dict[bool, Numbers] = {}
        self._sources: dict[bool, Numbers] = {}
        self._around: Around | None = None

    @staticmethod
    def suits(surface: Surface) -> bool:
        """Whether a surface is one of those: an oriented one with one plane pattern at most."""
        topology = surface.topology
        if not topology.oriented or len(surface.points) > FEW * len(topology.triangles):
            return False
        # a second pattern's vertices are its own, and so are corners of one that isn't plane
        if not all(
            isinstance(paint, Plain | Checker | Speckle) for paint in surface.paints.values()
        ):
            return False
        frames = [surface.paint_frame(number) for number in surface.extents]
        return len(frames) < 2 and all(isinstance(frame, PaintFrame) for frame in frames)

    def is_of(self, surface: Surface) -> bool:
        """Whether that is so of a surface, maybe with its vertices elsewhere."""
        paints = list(surface.paints.values())
        return (
            self.topology is surface.topology
            and self._still == (surface.rest is surface.points)
            and (self._still or np.array_equal(self.rest, surface.rest))
            and np.array_equal(self.regions, surface.regions)
            and len(paints) == len(self.paints)
            and all(one is other for one, other in zip(paints, self.paints, strict=True))
            and all(surface.paint_frame(number) is self.frame for number in surface.extents)
        )

    def rest_of(self, shape: Shape) -> Array:
        """(V, 3): vertices at rest of the surface that has this shape.

        Where a surface was made without a reference they are those that are seen.
        """
        return shape.points if self._still else self.rest

    def corner(self, turned: bool) -> Numbers:
        """(T, 3): vertices of the triangles, if ``turned`` the other way round."""
        if turned not in self._corners:
            columns = self.topology.triangles.T
            if turned:
                columns = np.ascontiguousarray(columns[[0, 2, 1]])
            self._corners[turned] = columns.T
        return self._corners[turned]

    def edge_source(self, turned: bool) -> Numbers:
        """(E, 2): the triangle of each edge that shows where all look the same way, and its
        corner that it begins at."""
        if turned not in self._sources:
            every = np.ones(len(self.paint), bool)
            smooth = np.zeros(len(self.rest), bool)
            shows = feature_edges(
                self.topology, every, self.regions, lambda edges: every[:0], every, smooth
            )
            flags = self.topology.sides(shows, np.arange(len(every)))
            if turned:
                flags = flags[:, [2, 1, 0]]
            self._sources[turned] = np.stack(np.divmod(np.flatnonzero(flags), 3), axis=1)
        return self._sources[turned]

    @property
    def around(self) -> Around:
        """The triangles at each vertex."""
        if self._around is None:
            self._around = Around.of(self.topology.triangles, len(self.rest))
        return self._around

    def painted(self, shape: Shape, side: float) -> npt.NDArray[np.uint32]:
        """(V, 4): cells of the pattern, of that ``side``, and where in them each vertex lies, as
        `gpusim.optics.raster.triangle_records` says."""
        rest = self.rest_of(shape)
        result = np.zeros((len(rest), 4), np.uint32)
        if isinstance(self.frame, PaintFrame):
            for first in range(0, len(result), BLOCK):
                part = slice(first, first + BLOCK)
                st = self.frame.coordinates(rest[part])
                cell = np.floor(st / side)
                result[part].view(np.int32)[:, :2] = cell
                result[part].view(np.float32)[:, 2:] = st - cell * side
        return result
