"""A band-limited pattern that moves exactly: a trigonometric polynomial, shifted by phases."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Complex, Float


@dataclass(frozen=True)
class MovingPattern:
    """Random grey values of mean 128 and standard deviation ``contrast``, ``coarse`` px wide."""

    height: int = 96
    width: int = 120
    coarse: float = 3.5
    contrast: float = 40.0
    seed: int = 1

    def _waves(self) -> tuple[Float, Float]:
        return np.fft.fftfreq(self.height)[:, None], np.fft.rfftfreq(self.width)[None]

    def _spectrum(self) -> Complex:
        fy, fx = self._waves()
        frequency = np.hypot(fy, fx)
        noise = np.random.default_rng(self.seed).normal(size=(self.height, self.width))
        share = np.exp(-2.5 * (frequency * self.coarse) ** 2) * (frequency < 0.45)
        spectrum = np.fft.rfft2(noise) * share
        return spectrum * (self.contrast / np.fft.irfft2(spectrum, noise.shape).std())

    def frames(self, motion: Float) -> Float:
        """Pictures (T, H, W) after motions (T, 2) px."""
        fy, fx = self._waves()
        spectrum, size = self._spectrum(), (self.height, self.width)
        return np.array(
            [
                128 + np.fft.irfft2(spectrum * np.exp(-2j * np.pi * (fx * x + fy * y)), size)
                for x, y in motion
            ]
        )


def sine(times: Float, frequency_Hz: float, values: Float) -> tuple[Float, Float]:
    """Amplitude and phase (rad) of the sine in the columns of values (T, ...), by least squares."""
    angle = 2 * np.pi * frequency_Hz * times
    terms = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)
    found = np.linalg.lstsq(terms, values.reshape(len(times), -1), rcond=None)[0]
    shape = values.shape[1:]
    amplitude = np.hypot(found[0], found[1]).reshape(shape)
    return amplitude, np.arctan2(found[1], found[0]).reshape(shape)
