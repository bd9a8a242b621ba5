"""What a device keeps of a surface from one image to the next: its triangles, places, normals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device, Recording
from gpusim.gpu.texture_array import Texels
from gpusim.optics.geometry.surface_normals import Shape
from gpusim.optics.series.normals import NormalsPass
from gpusim.optics.series.project import fill
from gpusim.optics.series.steady import Steady
from gpusim.surface.surface import Surface

__all__ = ["Resident"]

LABEL = "optics.resident"


class Resident:
    """The surface of the last image on a device, from its second image in a row on.

    The first one costs less without: most of what is kept takes longer to make than to use once.
    ``trusted``: False once a view of it wasn't what it was taken for.
    """

    def __init__(self, device: Device, surface: Surface) -> None:
        self.device, self.topology = device, surface.topology
        self.trusted = True
        self.steady: Steady | None = None
        self._corners: dict[bool, Buffer] = {}
        self._points: tuple[Shape, Buffer] | None = None
        self._vertices: Texels | None = None
        self._painted: float | None = None
        self._rest: npt.NDArray[np.float64] | None = None
        self._normals: tuple[Shape, bool, float] | None = None
        self._pass: NormalsPass | None = None

    @staticmethod
    def of(device: Device, surface: Surface) -> Resident | None:
        """What is kept of a surface; None where it is new, or looked at in vain."""
        known = device.pool.notes.get(LABEL)
        if not isinstance(known, Resident) or known.topology is not surface.topology:
            device.pool.notes[LABEL] = Resident(device, surface)
            return None
        if known.steady is not None and not known.steady.is_of(surface):
            device.pool.notes[LABEL] = known = Resident(device, surface)
        if known.trusted and known.steady is None:
            known.trusted = Steady.suits(surface)
            known.steady = Steady(surface) if known.trusted else None
        return known if known.trusted else None

    def corners(self, turned: bool) -> Buffer:
        """Three vertices of every triangle, if ``turned`` the other way round."""
        if turned not in self._corners:
            assert self.steady is not None
            corner = np.ascontiguousarray(self.steady.corner(turned), np.uint32)
            self._corners[turned] = self.device.buffer(corner.reshape(-1), "resident.corners")
        return self._corners[turned]

    @property
    def vertices(self) -> Texels:
        """Three texels each as `gpusim.optics.raster.triangle_records` says, the last two once
        `prepare` has been asked for them."""
        if self._vertices is None:
            assert self.steady is not None
            count = 3 * len(self.steady.rest)
            self._vertices = self.device.texels(count, "rgba32uint", "resident.vertices")
        return self._vertices

    def points(self, shape: Shape) -> Buffer:
        """Places (V, 3) in the world."""
        if self._points is None or self._points[0] is not shape:
            values = shape.points.reshape(-1)
            self._points = shape, self.device.real_buffer(values, "resident.points")
        return self._points[1]

    def prepare(
        self,
        recording: Recording,
        shape: Shape,
        turned: bool,
        counts: Buffer,
        size: float,
        side: float | None = None,
    ) -> None:
        """Find paint coordinates in cells of a ``side``, and normals, on the device where the host
        hasn't, as far as they aren't known; ``counts`` and ``size`` as `NormalsPass` says.

        ``side`` None: likely that of the last image; nothing if there is none.
        """
        assert self.steady is not None
        side = self._painted if side is None else side
        if side is None:
            return
        if self._painted != side or self._rest is not self.steady.rest_of(shape):
            fill(recording, self.vertices, 1, self.steady.painted(shape, side))
            self._painted, self._rest = side, self.steady.rest_of(shape)
        known, self._normals = self._normals, None
        if known is not None and known[0] is shape and known[1:] == (turned, side):
            self._normals = known
            return
        if shape.smooth_known:
            words = np.full((len(shape.points), 4), side, np.float32)
            words[:, :3] = -shape.smooth[0].T if turned else shape.smooth[0].T
            fill(recording, self.vertices, 2, words.view(np.uint32))
        else:
            if self._pass is None:
                count = len(self.steady.paint)
                self._pass = NormalsPass(self.device, self.steady.around, count)
            self._pass.record(
                recording, self.points(shape), self.corners(turned), self.vertices, counts, size,
                shape.smooth_angle, side,
            )  # fmt: skip
        self._normals = shape, turned, side

    def distrust(self) -> None:
        """Its views aren't what they are taken for; memory goes back."""
        self.trusted, self.steady, self._pass = False, None, None
        self._points = self._vertices = self._painted = self._rest = self._normals = None
        self._corners.clear()
