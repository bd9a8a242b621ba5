"""What a picture's pattern is like, and which part of it stands for the whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.field_summary import field_summary
from gpusim.measure.advice.pattern_trial import PatternTrial
from gpusim.measure.correlation.pixel_mask import full_scale

FLAT = 0.05  # of the squared slopes of most places: below, there is no texture
PLACE = 33  # px, the size of a place
FINE, COARSE = 3.0, 8.0  # px
MANY_WHITE, MANY_FLAT = 0.01, 0.1
NOISY = 0.2  # noise over slopes, px


@dataclass(frozen=True)
class PatternQuality:
    """What a picture's pattern is like.

    Attributes
    ----------
    speckle_px : width at half the height of the autocorrelation; 3 to 5 px is best.
    slope, noise : root mean square of the pattern's slopes along an axis (per px), and standard
        deviation of the noise where slopes are; grey levels.
    flat, saturated : share of the places without texture, and of the pixels at full scale.
    """

    speckle_px: float
    slope: float
    noise: float
    flat: float
    saturated: float
    __repr__ = field_summary

    @property
    def warnings(self) -> list[str]:
        """What is wrong with it, in words."""
        size = f"speckles of {self.speckle_px:.1f} px are"
        wrong = {
            f"{size} too fine: interpolation is biased, noise can't be told from them": FINE
            > self.speckle_px,
            f"{size} coarse: 3 to 5 px would allow smaller subsets": self.speckle_px > COARSE,
            f"{self.saturated:.1%} of the pixels are at full scale": self.saturated > MANY_WHITE,
            f"{self.flat:.0%} of the area has no texture: give a mask": self.flat > MANY_FLAT,
            "the noise is strong: more light or contrast helps most": self.noise
            > NOISY * self.slope,
        }
        return [text for text, holds in wrong.items() if holds]


def textured_pixels(picture: Float, used: Bool) -> Bool:
    """Whether each pixel (H, W) that is ``used`` lies in a place with a pattern."""
    slopes = np.gradient(scipy.ndimage.gaussian_filter(picture, 1.0))
    energy = scipy.ndimage.uniform_filter(np.hypot(*slopes) ** 2, PLACE)
    most = np.quantile(energy[used], 0.9) if used.any() else 0.0
    return used & (energy > FLAT * most)


def richest_part(textured: Bool, side: int) -> tuple[slice, slice]:
    """The part of a picture, at most ``side`` px wide, that has most texture, near the middle."""
    sides = [min(side, size) for size in textured.shape]
    share = scipy.ndimage.uniform_filter(textured.astype(np.float64), sides, mode="constant")
    places = np.argwhere(share >= share.max() - 0.01)
    middle = places[np.square(places - 0.5 * np.array(share.shape)).sum(axis=1).argmin()]
    first = [
        int(np.clip(place - part // 2, 0, size - part))
        for place, part, size in zip(middle, sides, textured.shape, strict=True)
    ]
    rows, columns = (slice(low, low + part) for low, part in zip(first, sides, strict=True))
    return rows, columns


def pattern_quality(
    picture: npt.NDArray[Any], used: Bool, textured: Bool, trial: PatternTrial
) -> PatternQuality:
    """Of a picture (H, W), whose pattern is that in ``trial``."""
    pattern, top = trial.pattern - trial.pattern.mean(), full_scale(picture)
    alike = np.fft.ifft2(np.abs(np.fft.fft2(pattern)) ** 2).real
    reach = min(alike.shape) // 2
    curve = 0.5 * (alike[0, :reach] + alike[:reach, 0]) / alike[0, 0]
    below = max(int(np.argmax(curve < 0.5)), 1)
    return PatternQuality(
        2.0 * float(below - (0.5 - curve[below]) / (curve[below - 1] - curve[below])),
        trial.slope,
        trial.noise_level,
        1.0 - float(textured.sum() / used.sum()),
        0.0 if top is None else float((picture[used] >= top).mean()),
    )
