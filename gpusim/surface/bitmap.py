"""A bitmap as paint: a photographed or computed pattern whose pixels are lengths on the surface.

It is a smooth surface of quintic B-splines, with coarser levels of area means. Level 0 passes
through the pixel values at the pixels' centres. Level L has cells of 2^L x 2^L pixels; its spline
has the exact mean of the level-0 surface over every cell (a histospline), so that integrating it
over whole cells loses nothing. Beyond its border the bitmap is mirrored about the outer sides of
its pixels, for which the discrete cosine transform inverts the B-spline filters exactly (Unser,
"Splines: a perfect fit for signal and image processing", 1999).
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.arrays.srgb import decoded
from gpusim.errors import InputError
from gpusim.files.input_file import InputFile
from gpusim.files.picture_file import read_picture
from gpusim.surface.color import BANDS, Albedo, grey
from gpusim.surface.features import PATCH, Features, Length, Pattern, Place
from gpusim.validation import checked, one_of, require

MARGIN = 8
"""Coefficients that every level has beyond each of its four sides."""

# the quintic B-spline at 0, 1, 2, and the one of degree six (the mean of the quintic over a cell)
AT_CENTRES = (66 / 120, 26 / 120, 1 / 120)
OVER_CELLS = (23548 / 46080, 10543 / 46080, 722 / 46080, 1 / 46080)
# the mean of the quintic over two cells, seen from their common border: at 1/2, 3/2, 5/2, 7/2
OVER_PAIRS = (34091 / 92160, 11265 / 92160, 723 / 92160, 1 / 92160)
WIDEST = 16384
LUMA = (0.299, 0.587, 0.114)
"""Of red, green and blue (ITU-R BT.601)."""


@dataclass(frozen=True, eq=False)
class Level:
    """A surface of rows x columns cells; ``coefficients`` reach MARGIN beyond each of its sides."""

    rows: int
    columns: int
    coefficients: Float


def pyramid(values: Float) -> tuple[Level, ...]:
    """Levels of a bitmap (H, W), down to a single cell."""
    rows, columns = values.shape
    coefficients = _solve(values, AT_CENTRES)
    levels = [_level(coefficients)]
    means = _means_over_pairs(coefficients)
    while max(rows, columns) > 1:
        rows, columns = -(-rows // 2), -(-columns // 2)
        levels.append(_level(_solve(means, OVER_CELLS)))
        even = np.pad(means, [(0, n % 2) for n in means.shape], mode="symmetric")
        means = 0.25 * (even[::2, ::2] + even[1::2, ::2] + even[::2, 1::2] + even[1::2, 1::2])
    return tuple(levels)


def _level(coefficients: Float) -> Level:
    rows, columns = coefficients.shape
    # "symmetric" goes on mirroring where the bitmap is smaller than the margin
    return Level(rows, columns, np.pad(coefficients, MARGIN, mode="symmetric"))


def _solve(values: Float, taps: tuple[float, ...]) -> Float:
    """Coefficients whose symmetric filter with ``taps`` along both axes gives ``values``."""
    from scipy import fft  # not without a bitmap

    spectrum = fft.dctn(values, type=2)
    for axis, n in enumerate(values.shape):
        angle = np.pi * np.arange(n) / n
        response = taps[0] + 2.0 * sum(w * np.cos(k * angle) for k, w in enumerate(taps) if k)
        spectrum /= response[:, None] if axis == 0 else response
    result: Float = fft.idctn(spectrum, type=2)
    return result


def _means_over_pairs(coefficients: Float) -> Float:
    """Means of the level-0 surface over 2 x 2 pixels; the last cell of an odd side is mirrored."""
    for axis in (0, 1):
        n = coefficients.shape[axis]
        pad = [(0, 0), (0, 0)]
        pad[axis] = (4, 4 + n % 2)
        wide = np.moveaxis(np.pad(coefficients, pad, mode="symmetric"), axis, 0)
        cells = -(-n // 2)
        total = np.zeros((cells, *wide.shape[1:]))
        for k, weight in enumerate(OVER_PAIRS):
            left, right = wide[4 - k :: 2][:cells], wide[5 + k :: 2][:cells]
            total += weight * (left + right)
        coefficients = np.moveaxis(total, 0, axis)
    return coefficients


def _full_scale(pixels: npt.NDArray[Any]) -> float:
    return 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)


@checked
@dataclass(frozen=True, eq=False, repr=False)
class Image(Pattern):
    """A bitmap whose pixels (texels) are squares of side ``texel`` on the surface.

    What is seen is the quintic B-spline through the texels' values at their centres; the renderer
    integrates it over each pixel. Beside edges of hard contrast such a surface swings over, by up
    to half of the step; what a pixel gets stays within 0 and 1.

    Parameters
    ----------
    pixels : (H, W) of any integer or float type, or (H, W, 3) of red, green and blue (which are
        grey where all three are equal); the first row is the upper one (largest t).
    texel : side of a texel, a length.
    origin : s, t of the bitmap's lower left corner (the outer corner of the texel there).
    dark, light : albedo of the values 0 and full scale: the largest number of an integer type, or
        1 for floats.
    ground : albedo beyond the bitmap.
    gamma : "linear", or "srgb" for files whose values are to be decoded by the sRGB curve
        (IEC 61966-2-1) first.
    roughness, metallic : as of `gpusim.surface.paint.Plain`, of the picture and what is around it.

    Raises
    ------
    InputError
        Not one picture, values that aren't finite or below 0 or above full scale, or a
        parameter out of range.

    Examples
    --------
    >>> picture = gs.paint.Image(np.array([[0, 255], [128, 64]], np.uint8), texel=0.01)
    >>> picture.size
    (0.02, 0.02)
    """

    pixels: npt.NDArray[Any]
    texel: Length
    origin: Place = (0.0, 0.0)
    dark: Albedo = Albedo(0.0)
    light: Albedo = Albedo(1.0)
    ground: Albedo = Albedo(0.5)
    gamma: Annotated[str, one_of("linear", "srgb")] = "linear"

    def __post_init__(self) -> None:
        pixels = np.asarray(self.pixels)
        shaped = (pixels.ndim == 2 or pixels.shape[2:] == (3,)) and pixels.size > 0
        got = f"{pixels.dtype} of shape {pixels.shape}"
        expected = "one grey picture (H, W), or one of colours (H, W, 3), of integers or floats"
        require(shaped and pixels.dtype.kind in "uif", "Image pixels", got, expected)
        small = max(pixels.shape) <= WIDEST
        require(small, "Image pixels", pixels.shape, f"at most {WIDEST} pixels a side")
        full = _full_scale(pixels)
        low, high = pixels.min(), pixels.max()
        fits = low >= 0 and high <= full
        require(fits, "Image pixels", f"values from {low} to {high}", f"0 to {full:g}")
        if pixels.ndim == 3 and (pixels == pixels[..., :1]).all():
            pixels = pixels[..., 0]
        object.__setattr__(self, "pixels", pixels)

    @staticmethod
    def read(
        path: str | os.PathLike[str] | InputFile,
        texel: float,
        *,
        channels: str = "rgb",
        **options: Any,
    ) -> Image:
        """A bitmap from a PNG, TIFF or other picture file; what is transparent isn't.

        ``channels``: "rgb" keeps the colours of a file that has some; "grey" turns them into grey
        (luma, ITU-R BT.601). ``options`` are the other parameters. Raises InputError if the file
        can't be read.
        """
        require(channels in ("rgb", "grey"), "Image channels", repr(channels), "'rgb' or 'grey'")
        try:
            image = Image(read_picture(path), texel, **options)
            if channels == "rgb" or image.pixels.ndim == 2:
                return image
            luma = np.minimum(image.pixels / _full_scale(image.pixels) @ np.array(LUMA), 1.0)
            return replace(image, pixels=luma)
        except InputError as error:
            name = path.path if isinstance(path, InputFile) else path
            raise InputError(f"{os.fspath(name)}: {error}") from None

    @property
    def size(self) -> tuple[float, float]:
        """Width and height on the surface."""
        rows, columns = self.pixels.shape[:2]
        return columns * self.texel, rows * self.texel

    @property
    def colored(self) -> bool:
        """Whether its pixels or its albedos aren't grey."""
        return self.pixels.ndim == 3 or super().colored

    def _of_band(self, band: int) -> Self:
        result = super()._of_band(band)
        return result if self.pixels.ndim == 2 else replace(result, pixels=self.pixels[..., band])

    def albedo(self) -> Float:
        """Albedo at the texels' centres, (H, W), or (H, W, 3) where it isn't grey."""
        if self.colored:
            return np.stack([self.in_band(band).albedo() for band in BANDS], axis=2)
        share = self.pixels / _full_scale(self.pixels)
        if self.gamma == "srgb":
            share = decoded(share)
        dark = grey(self.dark)
        result: Float = dark + (grey(self.light) - dark) * share
        return result

    @cached_property
    def levels(self) -> tuple[Level, ...]:
        """The spline surface and its coarser levels, of a grey bitmap; computed once."""
        return pyramid(self.albedo())

    def texel_position(self, st: Float) -> Float:
        """Paint coordinates (…, 2) as columns and rows counted from the upper left corner."""
        place = (st - np.array(self.origin)) / self.texel
        return np.stack([place[..., 0], len(self.pixels) - place[..., 1]], axis=-1)

    def features(self, low: Float, high: Float) -> Features | None:
        """A pattern, but none of shapes."""
        return Features.alike(PATCH, np.zeros((0, 2)), 0.0, 0.0)
