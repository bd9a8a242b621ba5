"""What every measurement accepts as an image, and how it reads it between the pixels.

The quintic B-spline passes through every pixel value. Its coefficients come from a recursive filter
(Unser, Aldroubi, Eden 1993), whose poles are -0.431 and -0.043: what happens at the border of a
crop fades as 0.431^distance, so a crop with a margin of 32 pixels interpolates like the whole image
(2e-12 of the grey range).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.arrays.grey import grey_of
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.validation import require, unmasked

Image = npt.NDArray[Any]
MARGIN = 32  # pixels around a crop, so that its border isn't felt
BLUR_REACH = 5.0  # standard deviations
BORDER = 16  # pixels by which the image is continued beyond its border
PAD = 3  # coefficients kept around the crop: six taps reach from floor(x)-2 to floor(x)+3
SLACK = 0.1  # px; a tenth of a pixel beyond the last centre is still in that pixel
CHUNK = 1 << 16  # samples per pass: keeps the temporaries in the cache

# rows: taps -2..3; columns: powers of the fraction t in [0, 1)
WEIGHTS = (
    np.array(
        [
            [1, -5, 10, -10, 5, -1],
            [26, -50, 20, 20, -20, 5],
            [66, 0, -60, 0, 30, -10],
            [26, 50, 20, -20, -20, 10],
            [1, 5, 10, 10, 5, -5],
            [0, 0, 0, 0, 0, 1],
        ],
        dtype=np.float64,
    )
    / 120.0
)


def pixels_of(image: object) -> Image:
    """``image`` as a plain array: masked pixels of a `numpy.ma.MaskedArray` become NaN."""
    if isinstance(image, np.ma.MaskedArray) and np.ma.is_masked(image):
        kind = image.dtype if image.dtype.kind == "f" else np.float64
        return np.where(np.ma.getmaskarray(image), np.nan, np.ma.getdata(image)).astype(kind)
    return np.asarray(image)


def check_image(image: object, name: str) -> Image:
    """Return ``image`` as a grey array (H, W) after checking that it is one picture.

    Any unsigned, signed or floating-point type and any bit depth, grey or (H, W, 3) in colour, of
    which the luminance is taken (`gpusim.arrays.grey`).
    """
    array = grey_of(pixels_of(image))
    expected = "(H, W), or (H, W, 3) in colour"
    require(array.ndim == 2, f"{name}: not one image", f"shape {array.shape}", expected)
    expected = "an integer or float type"
    require(array.dtype.kind in "uif", f"{name}: wrong pixel type", array.dtype, expected)
    require(min(array.shape) >= 7, f"{name}: too small", f"shape {array.shape}", "at least (7, 7)")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        count = int(array.size - np.count_nonzero(np.isfinite(array)))
        raise InputError(f"{name}: {count} pixels are NaN or infinite; expected finite values")
    return array


def check_points(points: object, name: str) -> Float:
    """Return ``points`` as (M, 2) float64 pixel positions (x = column, y = row), all finite."""
    array = np.asarray(points, dtype=np.float64)
    fits = array.ndim == 2 and array.shape[1] == 2 and array.shape[0] > 0
    require(fits, f"{name}: wrong shape", array.shape, "(M, 2) with at least one point")
    if not np.isfinite(array).all():
        raise InputError(f"{name}: got NaN or infinite positions; expected finite x, y in pixels")
    return array.copy()


def point_spacing(points: Float) -> float:
    """Median distance of points (M, 2), at least two, from the nearest other one."""
    apart = np.asarray(scipy.spatial.cKDTree(points).query(points, k=2)[0], dtype=np.float64)
    return float(np.median(apart[:, 1]))


def crop_float(
    image: Image, box: tuple[float, float, float, float], margin: int
) -> tuple[Float, tuple[int, int]]:
    """Cut ``box`` = (x0, y0, x1, y1) plus ``margin`` out of ``image`` as float64.

    Returns the crop and the integer position (x, y) of its first pixel. The box is clipped to the
    image and keeps at least 7x7 pixels, so that it can always be filtered.
    """
    height, width = image.shape
    low_x, high_x = _span(box[0], box[2], margin, width)
    low_y, high_y = _span(box[1], box[3], margin, height)
    crop = np.ascontiguousarray(image[low_y : high_y + 1, low_x : high_x + 1], dtype=np.float64)
    return crop, (low_x, low_y)


def _span(low: float, high: float, margin: int, size: int) -> tuple[int, int]:
    first = int(np.clip(np.floor(low) - margin, 0, size - 7))
    last = int(np.clip(np.ceil(high) + margin, first + 6, size - 1))
    return first, last


def eight_bit(array: Image) -> npt.NDArray[np.uint8]:
    """The picture for the detectors: 0 to 255 from its darkest to its brightest thousandth."""
    if array.dtype == np.uint8:
        result: npt.NDArray[np.uint8] = np.ascontiguousarray(array)
        return result
    sample = array[:: max(1, array.shape[0] // 500), :: max(1, array.shape[1] // 500)]
    low, high = np.quantile(sample, [0.001, 0.999])
    scaled = (array.astype(np.float32) - low) * (255.0 / max(high - low, 1e-30))
    return np.asarray(np.clip(scaled, 0, 255), dtype=np.uint8)


def quintic_weights(t: Float) -> Float:
    """The six tap weights (6, ...) at the fractions ``t`` in [0, 1); they sum to 1."""
    result = np.empty((len(WEIGHTS), *t.shape))
    for row, coefficients in zip(result, WEIGHTS, strict=True):
        # Horner's rule
        row[...] = coefficients[-1]
        for coefficient in coefficients[-2::-1]:
            row *= t
            if coefficient:
                row += coefficient
    return result


@unmasked()
@dataclass(frozen=True)
class SplineImage:
    """An image (or a crop of one) that can be read between its pixels.

    Positions are those of the whole image: x = column, y = row, integer = pixel centre.

    Attributes
    ----------
    pixels : (h, w) float64, the crop's own grey values (blurred if asked for).
    coefficients : (h + 6, w + 6) float64, spline coefficients with 3 more on each side.
    origin : (x, y) of the crop's first pixel in the whole image.
    valid : (x0, y0, x1, y1), the closed box in which interpolation equals that of the whole image.

    Examples
    --------
    >>> image = gs.measure.SplineImage.from_image(np.outer(np.ones(16), np.arange(16.0)))
    >>> image.values(np.array([7.25]), np.array([8.0])).round(6)
    array([7.25])
    """

    pixels: Float
    coefficients: Float
    origin: tuple[int, int]
    valid: tuple[float, float, float, float]
    __repr__ = field_summary

    @classmethod
    def from_image(
        cls,
        image: Image,
        box: tuple[float, float, float, float] | None = None,
        *,
        blur_px: float = 0.0,
    ) -> SplineImage:
        """Filter ``image``; with ``box`` = (x0, y0, x1, y1) only what that box needs.

        ``blur_px`` is the standard deviation of a Gaussian applied first. It takes away what is
        too sharp for any interpolation between pixels (black-white borders one pixel wide).
        """
        require(0.0 <= blur_px <= 20.0, "blur_px", repr(blur_px), "0..20 px")
        array = check_image(image, "image")
        height, width = array.shape
        whole = (0.0, 0.0, width - 1.0, height - 1.0)
        wanted = whole if box is None else box
        margin = MARGIN + ceil(BLUR_REACH * blur_px)
        crop, (x, y) = crop_float(array, wanted, margin)
        rows, columns = crop.shape
        # beyond the image it goes on point-reflected, in value and slope; mirrored in value only,
        # the spline would be flat at the border and pull subsets there by 0.01 px
        reach = BORDER + margin - MARGIN
        wide = np.pad(crop, reach, mode="reflect", reflect_type="odd")
        if blur_px > 0:
            wide = scipy.ndimage.gaussian_filter(wide, blur_px, mode="mirror", truncate=BLUR_REACH)
        filtered = scipy.ndimage.spline_filter(wide, order=5, output=np.float64, mode="mirror")
        pixels = np.ascontiguousarray(wide[reach:-reach, reach:-reach])
        cut = slice(reach - PAD, PAD - reach)
        valid = (
            0.0 if x == 0 else float(x + margin),
            0.0 if y == 0 else float(y + margin),
            width - 1.0 if x + columns == width else float(x + columns - 1 - margin),
            height - 1.0 if y + rows == height else float(y + rows - 1 - margin),
        )
        return cls(pixels, np.ascontiguousarray(filtered[cut, cut]), (x, y), valid)

    def inside(self, x: Float, y: Float) -> Bool:
        """Whether each position lies in the valid box or within ``SLACK`` of it (NaN doesn't).

        A subset at the border of the image may so waver by what its last digits, or noise, make.
        """
        x0, y0, x1, y1 = self.valid
        return (x >= x0 - SLACK) & (x <= x1 + SLACK) & (y >= y0 - SLACK) & (y <= y1 + SLACK)

    def values(self, x: Float, y: Float) -> Float:
        """Grey values at the positions ``x``, ``y`` (any equal shape), all inside the crop."""
        flat_x = x.ravel() - self.origin[0]
        flat_y = y.ravel() - self.origin[1]
        result = np.zeros(flat_x.size)
        width = self.coefficients.shape[1]
        table = self.coefficients.ravel()
        for start in range(0, flat_x.size, CHUNK):
            part = slice(start, start + CHUNK)
            column = np.floor(flat_x[part])
            row = np.floor(flat_y[part])
            # tap -2 of pixel 0 is padded coefficient 1
            first = (row.astype(np.int64) + PAD - 2) * width + column.astype(np.int64) + PAD - 2
            weight_x = quintic_weights(flat_x[part] - column)
            weight_y = quintic_weights(flat_y[part] - row)
            for j in range(6):
                taps = [table[first + (j * width + i)] for i in range(6)]
                line = sum(w * c for w, c in zip(weight_x, taps, strict=True))
                result[part] += weight_y[j] * line
        return result.reshape(x.shape)

    def pixel_gradients(self, box: tuple[int, int, int, int] | None = None) -> tuple[Float, Float]:
        """Derivatives by x and by y of the spline at the crop's own pixels, each (h, w).

        ``box`` = (x0, y0, x1, y1), counted from the crop's first pixel, ends excluded: only there.
        """
        height, width = self.pixels.shape
        x0, y0, x1, y1 = (0, 0, width, height) if box is None else box
        value = WEIGHTS[:5, 0]
        slope = WEIGHTS[:5, 1]
        # tap -2 of pixel 0 is padded coefficient 1
        inner = self.coefficients[y0 + 1 : y1 + 5, x0 + 1 : x1 + 5]
        by_x, by_y = (
            np.asarray(cv2.sepFilter2D(inner, cv2.CV_64F, *taps), dtype=np.float64)[2:-2, 2:-2]
            for taps in ((slope, value), (value, slope))
        )
        return by_x, by_y
