"""A picture's own pattern, moved by waves that are known exactly.

The pattern is the picture without its noise: in its spectrum, the power that noise has on average
is taken off (spectral subtraction), so that slopes have the energy that they had. Rows are then
shifted along x by a wave of y, and columns along y by a wave of x, by phases in Fourier space: the
trigonometric polynomial through the pixels is moved exactly, without interpolation in space, and
not by the spline through which correlation looks. A slope of one pixel across the picture lets
points lie at all fractions of a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Float
from gpusim.field_summary import field_summary
from gpusim.measure.advice.image_noise import ImageNoise

TAPER = 24  # px at the borders over which the pattern fades: no points there
SMOOTHING = 3.0  # spectral lines over which the power is averaged


def noise_free_pattern(picture: Float, noise: ImageNoise) -> Float:
    """The pattern (H, W) of a picture, which fades to its mean at the borders."""
    sides = (np.clip((np.arange(n) + 0.5) / TAPER, 0.0, 1.0) for n in picture.shape)
    taper = np.outer(*(np.sin(0.5 * np.pi * np.minimum(side, side[::-1])) ** 2 for side in sides))
    mean = float(picture.mean())
    spectrum = np.fft.fft2((picture - mean) * taper)
    power = scipy.ndimage.gaussian_filter(np.abs(spectrum) ** 2, SMOOTHING, mode="wrap")
    floor = float((noise.variance(picture) * taper**2).sum())
    share = np.maximum(1.0 - floor / np.maximum(power, 1e-300), 0.0)
    return mean + np.fft.ifft2(spectrum * np.sqrt(share)).real


@dataclass(frozen=True)
class WaveMotion:
    """Displacement of a picture of ``size`` (H, W) px by waves across both axes.

    period : px.    peak_strain : largest slope of a wave.
    """

    size: tuple[int, int]
    period: float
    peak_strain: float
    __repr__ = field_summary

    def at(self, points: Float) -> tuple[Float, Float, Float]:
        """At ``points`` (M, 2): displacement, the part of the waves, px, and the slopes of these,
        of u along y and of v along x; (M, 2) each."""
        u, u_wave, u_slope = self._shift(points[:, 1], self.size[0])
        v, v_wave, v_slope = self._shift(points[:, 0] + u, self.size[1])
        return np.stack([u, v], 1), np.stack([u_wave, v_wave], 1), np.stack([u_slope, v_slope], 1)

    def _shift(self, place: Float, length: int) -> tuple[Float, Float, Float]:
        """Shift at a coordinate, the wave in it, and the wave's slope."""
        offset, wave_number = place - (length - 1) / 2, 2 * np.pi / self.period
        wave = self.peak_strain / wave_number * np.sin(wave_number * offset)
        return wave + offset / length, wave, self.peak_strain * np.cos(wave_number * offset)

    def moved(self, pattern: Float) -> Float:
        """The pattern (H, W) after the motion."""
        for length in self.size:
            shift = self._shift(np.arange(length, dtype=np.float64), length)[0][:, None]
            phase = -2j * np.pi * np.fft.rfftfreq(pattern.shape[1]) * shift
            pattern = np.fft.irfft(np.fft.rfft(pattern) * np.exp(phase), pattern.shape[1]).T
        return pattern


def exposed(
    pattern: Float, noise: ImageNoise, like: npt.NDArray[Any], random: np.random.Generator
) -> npt.NDArray[Any]:
    """The pattern with fresh noise, in the grey levels of the picture ``like``."""
    grey = pattern + np.sqrt(noise.variance(pattern)) * random.normal(size=pattern.shape)
    if like.dtype.kind == "f":
        return grey
    return np.clip(np.rint(grey), 0, int(like.max())).astype(like.dtype)
