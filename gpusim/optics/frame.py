"""A rendered frame: linear radiance (on the device until somebody asks) and its ground truth."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Long, Single
from gpusim.display import notebook_html, notebook_png, plotted
from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device
from gpusim.optics.geometry.view import View
from gpusim.optics.truth import Truth, TruthMap, truth_of
from gpusim.optics.visibility_buffer import VisibilityBuffer, visibility_twin

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class Band:
    """Rows ``row0 … row0 + rows - 1`` of a frame in device buffers, ``stride`` float32 a row: one
    buffer for each of the frame's planes."""

    row0: int
    rows: int
    stride: int
    planes: tuple[Buffer, ...]

    @staticmethod
    def of(device: Device, row0: int, rows: int, stride: int, planes: int = 1) -> Band:
        """With new buffers."""
        size, label = 4 * rows * stride, f"radiance[{row0}]"
        return Band(row0, rows, stride, tuple(device.empty(size, label) for _ in range(planes)))

    @property
    def buffer(self) -> Buffer:
        """That of the only plane."""
        (result,) = self.planes
        return result

    def read(self) -> Single:
        """(rows, stride) float32."""
        return self.buffer.read(np.float32, (self.rows, self.stride))


class Frame:
    """What a camera sees, before the sensor.

    ``radiance`` is (H, W) float32, linear, in W per square unit and steradian (or albedo where the
    scene has no lights); (H, W, 3) of red, green and blue where something in it has a colour.
    ``device`` is None when it was made by the NumPy twin. ``planes``: the frame itself where all is
    grey, else a grey frame for each of red, green and blue: what lens and sensor do, they do to
    each of them.

    Examples
    --------
    >>> wall = gs.Surface([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], [[0, 1, 2, 3]])
    >>> camera = gs.Camera.from_lens((36, 24), 50, (6, 4), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    >>> frame = gs.render([wall], camera, backend="numpy")
    >>> frame.radiance.shape, frame.radiance.dtype.name, int(frame.ids().max())
    ((4, 6), 'float32', 2)
    """

    def __init__(
        self,
        view: View,
        device: Device | None,
        bands: tuple[Band, ...] = (),
        radiance: Single | None = None,
    ) -> None:
        self.view, self.device, self.bands = view, device, bands
        self._planes: tuple[Frame, ...] = ()
        self._radiance = radiance
        self.facts: dict[str, str] = {}
        """What lens and shutter did, in words (`gpusim.optics.photograph`)."""
        self.warnings: tuple[str, ...] = ()
        """Where they did less than the error asks for, and what in the scene looks wrong."""
        self._ids: npt.NDArray[np.uint32] | None = None

    @staticmethod
    def of_bands(view: View, device: Device, bands: Sequence[Band]) -> Frame:
        """With all planes of ``bands``."""
        return Frame.of_planes([
            Frame(view, device, tuple(replace(band, planes=(band.planes[k],)) for band in bands))
            for k in range(len(bands[0].planes))
        ])  # fmt: skip

    @staticmethod
    def of_planes(planes: Sequence[Frame]) -> Frame:
        """One frame of one grey plane, or of three of the same view."""
        if len(planes) == 1:
            return planes[0]
        result = Frame(planes[0].view, planes[0].device)
        result._planes = tuple(planes)
        return result

    def __repr__(self) -> str:
        where = "host" if self.device is None else "device"
        size = f"{self.width} x {self.height} px" + (", in colour" if self.coloured else "")
        return f"Frame({size}, camera {self.view.camera.name!r}, {where})"

    def _repr_html_(self) -> str | None:
        return notebook_html("frame", self)

    def _repr_png_(self) -> bytes | None:
        return notebook_png("frame", self)

    def plot(self, ax: Axes | None = None, **style: Any) -> Axes:
        """Draw the radiance in matplotlib's axes, in px, with its scale where it is grey.

        ``style`` goes to ``Axes.imshow``. Returns the axes, new ones unless given. Raises
        InputError for a released frame.
        """
        return plotted("frame", self, ax, **style)

    @property
    def planes(self) -> tuple[Frame, ...]:
        """Its grey planes."""
        # not kept: an object that holds itself waits for the garbage collector with all it has
        return self._planes or (self,)

    @property
    def coloured(self) -> bool:
        """Whether it has planes of red, green and blue."""
        return bool(self._planes)

    @property
    def released(self) -> bool:
        """Whether its picture is gone: given back before anybody read it."""
        return any(not plane.bands and plane._radiance is None for plane in self.planes)

    @property
    def width(self) -> int:
        """Columns."""
        return self.view.camera.width

    @property
    def height(self) -> int:
        """Rows."""
        return self.view.camera.height

    @property
    def radiance(self) -> Single:
        """(H, W) or (H, W, 3) float32 radiance; read back from the device at the first call."""
        if self._radiance is None and self.coloured:
            self._radiance = np.stack([plane.radiance for plane in self.planes], axis=2)
        if self._radiance is None:
            if not self.bands:
                raise InputError("frame radiance; got a released frame; read it before release()")
            result = np.empty((self.height, self.width), np.float32)
            for band in self.bands:
                result[band.row0 : band.row0 + band.rows] = band.read()[:, : self.width]
            self._radiance = result
        return self._radiance

    def brightest(self) -> float:
        """The largest radiance; the picture isn't kept for it."""
        if self.coloured:
            return max(plane.brightest() for plane in self.planes)
        if self._radiance is not None or not self.bands:
            return float(self.radiance.max())
        return max(float(band.read()[:, : self.width].max()) for band in self.bands)

    def ids(self) -> npt.NDArray[np.uint32]:
        """(H, W) uint32: number + 1 of the triangle under each pixel's centre, 0 for none."""
        if self._ids is None:
            if self.device is None:
                self._ids = visibility_twin(self.view)
            else:
                rows = max((band.rows for band in self.bands), default=min(self.height, 1024))
                self._ids = VisibilityBuffer.of(self.device, self.view, rows).read()
        return self._ids

    def truth(self, faces: tuple[int, int] | None = None) -> Truth:
        """Ground truth at every pixel centre that sees a surface, in float64.

        ``faces`` (first, stop) keeps only pixels that see these faces (counted over all surfaces
        in order).
        """
        return truth_of(self.view, self.ids(), faces)

    def truth_bands(self, faces: tuple[int, int] | None = None) -> Iterator[Truth]:
        """The same a band of 256 rows at a time, for images that are too large to hold it all."""
        return TruthMap(self.view, self.ids(), faces).bands()

    def release(self) -> None:
        """Give the device memory back; radiance already read stays."""
        for plane in self.planes if self.coloured else ():
            plane.release()
        if self.device is not None:
            for band in self.bands:
                band.buffer.release()
        self.bands = ()


def scatter(
    device: Device,
    places: Long,
    values: Single,
    target: Buffer,
) -> None:
    """Write ``values`` (n,) to the words ``places`` (n,) of ``target``, all different."""
    if not len(places):
        return
    entries = np.stack([places.astype(np.uint32), values.view(np.uint32)], axis=1)
    kernel = device.kernel("optics/edge_pixels/scatter")
    bindings = kernel.bind(
        params={"count": len(places)},
        entries=device.buffer(entries, "scatter.entries"),
        radiance=target,
    )
    with device.recording("optics.scatter") as recording:
        recording.dispatch(kernel, bindings, threads=(len(places),))


def write_pixels(
    device: Device,
    bands: Sequence[Band],
    width: int,
    pixel: Long,
    value: Single,
) -> None:
    """Write ``value`` (planes, n) to the pixels of linear indices ``pixel`` (n,) in an image's
    bands."""
    row, column = np.divmod(pixel, width)
    for band in bands:
        own = np.flatnonzero((row >= band.row0) & (row < band.row0 + band.rows))
        places = (row[own] - band.row0) * band.stride + column[own]
        for plane, values in zip(band.planes, value, strict=True):
            scatter(device, places, values[own], plane)


def scatter_twin(
    there: Single,
    places: Long,
    values: Single,
) -> Single:
    """A copy of ``there`` with the values in it."""
    result = there.copy()
    result.reshape(-1)[places] = values
    return result
