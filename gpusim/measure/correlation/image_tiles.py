"""Parts of a pair of images on a device: any image size, within what a device takes.

Subsets are handled in groups whose reference and deformed pixels fit into two textures. A small
pair is one group. Boxes are (x0, y0, x1, y1) in whole pixels, ends excluded: of the reference
crop's pixels, and of the deformed crop's padded coefficients.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import wgpu

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure.interpolation import SplineImage

__all__ = ["Box", "Limits", "Sampled", "TextureCache", "Tile", "plan_tiles"]

Box = tuple[int, int, int, int]
IntArray = npt.NDArray[np.int64]

FORMATS = {1: "r32float", 4: "rgba32float"}
SNAP = 256  # px: deformed boxes end on multiples, so that later calls find them uploaded


@dataclass(frozen=True)
class Limits:
    """What one tile may hold.

    side : px, longest side of a texture.    pixels : area of a texture.
    cached : bytes of textures that a pair keeps on the device.
    """

    side: int = 8191
    pixels: int = 1 << 23
    cached: int = 1 << 29


class Sampled:
    """A float32 picture (h, w) or (h, w, 4) in a texture that kernels load from, as a storage
    texture (see `gpusim.gpu.texture_array`)."""

    def __init__(self, device: Device, values: npt.NDArray[np.float32], label: str) -> None:
        height, width = values.shape[:2]
        limit = device.limits["max-texture-dimension-2d"]
        if values.dtype != np.float32 or not (0 < width <= limit and 0 < height <= limit):
            raise InputError(
                f"{label}: got {values.dtype} {values.shape}; expected float32, 1 to {limit} a side"
            )
        channels = 1 if values.ndim == 2 else values.shape[2]
        data = np.ascontiguousarray(values)
        # llvmpipe compiles a kernel anew for textures whose sides are powers of two: have none
        sides = tuple(n + 1 if n & (n - 1) == 0 and n < limit else n for n in (width, height))
        self.nbytes = 4 * channels * sides[0] * sides[1]
        usage = wgpu.TextureUsage
        device.require_memory(self.nbytes, f"texture {label}")
        with device.guard(f"texture {label} ({width}x{height})"):
            self.gpu = device.gpu.create_texture(
                label=f"gpusim.{label}",
                size=(*sides, 1),
                format=FORMATS[channels],
                usage=usage.TEXTURE_BINDING | usage.STORAGE_BINDING | usage.COPY_DST,
            )
            self.view = self.gpu.create_view()
            device.gpu.queue.write_texture(
                {"texture": self.gpu},
                data,
                {"bytes_per_row": 4 * channels * width, "rows_per_image": height},
                (width, height, 1),
            )
        device.account(self.gpu, self.nbytes)


@dataclass(frozen=True)
class Tile:
    """Subsets ``which`` (K,) with the parts of the two crops that they need."""

    which: IntArray
    reference: Box
    deformed: Box


def plan_tiles(
    reference: SplineImage,
    deformed: SplineImage,
    centre: IntArray,
    begin: IntArray,
    half: int,
    reach: int,
    limits: Limits,
) -> Iterator[Tile]:
    """Group M subsets into tiles.

    Parameters
    ----------
    reference, deformed : the crops of both images.
    centre : (M, 2) centre pixels in the reference crop; the subsets lie inside it.
    begin : (M, 2) the coefficients of the deformed crop at which they start; may lie outside.
    half : half width of the subsets.
    reach : how far from ``begin`` coefficients are needed; what goes further finds no tile.
    """
    height, width = reference.pixels.shape
    rows, columns = deformed.coefficients.shape
    everything = np.arange(len(centre))
    fits = max(height, width, rows, columns) <= limits.side
    if fits and max(height * width, rows * columns) <= limits.pixels:
        yield Tile(everything, (0, 0, width, height), (0, 0, columns, rows))
        return
    most = min(limits.side, int(np.sqrt(limits.pixels)))
    cell = max(most - 2 * half, 1)
    cells = centre // cell
    _, group = np.unique(cells, axis=0, return_inverse=True)
    for number in range(int(group.max()) + 1):
        members = np.flatnonzero(group.ravel() == number)
        x, y = (int(k) * cell for k in cells[members[0]])
        pixels = (
            max(x - half, 0),
            max(y - half, 0),
            min(x + cell + half, width),
            min(y + cell + half, height),
        )
        for part, coefficients in _by_target(members, begin, (columns, rows), reach, most):
            yield Tile(part, pixels, coefficients)


def _by_target(
    members: IntArray, begin: IntArray, size: tuple[int, int], reach: int, most: int
) -> Iterator[tuple[IntArray, Box]]:
    """Halve a group until the coefficients that it needs fit into ``most`` x ``most``."""
    places = np.clip(begin[members], 0, np.array(size) - 1)
    low, high = places.min(axis=0), places.max(axis=0)
    snap = max(1, min(SNAP, most // 8))
    first = np.maximum((low - reach) // snap * snap, 0)
    last = np.minimum(-(-(high + reach + 1) // snap) * snap, size)
    if members.size == 1:
        first = np.maximum(first, places[0] - most // 2)
        last = np.minimum(last, first + most)
    elif (last - first > most).any() and (high > low).any():
        axis = int(np.argmax(high - low))
        left = places[:, axis] <= (low[axis] + high[axis]) // 2
        for half in (members[left], members[~left]):
            yield from _by_target(half, begin, size, reach, most)
        return
    last = np.minimum(last, first + most)
    yield members, (int(first[0]), int(first[1]), int(last[0]), int(last[1]))


class TextureCache:
    """Textures of one pair, made when first asked for; the least recently used ones go first."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[Device, str, Box], Sampled] = OrderedDict()

    def get(
        self,
        device: Device,
        name: str,
        box: Box,
        limits: Limits,
        make: Callable[[Box], npt.NDArray[np.float32]],
    ) -> Sampled:
        """The texture of a box, of what ``make`` makes of it unless it is there."""
        key = (device, name, box)
        if key in self._kept:
            self._kept.move_to_end(key)
            return self._kept[key]
        found = Sampled(device, make(box), f"measure.icgn.{name}")
        while self._kept and sum(s.nbytes for s in self._kept.values()) > (
            limits.cached - found.nbytes
        ):
            self._kept.popitem(last=False)
        self._kept[key] = found
        return found
