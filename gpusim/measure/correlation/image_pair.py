"""A pair of images to be matched, on the host and in parts on a device.

Subsets are handled in groups whose reference and deformed pixels fit into two textures, so that
images may be of any size; a small pair is one group. Boxes are (x0, y0, x1, y1) in whole pixels,
ends excluded: of the reference crop's pixels, and of the deformed crop's padded coefficients.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import wgpu
from numpy.lib.stride_tricks import sliding_window_view

from gpusim.arrays.array_types import Bool, Float, Long, Single
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure.images import SplineImage
from gpusim.parallel.threads import shared
from gpusim.validation import require

Box = tuple[int, int, int, int]

FORMATS = {1: "r32float", 4: "rgba32float"}
SNAP = 256  # px: deformed boxes end on multiples, so that later calls find them uploaded
BAND = 128  # lines of planes that a thread fills at once
KEEP_PLANES = 1 << 22  # pixels of a reference crop: 134 MB of planes


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

    def __init__(self, device: Device, values: Single, label: str) -> None:
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

    which: Long
    reference: Box
    deformed: Box


def plan_tiles(
    reference: SplineImage,
    deformed: SplineImage,
    centre: Long,
    begin: Long,
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
    members: Long, begin: Long, size: tuple[int, int], reach: int, most: int
) -> Iterator[tuple[Long, Box]]:
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
        lower = places[:, axis] <= (low[axis] + high[axis]) // 2
        for half in (members[lower], members[~lower]):
            yield from _by_target(half, begin, size, reach, most)
        return
    last = np.minimum(last, first + most)
    yield members, (int(first[0]), int(first[1]), int(last[0]), int(last[1]))


@dataclass(frozen=True)
class Pair:
    """Two images to be matched. What matching needs of them is prepared once per pair.

    reference, deformed : splines that cover every subset.
    mask : (H, W) bool of the whole reference image, True = may be used; or None.
    sparse : subsets fill a small part of the reference crop.
    """

    reference: SplineImage
    deformed: SplineImage
    mask: Bool | None = None
    sparse: bool = False

    @cached_property
    def planes(self) -> Float:
        """Reference grey value, its slopes by x and y, and the mask: (h, w, 4), grey range 1."""
        height, width = self.reference.pixels.shape
        result = np.empty((height, width, 4))
        bands = [(y, min(y + BAND, height)) for y in range(0, height, BAND)]
        shared(
            lambda band: self.fill_planes((0, band[0], width, band[1]), result[slice(*band)]), bands
        )
        return result

    def planes_at(self, x: Long, y: Long, size: int) -> Float:
        """The planes of subsets with first pixels ``x``, ``y`` (B,): (B, size * size, 4).

        Those of the whole crop are kept only where that is small.
        """
        fits = size <= min(self.reference.pixels.shape)
        if fits and not self.sparse and self.reference.pixels.size <= KEEP_PLANES:
            windows = sliding_window_view(self.planes, (size, size), axis=(0, 1))
            return windows[y, x].transpose(0, 2, 3, 1).reshape(x.size, size * size, 4)
        subsets = np.zeros((x.size, size, size, 4))
        if fits:
            for i, (left, top) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
                self.fill_planes((left, top, left + size, top + size), subsets[i])
        return subsets.reshape(x.size, size * size, 4)

    def part(self, box: Box) -> Single:
        """The planes of a part of the reference crop, for a device; ``box`` as in
        ``image_tiles``."""
        x0, y0, x1, y1 = box
        size = self.reference.pixels.size
        if size <= KEEP_PLANES and 2 * (x1 - x0) * (y1 - y0) > size:
            return self.planes[y0:y1, x0:x1].astype(np.float32)  # the host will ask for them, too
        planes = np.empty((y1 - y0, x1 - x0, 4), dtype=np.float32)
        self.fill_planes(box, planes)
        return planes

    def fill_planes(self, box: Box, planes: Float | Single) -> None:
        """Write the planes of a part of the reference crop; ``box`` as in ``image_tiles``."""
        spline = self.reference
        x0, y0, x1, y1 = box
        low, scale = self.reference_range
        planes[:, :, 0] = (spline.pixels[y0:y1, x0:x1] - low) * scale
        by_x, by_y = spline.pixel_gradients(box)
        planes[:, :, 1] = by_x * scale
        planes[:, :, 2] = by_y * scale
        planes[:, :, 3] = 1.0
        if self.mask is not None:
            x, y = spline.origin
            planes[:, :, 3] = self.mask[y + y0 : y + y1, x + x0 : x + x1]

    @cached_property
    def reference_range(self) -> tuple[float, float]:
        """``grey_range`` of the reference crop."""
        return grey_range(self.reference)

    @cached_property
    def deformed_range(self) -> tuple[float, float]:
        """``grey_range`` of the deformed crop."""
        return grey_range(self.deformed)

    @cached_property
    def _textures(self) -> OrderedDict[tuple[Device, str, Box], Sampled]:
        return OrderedDict()

    def texture(self, device: Device, name: str, box: Box, limits: Limits) -> Sampled:
        """Parts of the "reference" (`part`) or the "deformed" image (`packed_coefficients`) on a
        device. They are kept; the least recently used ones go first."""
        kept, key = self._textures, (device, name, box)
        if key not in kept:
            values = self.part(box) if name == "reference" else self.packed_coefficients(box)
            sampled = Sampled(device, values, f"measure.icgn.{name}")
            while kept and sum(s.nbytes for s in kept.values()) > limits.cached - sampled.nbytes:
                kept.popitem(last=False)
            kept[key] = sampled
        kept.move_to_end(key)
        return kept[key]

    def packed_coefficients(self, box: Box) -> Single:
        """Spline coefficients of a part; a texel holds those of 2x2 pixels, row by row."""
        x0, y0, x1, y1 = box
        low, scale = self.deformed_range
        part = (self.deformed.coefficients[y0:y1, x0:x1] - low) * scale
        packed = np.zeros((*part.shape, 4), dtype=np.float32)
        packed[:, :, 0] = part
        packed[:, :-1, 1] = part[:, 1:]
        packed[:-1, :, 2] = part[1:]
        packed[:-1, :-1, 3] = part[1:, 1:]
        return packed


def grey_range(spline: SplineImage) -> tuple[float, float]:
    """Lowest grey value and 1 / range of a crop; the second is 0 for a flat image."""
    low = float(spline.pixels.min())
    span = float(spline.pixels.max()) - low
    return low, 1.0 / span if span > 0 else 0.0


@dataclass(frozen=True)
class Subsets:
    """Reference subsets to be found in a deformed image.

    pair : the two images.
    points : (M, 2) float64, x, y in the reference image.
    start : (M, 2, 6) float64, warp coefficients to start from, px.
    """

    pair: Pair
    points: Float
    start: Float

    def __post_init__(self) -> None:
        count = len(self.points)
        fits = self.points.shape == (count, 2) and self.start.shape == (count, 2, 6)
        got = f"points {self.points.shape}, start {self.start.shape}"
        require(fits, "subsets: shapes don't match", got, "(M, 2) and (M, 2, 6)")
        if not (np.isfinite(self.points).all() and np.isfinite(self.start).all()):
            raise InputError("subsets: got NaN or infinite points or start values; expected finite")


def subset_pixels(points: Float, half: int) -> tuple[Long, Long]:
    """Columns and rows (M, n) of the pixels of subsets at ``points`` (M, 2), row by row."""
    offset = np.arange(-half, half + 1)
    column = np.rint(points[:, :1]).astype(np.int64) + np.tile(offset, offset.size)
    return column, np.rint(points[:, 1:]).astype(np.int64) + np.repeat(offset, offset.size)
