"""Complex steerable pyramid in the frequency domain (Simoncelli and Freeman 1995; Portilla and
Simoncelli 2000).

A picture is a sum of bands: of all frequencies in a ring and about a direction, without those
opposite, so that a band is complex: its phase moves with the pattern, and its size hardly changes.
Bands are kept at as few samples as they need. The uppermost ring reaches to the corners of the
spectrum: no part but the lowest frequencies is left without a phase.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Float, Single

Spectrum = npt.NDArray[np.complex64]
LEAST_SHARE = 0.1  # of a band's greatest, below which a direction counts as none of it
INVERSE = cv2.DFT_INVERSE | cv2.DFT_SCALE
TOP = 0.25  # cycles a pixel, where the uppermost ring begins to be whole


def fourier(values: Single | Spectrum, flags: int = 0) -> Spectrum:
    """Discrete Fourier transform of (h, w) values, by OpenCV, which is twice as fast as SciPy."""
    parts = values.view(np.float32).reshape(*values.shape, -1)
    transform = cv2.dft(parts, flags=flags | cv2.DFT_COMPLEX_OUTPUT)
    return np.asarray(transform).view(np.complex64)[..., 0]


@dataclass(frozen=True)
class Band:
    """One ring and direction.

    box : rows and columns of a spectrum that the band needs; the frequency 0 is in the middle.
    mask : (h, w) float32, there; the squares of all masks and their mirror images sum to 1.
    phase_share : how much of a small motion the phases of a ring show, of a pattern of even
        spectrum: what makes the size of a band change isn't in its phase. With centroids K of the
        bands and second moments M of their spectra, K . K over the trace of M, over all of a ring.
    """

    box: tuple[slice, slice]
    mask: Single
    phase_share: float

    def response(self, spectrum: Spectrum) -> Spectrum:
        """(h, w) complex samples of the band, from a spectrum (H, W). That the first frequency of
        the box counts as 0 turns all phases by what stays the same in all pictures."""
        return fourier(spectrum[self.box] * self.mask, INVERSE)

    def add(self, response: Spectrum, spectrum: Spectrum) -> None:
        """Add a band's samples to the ``spectrum`` of a sum whose real part is the picture."""
        spectrum[self.box] += fourier(response) * (2.0 * self.mask)


@dataclass(frozen=True)
class Pyramid:
    """Bands of pictures (H, W), and what of a spectrum is in none of them: ``rest`` (H, W)."""

    bands: tuple[Band, ...]
    rest: Single


@cache
def steerable_pyramid(shape: tuple[int, int], lowest: float, directions: int) -> Pyramid:
    """Bands an octave wide of pictures of a ``shape``, both sides odd, down to the frequency
    ``lowest``, cycles a pixel."""
    fy, fx = ((np.arange(size) - size // 2) / size for size in shape)
    with np.errstate(divide="ignore"):
        place = np.log2(np.hypot(fy[:, None], fx) / TOP)
    angle = np.arctan2(fy[:, None], fx)
    turns = [angle - np.pi * number / directions for number in range(directions)]
    around = [np.maximum(np.cos(turn), 0.0) ** (directions - 1) for turn in turns]
    around = [np.where(share > LEAST_SHARE, share, 0.0) for share in around]
    once = np.square(around).sum(axis=0)
    norm = np.sqrt(once + once[::-1, ::-1])  # and as opposite
    bands: list[Band] = []
    count = int(np.ceil(np.log2(TOP / lowest))) + 1
    for ring in range(count):
        inside = np.clip(place + ring, -1.0, 0.0 if ring == 0 else 1.0)
        radial = np.cos(0.5 * np.pi * inside) * (np.abs(inside) < 1.0)
        masks = [radial * share / norm for share in around]
        phase_share = _phase_share(masks, fx, fy[:, None])
        bands += [_cropped(mask, phase_share) for mask in masks]
    rest = np.sin(0.5 * np.pi * np.clip(place + count - 1, -1.0, 0.0)) ** 2
    return Pyramid(tuple(bands), rest.astype(np.float32))


def _phase_share(masks: list[Float], fx: Float, fy: Float) -> float:
    """`Band.phase_share` of the masks (H, W) of one ring, at frequencies ``fx``, ``fy``."""
    shown = whole = 0.0
    for mask in masks:
        power = mask**4  # a band goes through its mask twice
        shown += ((power * fx).sum() ** 2 + (power * fy).sum() ** 2) / power.sum()
        whole += float((power * (fx**2 + fy**2)).sum())
    return shown / whole


def _cropped(mask: Float, phase_share: float) -> Band:
    """A mask (H, W), with no more frequencies than it needs."""
    box = []
    for axis in (0, 1):
        size, used = mask.shape[axis], np.flatnonzero(mask.any(axis=1 - axis))
        length = min(scipy.fft.next_fast_len(int(used[-1] - used[0]) + 1), size)
        first = min(int(used[0]), size - length)
        box.append(slice(first, first + length))
    return Band((box[0], box[1]), mask[box[0], box[1]].astype(np.float32), phase_share)
