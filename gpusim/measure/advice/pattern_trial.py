"""What correlation errs by on a picture's own pattern, moved by waves that are known exactly.

A point's uncertainty from noise is that of a pixel's motion times the noise of the filter that
subset and window are (`gauge_filter`). A pixel's is sqrt(2) s / g: s the noise where slopes are,
g the root mean square slope along an axis. A blur of both pictures, of the transfer function G,
takes it to sqrt(2) s (sum q G^4)^(1/2) / (g sum q G^2), q being the slopes' spectrum with the sum 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.gpu import Device
from gpusim.measure.advice.gauge_filter import window_weights
from gpusim.measure.advice.image_noise import ImageNoise
from gpusim.measure.advice.synthetic_motion import (
    TAPER,
    WaveMotion,
    exposed,
    noise_free_pattern,
)
from gpusim.measure.correlation.dic import dic
from gpusim.measure.correlation.matching import Status
from gpusim.measure.correlation.warp import Shape


@dataclass(frozen=True)
class TrialErrors:
    """What a correlation of the moved pattern erred by.

    noise_px : standard deviation of displacements, whatever isn't a loss of the waves.
    loss : share of the waves that displacements lose.
    bias_px : amplitude of the part that repeats with each pixel of the displacement.
    measured : share of the points with texture that were measured.
    strain_noise, strain_loss : the same of strains, by step and window.
    """

    noise_px: float
    loss: float
    bias_px: float
    measured: float
    strain_noise: dict[tuple[int, int], float]
    strain_loss: dict[tuple[int, int], float]


@dataclass
class PatternTrial:
    """A part of a picture (H, W), the pixels of it that are used, its noise and the waves."""

    picture: npt.NDArray[Any]
    mask: Bool
    noise: ImageNoise
    motion: WaveMotion
    device: Device | None

    @cached_property
    def pattern(self) -> Float:
        """The picture without noise."""
        return noise_free_pattern(self.picture.astype(np.float64), self.noise)

    @cached_property
    def _slopes(self) -> tuple[Float, Float, Float, Float]:
        """Squared frequencies (H, W), spectrum of the squared slopes (H, W), of sum 1; squared slopes
        and noise (n,) of the pixels that are used."""
        down, across = np.meshgrid(*(2 * np.pi * np.fft.fftfreq(n) for n in self.mask.shape),
                                   indexing="ij")  # fmt: skip
        spectrum = np.fft.fft2(self.pattern)
        along = [np.fft.ifft2(1j * k * spectrum).real for k in (across, down)]
        inside = self.mask.copy()
        for edge in (slice(TAPER), slice(-TAPER, None)):
            inside[edge] = inside[:, edge] = False
        square = (0.5 * (along[0] ** 2 + along[1] ** 2))[inside]
        wave_number = down**2 + across**2
        power = np.abs(spectrum) ** 2 * wave_number
        return wave_number, power / power.sum(), square, self.noise.variance(self.pattern)[inside]

    @property
    def slope(self) -> float:
        """Root mean square of the pattern's slopes along an axis, grey levels per px."""
        return float(np.sqrt(self._slopes[2].mean()))

    @property
    def noise_level(self) -> float:
        """Standard deviation of the noise where the slopes are, grey levels."""
        return float(np.sqrt(np.average(self._slopes[3], weights=self._slopes[2])))

    def pixel_uncertainty(self, blur_px: float = 0.0) -> float:
        """Of the motion that a pixel tells, px."""
        wave_number, power, _, _ = self._slopes
        square = np.exp(-(blur_px**2) * wave_number)  # of the blur's transfer function
        widened = sqrt((power * square**2).sum()) / (power * square).sum()
        return float(sqrt(2.0) * self.noise_level / self.slope * widened)

    def errors(
        self, subset: int, shape: Shape, blur_px: float, step: int,
        gauges: list[tuple[int, int]], seed: int = 1, **options: Any,
    ) -> TrialErrors:  # fmt: skip
        """Correlate the moved pattern with points ``step`` px apart; ``gauges``: step and window,
        steps being multiples of that; ``options`` of ``dic``."""
        random = np.random.default_rng(seed)
        pictures = [exposed(pattern, self.noise, self.picture, random)
                    for pattern in (self.pattern, self.motion.moved(self.pattern))]  # fmt: skip
        height, width = self.mask.shape
        result = dic(
            *pictures, subset=subset, shape=shape, blur_px=blur_px, step=step, mask=self.mask,
            roi=(TAPER, TAPER, width - 1 - TAPER, height - 1 - TAPER), guess=(0.0, 0.0),
            device=self.device, backend="numpy" if self.device is None else "gpu", **options,
        )  # fmt: skip
        true, waves, slopes = self.motion.at(result.points)
        noise, loss, rest = _parts(result.displacement - true, waves)
        turn = np.exp(2j * np.pi * true)
        known = np.isfinite(rest)
        bias = 2.0 * abs((rest * turn)[known].mean()) if known.any() else np.nan
        usable = result.status != Status.MASKED
        columns = len(np.unique(result.points[:, 0]))
        # of a field without the even slope: what planes leave of the waves is a loss, too
        wavy, slopes = (
            field.reshape(-1, columns, 2) for field in (result.displacement - true + waves, slopes)
        )
        found = {gauge: _strain_parts(wavy, slopes, gauge[0] // step, *gauge) for gauge in gauges}
        return TrialErrors(
            noise, loss, float(bias), float(result.ok.sum() / max(usable.sum(), 1)),
            {gauge: parts[0] for gauge, parts in found.items()},
            {gauge: parts[1] for gauge, parts in found.items()},
        )  # fmt: skip


def _parts(error: Float, waves: Float) -> tuple[float, float, Float]:
    """Standard deviation of errors (M, 2) apart from a loss of ``waves``, that loss, the rest."""
    known = np.isfinite(error)
    if not known.any():
        return np.nan, np.nan, error
    loss = -float((error * waves)[known].sum() / np.square(waves[known]).sum())
    rest = error + loss * waves
    return float(np.sqrt(np.square(rest[known]).mean())), loss, rest


def _strain_parts(
    displacement: Float, slopes: Float, every: int, step: int, window: int
) -> tuple[float, float]:
    """Noise and loss of the slopes of planes through each window of a lattice (rows, columns, 2),
    of which ``every``-th points are taken."""
    slope, mean = (np.zeros(every * (window - 1) + 1) for _ in range(2))
    slope[::every], mean[::every] = window_weights(step, window)
    inner = (slice(len(slope) // 2, -(len(slope) // 2)),) * 2
    if min(displacement.shape[:2]) < len(slope):
        return np.nan, np.nan
    fit = [
        scipy.ndimage.correlate1d(
            scipy.ndimage.correlate1d(displacement, slope, axis=axis), mean, axis=1 - axis
        )[inner].reshape(-1, 2)
        for axis in (0, 1)
    ]
    # u by y and v by x have the waves, the others noise alone
    carrying, slopes = np.column_stack([fit[0][:, 0], fit[1][:, 1]]), slopes[inner].reshape(-1, 2)
    _, loss, rest = _parts(carrying - slopes, slopes)
    every_slope = np.hstack([rest, fit[0][:, 1:], fit[1][:, :1]])
    return float(np.sqrt(np.nanmean(np.square(every_slope)))), loss
