"""What a picture's pattern is like, and which part of it stands for the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.arrays.grey import grey_of
from gpusim.field_summary import field_summary
from gpusim.measure.advice.pattern_trial import PatternTrial
from gpusim.measure.correlation.dic import grid_points
from gpusim.measure.correlation.pixel_mask import full_scale, masked_image
from gpusim.measure.images import check_image, pixels_of
from gpusim.validation import require

LEAST_AREA = 101  # px, shorter side
FLAT = 0.05  # of the squared slopes of most places: below, there is no texture
PLACE = 33  # px, the size of a place
FINE, COARSE = 2.5, 8.0  # px
MANY_SATURATED, MANY_FLAT = 0.01, 0.1
NOISY = 0.2  # noise over slopes, px


@dataclass(frozen=True)
class PatternQuality:
    """What a picture's pattern is like.

    Attributes
    ----------
    speckle_px : width at half the height of the autocorrelation; 3 to 5 px is best.
    contrast, slope, noise : standard deviation of the pattern, root mean square of its slopes along
        an axis (per px), standard deviation of the noise where slopes are; grey levels.
    flat, saturated : share of the places without texture, and of the pixels at full scale.

    Examples
    --------
    >>> gs.measure.PatternQuality(2.1, 60.0, 25.0, 2.0, 0.0, 0.0).warnings[0][:20]
    'speckles of 2.1 px: '
    """

    speckle_px: float
    contrast: float
    slope: float
    noise: float
    flat: float
    saturated: float
    __repr__ = field_summary

    @property
    def warnings(self) -> list[str]:
        """What is wrong with it, in words."""
        size, ratio = f"speckles of {self.speckle_px:.1f} px: ", self.noise / self.slope
        doubts = {
            size + "too fine for the pixels, which biases interpolation, and noise can't be told from "
            "them: give a second still picture, coarser speckles or a softer lens": self.speckle_px < FINE,
            size + "coarse; 3 to 5 px would allow smaller subsets": self.speckle_px > COARSE,
            f"{self.saturated:.1%} of the pixels are at full scale: expose less": (
                self.saturated > MANY_SATURATED
            ),
            f"{self.flat:.0%} of the area has no texture: give a mask or a region of interest": (
                self.flat > MANY_FLAT
            ),
            f"the noise is {ratio:.2g} of the slopes: more light, contrast or averaging would "
            "help most": ratio > NOISY,
        }  # fmt: skip
        return [text for text, holds in doubts.items() if holds]


@dataclass(frozen=True)
class UsableArea:
    """The region of interest of a picture.

    image : (H, W) grey values, what isn't a number replaced by their median.
    used, textured : (H, W), whether a pixel may be used; and whether there is a pattern, too.
    box : where it is in the picture.
    """

    image: npt.NDArray[Any]
    used: Bool
    textured: Bool
    box: tuple[slice, slice]
    shape: tuple[int, ...]

    def same_part(self, still: npt.NDArray[Any]) -> Float:
        """The region in another picture of the same size."""
        other = check_image(still, "still")
        require(other.shape == self.shape, "still", f"shape {other.shape}", f"{self.shape}")
        return other[self.box].astype(np.float64)

    def patch(self, side: int) -> tuple[slice, slice]:
        """The part of the region, at most ``side`` px wide, with the most texture; of several that
        have nearly as much, the one in the middle."""
        rows, columns = (min(side, size) for size in self.image.shape)
        table = np.pad(np.cumsum(np.cumsum(self.textured, axis=0), axis=1), ((1, 0), (1, 0)))
        total = table[rows:, columns:] + table[:-rows, :-columns]
        total = total - table[rows:, :-columns] - table[:-rows, columns:]
        places = np.argwhere(total >= 0.98 * total.max())
        middle = 0.5 * (np.array(total.shape) - 1)
        row, column = places[np.argmin(np.square(places - middle).sum(axis=1))]
        return slice(row, row + rows), slice(column, column + columns)


def usable_area(
    picture: npt.NDArray[Any], roi: tuple[int, int, int, int] | None, mask: Bool | None
) -> UsableArea:
    """The region of interest ``roi``, inclusive, and what of it can be used."""
    good = masked_image(picture, "picture", PLACE, mask).good
    pixels = grey_of(pixels_of(picture))
    x0, y0, x1, y1 = roi or (0, 0, pixels.shape[1] - 1, pixels.shape[0] - 1)
    grid_points(pixels.shape, subset=LEAST_AREA, step=1000, roi=(x0, y0, x1, y1))
    box = slice(y0, y1 + 1), slice(x0, x1 + 1)
    image = pixels[box]
    used = np.ones(image.shape, dtype=bool) if good is None else good[box]
    if image.dtype.kind == "f":
        image = np.where(np.isfinite(image), image, np.median(image[np.isfinite(image)]))
    slopes = np.gradient(scipy.ndimage.gaussian_filter(image.astype(np.float64), 1.0))
    energy = scipy.ndimage.uniform_filter(np.hypot(*slopes) ** 2, PLACE)
    most = float(np.quantile(energy[used], 0.9)) if used.any() else 0.0
    require(most > 0, "picture", "no texture that isn't masked", "a speckle pattern")
    return UsableArea(image, used, used & (energy > FLAT * most), box, pixels.shape)


def pattern_quality(area: UsableArea, trial: PatternTrial) -> PatternQuality:
    """Of a part of the picture in ``trial``, and of all of it."""
    pattern = trial.pattern - trial.pattern.mean()
    alike = np.fft.ifft2(np.abs(np.fft.fft2(pattern)) ** 2).real
    across = 0.5 * (alike[0] / alike[0, 0])[: min(alike.shape) // 2]
    across += 0.5 * (alike[:, 0] / alike[0, 0])[: min(alike.shape) // 2]
    below = int(np.argmax(across < 0.5)) or len(across) - 1
    width = below - (0.5 - across[below]) / max(across[below - 1] - across[below], 1e-12)
    top, image = full_scale(area.image), area.image[area.used]
    return PatternQuality(
        speckle_px=2.0 * float(width),
        contrast=float(trial.pattern[trial.mask].std()),
        slope=trial.slope,
        noise=trial.noise_level,
        flat=1.0 - float(area.textured.sum() / area.used.sum()),
        saturated=0.0 if top is None else float((image >= top).mean()),
    )
