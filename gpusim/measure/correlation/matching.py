"""What goes into matching subsets and what comes out, shared by the kernel and its twin."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.measure.correlation.image_tiles import Box, Limits, Sampled, TextureCache
from gpusim.measure.correlation.warp import UNKNOWNS, Shape
from gpusim.measure.images import FloatArray
from gpusim.measure.interpolation import SplineImage

__all__ = ["Correlation", "Pair", "Settings", "Status", "Subsets", "check_subsets", "grey_range"]


IntArray = npt.NDArray[np.int64]
# sum of squares of the slope filter: spline coefficients of an impulse, read by quintic_slopes(0)
SLOPE_NOISE = 1.89396
KEEP_PLANES = 1 << 22  # pixels of a reference crop: 134 MB of planes


class Status(IntEnum):
    """What became of a point. Only ``OK`` points carry numbers; the others are NaN.

    Examples
    --------
    >>> flat = np.full((64, 64), 128, np.uint8)
    >>> result = gs.measure.dic(flat, flat, points=[[32, 32]], backend="numpy")
    >>> gs.measure.Status(result.status[0]).name
    'NO_TEXTURE'
    """

    OK = 0
    OUTSIDE = 1  # its subset leaves one of the images
    NO_TEXTURE = 2  # nothing in the subset tells the motion
    NOT_CONVERGED = 3
    LOW_CORRELATION = 4
    NO_GUESS = 5  # never reached: no start value nearby
    BACKWARD = 6  # tracking back from the deformed image doesn't return to the point
    AMBIGUOUS = 7  # another point, elsewhere before, was tracked to the same place
    MASKED = 8  # its subset is masked, or not a number, for the most part
    SATURATED = 9  # its subset lies in an area at full scale, here or where it went
    EPIPOLAR = 10  # the two cameras of a pair don't see it on matching lines
    INCOHERENT = 11  # parts of its subset move differently, or don't match: an edge, a crack


@dataclass(frozen=True)
class Settings:
    """How subsets are matched.

    window : (S, S) float64 weights in 0..1, S odd.
    tolerance : how far a pixel of the subset may still be from where it would end, px.
    max_move : a subset that leaves its start by more than this has diverged, px.
    apart_px : how far parts of a subset may move apart, px; see ``subset_consistency``.
    slope_noise : variance of the spline's slope at a pixel for white noise of variance 1.
    """

    window: FloatArray
    shape: Shape = "affine"
    tolerance: float = 1e-4
    max_iterations: int = 40
    min_zncc: float = 0.8
    max_move: float = 10.0
    apart_px: float = 0.1
    slope_noise: float = SLOPE_NOISE

    @property
    def half(self) -> int:
        """Half width of the subset: it spans 2 half + 1 pixels."""
        return int(self.window.shape[0]) // 2


@dataclass(frozen=True)
class Pair:
    """Two images to be matched. What matching needs of them is prepared once per pair.

    reference, deformed : splines that cover every subset.
    mask : (H, W) bool of the whole reference image, True = may be used; or None.
    """

    reference: SplineImage
    deformed: SplineImage
    mask: npt.NDArray[np.bool_] | None = None

    @cached_property
    def planes(self) -> FloatArray:
        """Reference grey value, its slopes by x and y, and the mask: (h, w, 4), grey range 1."""
        height, width = self.reference.pixels.shape
        result = np.empty((height, width, 4))
        self.fill_planes((0, 0, width, height), result)
        return result

    def planes_at(self, x: IntArray, y: IntArray, size: int) -> FloatArray:
        """The planes of subsets with first pixels ``x``, ``y`` (B,): (B, size * size, 4).

        Those of the whole crop are kept only where that is small.
        """
        found = np.zeros((x.size, size, size, 4))
        if size > min(self.reference.pixels.shape):
            pass  # no subset fits
        elif self.reference.pixels.size <= KEEP_PLANES:
            offset = np.arange(size)
            rows, columns = y[:, None] + offset, x[:, None] + offset
            found[...] = self.planes[rows[:, :, None], columns[:, None, :]]
        else:
            for i, (left, top) in enumerate(zip(x.tolist(), y.tolist(), strict=True)):
                self.fill_planes((left, top, left + size, top + size), found[i])
        return found.reshape(x.size, size * size, 4)

    def part(self, box: Box) -> npt.NDArray[np.float32]:
        """The planes of a part of the reference crop, for a device; ``box`` as in
        ``image_tiles``."""
        x0, y0, x1, y1 = box
        size = self.reference.pixels.size
        if size <= KEEP_PLANES and 2 * (x1 - x0) * (y1 - y0) > size:
            return self.planes[y0:y1, x0:x1].astype(np.float32)  # the host will ask for them, too
        planes = np.empty((y1 - y0, x1 - x0, 4), dtype=np.float32)
        self.fill_planes(box, planes)
        return planes

    def fill_planes(
        self, box: Box, planes: npt.NDArray[np.float64] | npt.NDArray[np.float32]
    ) -> None:
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
    def _textures(self) -> TextureCache:
        return TextureCache()

    def reference_texture(self, device: Device, box: Box, limits: Limits) -> Sampled:
        """Grey value, slopes by x and y, mask."""
        return self._textures.get(device, "reference", box, limits, self.part)

    def deformed_texture(self, device: Device, box: Box, limits: Limits) -> Sampled:
        """Spline coefficients; a texel holds those of 2x2 pixels, row by row."""
        return self._textures.get(device, "deformed", box, limits, self._packed_coefficients)

    def _packed_coefficients(self, box: Box) -> npt.NDArray[np.float32]:
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
    points: FloatArray
    start: FloatArray


@dataclass(frozen=True)
class Correlation:
    """Matches of M subsets, raw: coefficients of failed ones are NaN.

    coefficients : (M, 2, 6) float64, px (see ``warp``).
    zncc : (M,) float64, correlation coefficient, NaN where it was never computed.
    sigma : (M,) float64, standard uncertainty of the worse displacement component, px.
    iterations : (M,) int32.      status : (M,) int8, values of ``Status``.
    """

    coefficients: FloatArray
    zncc: FloatArray
    sigma: FloatArray
    iterations: npt.NDArray[np.int32]
    status: npt.NDArray[np.int8]


def check_subsets(subsets: Subsets, settings: Settings) -> None:
    """Refuse inputs that no kernel should see."""
    count = subsets.points.shape[0]
    if subsets.points.shape != (count, 2) or subsets.start.shape != (count, 2, 6):
        raise InputError(
            f"subsets: shapes don't match; got points {subsets.points.shape}, start "
            f"{subsets.start.shape}; expected (M, 2) and (M, 2, 6)"
        )
    if not (np.isfinite(subsets.points).all() and np.isfinite(subsets.start).all()):
        raise InputError("subsets: got NaN or infinite points or start values; expected finite")
    window = settings.window
    size = window.shape[0]
    if window.ndim != 2 or window.shape != (size, size) or size % 2 == 0 or size < 5:
        raise InputError(
            f"window: wrong shape; got {window.shape}; expected (S, S), S odd, at least 5"
        )
    if not (np.isfinite(window).all() and window.min() >= 0 and 0 < window.max() <= 1):
        raise InputError("window: weights out of range; expected 0..1, not all 0")
    if window.sum() <= UNKNOWNS[settings.shape] + 2:
        raise InputError("window: too few pixels with weight for the unknowns of the shape")
    if not 0 < settings.tolerance < 1 or settings.max_iterations < 1:
        raise InputError("settings: expected 0 < tolerance < 1 px and at least one iteration")
