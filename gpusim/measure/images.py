"""What every measurement accepts as an image, and the checks at the border."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.errors import InputError

__all__ = ["check_image", "check_points", "crop_float", "eight_bit", "pixels_of", "point_spacing"]

Image = npt.NDArray[Any]
FloatArray = npt.NDArray[np.float64]


def pixels_of(image: object) -> Image:
    """``image`` as a plain array: masked pixels of a `numpy.ma.MaskedArray` become NaN."""
    if isinstance(image, np.ma.MaskedArray) and np.ma.is_masked(image):
        kind = image.dtype if image.dtype.kind == "f" else np.float64
        return np.where(np.ma.getmaskarray(image), np.nan, np.ma.getdata(image)).astype(kind)
    return np.asarray(image)


def check_image(image: object, name: str) -> Image:
    """Return ``image`` as an array after checking that it is one grey (H, W) picture.

    Any unsigned, signed or floating-point type and any bit depth; colour is refused, because a
    mix of channels is a choice that belongs to the caller.
    """
    array = pixels_of(image)
    if array.ndim != 2:
        raise InputError(f"{name}: not one grey image; got shape {array.shape}; expected (H, W)")
    if array.dtype.kind not in "uif":
        raise InputError(
            f"{name}: wrong pixel type; got {array.dtype}; expected an integer or float type"
        )
    if min(array.shape) < 7:
        raise InputError(f"{name}: too small; got shape {array.shape}; expected at least (7, 7)")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        count = int(array.size - np.count_nonzero(np.isfinite(array)))
        raise InputError(f"{name}: {count} pixels are NaN or infinite; expected finite values")
    return array


def check_points(points: object, name: str) -> FloatArray:
    """Return ``points`` as (M, 2) float64 pixel positions (x = column, y = row), all finite."""
    array = np.asarray(points, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2 or array.shape[0] == 0:
        raise InputError(
            f"{name}: wrong shape; got {array.shape}; expected (M, 2) with at least one point"
        )
    if not np.isfinite(array).all():
        raise InputError(f"{name}: got NaN or infinite positions; expected finite x, y in pixels")
    return array.copy()


def point_spacing(points: FloatArray) -> float:
    """Median distance of points (M, 2), at least two, from the nearest other one."""
    apart = np.asarray(scipy.spatial.cKDTree(points).query(points, k=2)[0], dtype=np.float64)
    return float(np.median(apart[:, 1]))


def crop_float(
    image: Image, box: tuple[float, float, float, float], margin: int
) -> tuple[FloatArray, tuple[int, int]]:
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


def eight_bit(array: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """The picture for the detectors: 0 to 255 from its darkest to its brightest thousandth."""
    if array.dtype == np.uint8:
        result: npt.NDArray[np.uint8] = np.ascontiguousarray(array)
        return result
    sample = array[:: max(1, array.shape[0] // 500), :: max(1, array.shape[1] // 500)]
    low, high = np.quantile(sample, [0.001, 0.999])
    scaled = (array.astype(np.float32) - low) * (255.0 / max(high - low, 1e-30))
    return np.asarray(np.clip(scaled, 0, 255), dtype=np.uint8)
