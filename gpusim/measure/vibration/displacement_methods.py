"""What of a subset is compared to find its motion: slopes, or phases.

- Lucas-Kanade: the slopes of the reference, freed of offset and gain as in ``correlation.icgn``,
  over the reference itself. Where both agree is the fixed point of the inverse-compositional
  iteration for a translation (Baker and Matthews 2004).
- gradient: its first step, from the nearest whole pixel (simplified optical flow; Javh, Slavič,
  Boltežar 2017). Right to 1 % within about 0.3 px of it.
- phase: the phase of complex Gabor filters along both directions (Fleet and Jepson 1990; Chen et
  al. 2015), which neither an offset nor a gain moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Complex, Float
from gpusim.measure.vibration.shifted_subsets import ReferenceSubsets

STEPS = 40
WAVES = 4.0  # of a Gabor filter across its subset
SPREAD = 0.15  # standard deviation of its envelope over the width of the subset
MIN_RESPONSE = 0.5  # of a filter, over what white noise of the subset's contrast gives


@dataclass(frozen=True)
class LucasKanade:
    steps: int = STEPS
    least_slope: float = 0.03

    def functionals(self, subsets: ReferenceSubsets) -> Float:
        grey = subsets.grey[:, None]
        slope = subsets.slope - subsets.slope.mean(axis=2, keepdims=True)
        slope -= grey * ((slope * grey).sum(axis=2) / (grey**2).sum(axis=2))[:, :, None]
        return np.concatenate([slope, grey], axis=1)

    def difference(self, model: Float, seen: Float) -> Float:
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(model[:, :-1] / model[:, -1:] - seen[:, :-1] / seen[:, -1:])

    def slope(self, model: Float, change: Float) -> Float:
        share = model[:, :-1] / model[:, -1:]
        return np.asarray((change[:, :-1] - share * change[:, -1:]) / model[:, -1:])


@dataclass(frozen=True)
class LocalPhase:
    steps: int = STEPS
    least_slope: float = 0.3

    def functionals(self, subsets: ReferenceSubsets) -> Float:
        size, grey = subsets.size, subsets.grey
        offset = np.arange(size) - size // 2
        places = np.stack(np.meshgrid(offset, offset), axis=-1).reshape(-1, 2)
        envelope = np.exp(-0.5 * (places**2).sum(axis=1) / (SPREAD * size) ** 2)
        wave = np.exp(2j * np.pi * WAVES / size * (subsets.directions @ places.T))
        constant = (envelope * wave).sum(axis=1, keepdims=True) / envelope.sum()
        filters = envelope * (wave - constant)  # no offset passes
        count = len(grey)
        parts = [np.tile(part, (count, 1, 1)) for part in (filters.real, filters.imag)]
        noise = np.linalg.norm(filters, axis=1) * grey.std(axis=1)[:, None]
        weak = ~(np.abs(grey @ filters.T) > MIN_RESPONSE * noise).all(axis=1)
        for part in parts:
            part[weak] = np.nan  # never measured
        return np.concatenate([*parts, grey[:, None]], axis=1)

    def difference(self, model: Float, seen: Float) -> Float:
        return np.angle(_responses(model) * _responses(seen).conj())

    def slope(self, model: Float, change: Float) -> Float:
        return np.asarray((_responses(change) / _responses(model)).imag)


def _responses(values: Float) -> Complex:
    """(P, U) complex responses from real parts, imaginary parts and one more."""
    count = values.shape[1] // 2
    return np.asarray(values[:, :count] + 1j * values[:, count:-1])
