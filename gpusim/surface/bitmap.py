"""A bitmap as paint: a photographed or computed pattern whose pixels are lengths on the surface."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.files.input_file import InputFile
from gpusim.files.picture_file import decode
from gpusim.surface.bump import Bump
from gpusim.surface.features import Features, check_albedo, check_finish, check_grid, check_length
from gpusim.surface.pyramid import Level, pyramid
from gpusim.validation import checked

__all__ = ["Image"]

WIDEST = 16384


@checked
@dataclass(frozen=True, eq=False)
class Image:
    """A grey bitmap whose pixels (texels) are squares of side ``texel`` on the surface.

    What is seen is the quintic B-spline through the texels' values at their centres; the renderer
    integrates it over each pixel. Between texels of hard contrast such a surface swings over by a
    few per cent; what a pixel gets is never below 0.

    Parameters
    ----------
    pixels : (H, W) of any integer or float type; the first row is the upper one (largest t).
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
        Not one grey picture, values that aren't finite or below 0 or above full scale, or a
        parameter out of range.

    Examples
    --------
    >>> picture = gs.paint.Image(np.array([[0, 255], [128, 64]], np.uint8), texel=0.01)
    >>> picture.size
    (0.02, 0.02)
    """

    pixels: npt.NDArray[Any]
    texel: float
    origin: tuple[float, float] = (0.0, 0.0)
    dark: float = 0.0
    light: float = 1.0
    ground: float = 0.5
    gamma: str = "linear"
    roughness: float = 1.0
    metallic: float = 0.0
    bump: Bump | None = None
    __repr__ = field_summary

    def __post_init__(self) -> None:
        check_finish("Image", self.roughness, self.metallic)
        pixels = np.asarray(self.pixels)
        if pixels.ndim != 2 or not pixels.size or pixels.dtype.kind not in "uif":
            raise InputError(
                f"Image pixels; got {pixels.dtype} of shape {pixels.shape}; expected one grey "
                "picture (H, W) of integers or floats"
            )
        if max(pixels.shape) > WIDEST:
            raise InputError(
                f"Image pixels; got {pixels.shape}; expected at most {WIDEST} pixels a side"
            )
        full = 1.0 if pixels.dtype.kind == "f" else float(np.iinfo(pixels.dtype).max)
        if not (pixels.min() >= 0 and pixels.max() <= full):
            raise InputError(
                f"Image pixels; got values from {pixels.min()} to {pixels.max()}; "
                f"expected 0 to {full:g}"
            )
        check_length("Image", texel=self.texel)
        check_grid("Image", self.origin, None, None)
        check_albedo("Image", dark=self.dark, light=self.light, ground=self.ground)
        if self.gamma not in ("linear", "srgb"):
            raise InputError(f"Image gamma; got {self.gamma!r}; expected 'linear' or 'srgb'")
        object.__setattr__(self, "pixels", pixels)

    @staticmethod
    def read(path: str | os.PathLike[str] | InputFile, texel: float, **options: Any) -> Image:
        """A bitmap from a PNG, TIFF or other picture file; colour is turned into grey.

        ``options`` are the other parameters. Raises InputError if the file can't be read.
        """
        values = decode(path, flags=cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE)
        try:
            return Image(values, texel, **options)
        except InputError as error:
            name = path.path if isinstance(path, InputFile) else path
            raise InputError(f"{os.fspath(name)}: {error}") from None

    @property
    def size(self) -> tuple[float, float]:
        """Width and height on the surface."""
        rows, columns = self.pixels.shape
        return columns * self.texel, rows * self.texel

    def albedo(self) -> npt.NDArray[np.float64]:
        """Albedo (H, W) at the texels' centres."""
        full = 1.0 if self.pixels.dtype.kind == "f" else float(np.iinfo(self.pixels.dtype).max)
        share = self.pixels / full
        if self.gamma == "srgb":
            share = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
        result: npt.NDArray[np.float64] = self.dark + (self.light - self.dark) * share
        return result

    @cached_property
    def levels(self) -> tuple[Level, ...]:
        """The spline surface and its coarser levels; computed once."""
        return pyramid(self.albedo())

    def texel_position(self, st: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Paint coordinates (…, 2) as columns and rows counted from the upper left corner."""
        place = (st - np.array(self.origin)) / self.texel
        return np.stack([place[..., 0], len(self.pixels) - place[..., 1]], axis=-1)

    def features(
        self, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]
    ) -> Features | None:
        """A pattern, but none of shapes."""
        empty = np.zeros((0, 2))
        return Features(np.zeros(0, np.int32), empty, np.zeros(0), empty, empty, empty)
