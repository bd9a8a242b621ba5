"""What correlation errs by on a picture's own pattern, moved by waves that are known exactly.

A point's uncertainty from noise is that of a pixel's motion times the noise of the filter that
subset and window are (`gauge_filter`). A pixel's is sqrt(2) s / g: s the noise where slopes are,
g the root mean square slope along an axis. A blur of both pictures by the transfer function G takes
it to sqrt(2) s (sum q G^4)^(1/2) / (g sum q G^2), q being the spectrum of the slopes, of sum 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import hypot, nan, pi, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.gpu import Device
from gpusim.measure.advice.image_noise import ImageNoise
from gpusim.measure.advice.synthetic_motion import TAPER, WaveMotion, exposed, noise_free_pattern
from gpusim.measure.correlation.dic import dic
from gpusim.measure.correlation.matching import Status
from gpusim.measure.correlation.strain import strain


@dataclass(frozen=True)
class WaveError:
    """What a quantity errs by on waves, px or 1.

    noise : standard deviation.    loss : share of the waves that is lost.
    total : root mean square of both.
    """

    noise: float
    loss: float
    total: float


@dataclass(frozen=True)
class TrialErrors:
    """What a correlation of the moved pattern erred by.

    displacement, strain : px and 1.
    bias_px : amplitude of what repeats with each pixel of the displacement.
    measured : share of the points with texture that were measured.
    """

    displacement: WaveError
    strain: WaveError
    bias_px: float
    measured: float


@dataclass
class PatternTrial:
    """A part of a picture (H, W), the pixels of it that are used, its noise and the waves."""

    picture: npt.NDArray[Any]
    used: Bool
    noise: ImageNoise
    motion: WaveMotion
    device: Device | None

    def __post_init__(self) -> None:
        self.pattern = noise_free_pattern(self.picture.astype(np.float64), self.noise)
        frequencies = (2 * pi * np.fft.fftfreq(n) for n in self.used.shape)
        down, across = np.meshgrid(*frequencies, indexing="ij", sparse=True)
        spectrum = np.fft.fft2(self.pattern)
        self._square_frequency = down**2 + across**2
        power = np.abs(spectrum) ** 2 * self._square_frequency
        self._power = power / power.sum()
        inner = (slice(TAPER, -TAPER),) * 2
        used = self.used[inner]
        slopes = (np.fft.ifft2(1j * k * spectrum).real[inner][used] for k in (down, across))
        energy = sum(0.5 * slope**2 for slope in slopes)
        # pictures without noise have that of their grey levels
        whole = np.issubdtype(self.picture.dtype, np.integer)
        rounding = 1.0 / 12.0 if whole else (1e-6 * float(np.ptp(self.pattern))) ** 2
        variance = np.maximum(self.noise.variance(self.pattern)[inner][used], rounding)
        self.slope = float(np.sqrt(np.mean(energy)))
        """Root mean square of the pattern's slopes along an axis, grey levels per px."""
        self.noise_level = float(np.sqrt(np.average(variance, weights=energy)))
        """Standard deviation of the noise where the slopes are, grey levels."""

    def pixel_uncertainty(self, blur_px: float = 0.0) -> float:
        """Of the motion that a pixel tells, px."""
        square = np.exp(-(blur_px**2) * self._square_frequency)  # of the transfer function
        widened = np.sqrt((self._power * square**2).sum()) / (self._power * square).sum()
        return float(sqrt(2.0) * self.noise_level / self.slope * widened)

    def wave_errors(self, noise: Sequence[float], loss: Sequence[float]) -> list[WaveError]:
        """Of displacements and of strains."""
        strain_rms = self.motion.peak_strain / sqrt(2.0)
        waves = strain_rms * self.motion.period / (2 * pi), strain_rms
        parts = zip(noise, loss, waves, strict=True)
        return [WaveError(n, lost, hypot(n, lost * wave)) for n, lost, wave in parts]

    def errors(self, step: int, window: int, seed: int, **options: Any) -> TrialErrors:
        """Correlate the moved pattern with ``options`` of ``dic``, with other noise for each
        ``seed``, and take strains over ``window`` points."""
        random = np.random.default_rng(seed)
        before, after = (
            exposed(pattern, self.noise, self.picture, random)
            for pattern in (self.pattern, self.motion.moved(self.pattern))
        )
        height, width = self.used.shape
        roi = TAPER, TAPER, width - 1 - TAPER, height - 1 - TAPER
        options |= {"device": self.device, "backend": "numpy" if self.device is None else "gpu"}
        result = dic(before, after, step=step, roi=roi, mask=self.used, guess=(0.0, 0.0), **options)
        true, waves, slopes = self.motion.at(result.points)
        error, ok = result.displacement - true, result.ok
        noise, loss = _parts(error[ok], waves[ok])
        turn = np.exp(2j * pi * true[ok])
        bias = 2.0 * abs(((error + loss * waves)[ok] * turn).mean()) if ok.any() else nan
        # without the even slope; what planes leave of the waves is a loss, too
        fit = strain(replace(result, displacement=error + waves), window=window, spacing=step)
        whole = fit.ok & (fit.count == window**2)
        gradient = fit.gradient[whole]
        carrying = np.stack([gradient[:, 0, 1], gradient[:, 1, 0]], 1)
        strain_noise, strain_loss = _parts(carrying - slopes[whole], slopes[whole])
        share = ok.sum() / max(np.count_nonzero(result.status != Status.MASKED), 1)
        moved, strained = self.wave_errors((noise, strain_noise), (loss, strain_loss))
        return TrialErrors(moved, strained, float(bias), float(share))


def _parts(error: Float, waves: Float) -> tuple[float, float]:
    """Standard deviation of errors (M, 2) beside a loss of ``waves``, and that loss."""
    if not error.size:
        return nan, nan
    loss = -float((error * waves).sum() / np.square(waves).sum())
    return float(np.sqrt(np.square(error + loss * waves).mean())), loss
