"""Motion magnification by phase (Wadhwa, Rubinstein, Durand, Freeman 2013).

Each band of a complex steerable pyramid has a phase that follows the motion. Its changes at some
temporal frequencies are taken out by a filter without delay, smoothed over the neighbourhood in
proportion to the band's power, so that noise where there is no texture doesn't count, and put back
several times as large: more than several times, by the share of a motion that isn't in phases.
Pictures are worked on in parts of the time and, where they are large, of the picture, so that
memory doesn't grow with either.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import scipy

from gpusim.arrays.array_types import Float, Long, Single
from gpusim.files.frame_source import Frames, FrameSource, read_frames
from gpusim.measure.images import Image, check_image
from gpusim.measure.vibration.sampling import picture_alike, sampling_rate
from gpusim.measure.vibration.steerable_pyramid import (
    INVERSE,
    Band,
    Spectrum,
    fourier,
    steerable_pyramid,
)
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.parallel.threads import shared
from gpusim.validation import checked, require

LOWEST = 1.0 / 64.0  # cycles a pixel of the lowest ring
DIRECTIONS = 8  # in half a turn
MARGIN = 32  # px around a part of a picture
SMOOTHING = 3.5  # px, standard deviation
TRANSITION = 0.5  # width in which the filter rises, over the low end of the band
LEAK_DB = 40.0  # of what isn't to be magnified, over what it was
MEMORY = 1 << 30  # bytes at once, about
PIXEL_BYTES = 28  # at once, for each picture of a part
LEAST_PICTURES = 24  # that come out of a part


@checked
def magnify(
    frames: Frames | FrameSource,
    band_Hz: tuple[float, float],
    factor: float,
    *,
    rate_Hz: float | None = None,
) -> Iterator[Image]:
    """Pictures in which motions of some frequencies are ``factor`` times as large.

    A motion can be shown at up to about a quarter of the wavelength of the pattern's details (see
    the documentation for measured errors); what moves further is blurred, not misplaced.

    Parameters
    ----------
    frames : pictures, as `read_frames` takes them, at even times; read about twice each.
    band_Hz : lowest and highest frequency that is magnified in full; the filter fades to
        half the lowest, and as far above the highest. It has no delay. Within its length (about
        six periods of the lowest frequency) of both ends of the film it knows one side alone.
    factor : of the motion; 0 takes it out.
    rate_Hz : pictures a second, if ``frames`` have no times.

    Yields
    ------
    (H, W) grey pictures of the frames' type.

    Raises
    ------
    InputError
        Times that aren't known or even, a band beyond half the rate, pictures of several sizes.

    Examples
    --------
    >>> still = gs.read_frames(np.full((70, 60, 80), 90, np.uint8))
    >>> pictures = list(gs.measure.magnify(still, (20, 40), 20, rate_Hz=200))
    >>> len(pictures), pictures[0].dtype, np.unique(pictures)
    (70, dtype('uint8'), array([90], dtype=uint8))
    """
    source = frames if isinstance(frames, FrameSource) else read_frames(frames)
    rate = sampling_rate(source.times) if rate_Hz is None else rate_Hz
    low, high = band_Hz
    require(
        0 < low < high < 0.5 * rate, "band_Hz", band_Hz, f"0 < low < high < {0.5 * rate:.6g} Hz"
    )
    require(bool(np.isfinite(factor)), "factor", factor, "a finite number")
    taps = band_pass(low, high, rate, LEAK_DB + 20 * np.log10(max(abs(factor), 1.0)))
    expected = f"more than {len(taps) // 2}, half the filter of {low:.6g} Hz at {rate:.6g} Hz"
    require(len(source) > len(taps) // 2, "frames", len(source), expected)
    return _magnified(source, taps, factor - 1.0)


def band_pass(low: float, high: float, rate_Hz: float, stop_dB: float) -> Float:
    """Symmetric filter (n,), n odd, that passes a band in full, and nothing that is constant."""
    width = TRANSITION * low
    count, beta = scipy.signal.kaiserord(stop_dB, width / (0.5 * rate_Hz))
    top = min(high + 0.5 * width, 0.5 * (high + 0.5 * rate_Hz))
    taps = scipy.signal.firwin(
        count | 1, [low - 0.5 * width, top], window=("kaiser", beta), pass_zero=False, fs=rate_Hz
    )
    return np.asarray(taps - taps.mean())


def _magnified(source: FrameSource, taps: Float, gain: float) -> Iterator[Image]:
    """The pictures, part of the time after part of the time."""
    first = check_image(source[0], source.names[0])
    reach = len(taps) // 2
    parts, count = _parts(first.shape, len(taps), len(source))
    kept: dict[int, Image] = {}
    for start in range(0, len(source), count):
        times = range(start, min(start + count, len(source)))
        needed = range(max(start - reach, 0), min(times.stop + reach, len(source)))
        kept = {k: kept[k] if k in kept else picture_alike(source, k, first) for k in needed}
        weights = _weights(taps, times, needed, len(source))
        result = np.empty((len(times), *first.shape), dtype=first.dtype)
        at = range(start - needed.start, times.stop - needed.start)
        for part in parts:
            shown = part.magnified(list(kept.values()), at, weights, gain)
            for picture, pixels in zip(result, shown, strict=True):
                picture[part.inner] = _as(pixels, first.dtype)
        yield from result


@dataclass(frozen=True)
class _Part:
    """Part of a picture: pixels that are worked on, and those of them that are shown.

    rows, columns : indices in the picture, mirrored beyond its border.
    inner : slices of the picture that the part shows; ``MARGIN`` px inside the former.
    """

    rows: Long
    columns: Long
    inner: tuple[slice, slice]

    def spectrum(self, picture: Image) -> Spectrum:
        """Of the part of a picture, the frequency 0 in the middle."""
        pixels = picture[self.rows[:, None], self.columns].astype(np.float32)
        return np.fft.fftshift(fourier(pixels))

    def shown(self, spectrum: Spectrum) -> Single:
        """Pixels of a spectrum that the part shows."""
        height, width = (one.stop - one.start for one in self.inner)
        pixels = fourier(np.fft.ifftshift(spectrum), INVERSE).real
        return pixels[MARGIN : MARGIN + height, MARGIN : MARGIN + width]

    def magnified(
        self, pictures: list[Image], at: range, weights: Single, gain: float
    ) -> list[Single]:
        """Those of T ``pictures`` that are ``at`` (N,), changed: (h, w) each. ``weights``
        (N, T - 1) filter the steps of a history from picture to picture at these times."""
        spectra = shared(self.spectrum, pictures)
        pyramid = steerable_pyramid(spectra[0].shape, LOWEST, DIRECTIONS)
        total = [spectra[time] * pyramid.rest for time in at]
        for band in pyramid.bands:
            _turn(band, spectra, total, at, weights * np.float32(gain / band.phase_share))
        return shared(self.shown, total)


def _turn(
    band: Band, spectra: list[Spectrum], total: list[Spectrum], at: range, weights: Single
) -> None:
    """Add a band of T pictures with some ``spectra`` (H, W) to the ``total`` of those that are
    ``at`` (N,), turned by its phases' steps from picture to picture times ``weights``
    (N, T - 1)."""
    responses = shared(band.response, spectra)
    steps = np.empty((len(spectra) - 1, band.mask.size), dtype=np.float32)

    def measure(time: int) -> None:
        steps[time] = np.angle(responses[time + 1] * responses[time].conj()).ravel()

    shared(measure, range(len(steps)))
    with one_blas_thread():
        change = (weights @ steps).reshape(-1, *band.mask.shape)
    down, across = SMOOTHING * np.array(band.mask.shape) / spectra[0].shape

    def add(number: int) -> None:
        response = responses[at[number]]
        power = np.square(response.real) + np.square(response.imag)
        weighted, norm = (
            cv2.GaussianBlur(values, (0, 0), across, sigmaY=down)
            for values in (change[number] * power, power)
        )
        angle = weighted / np.maximum(norm, np.float32(1e-30))
        turn = np.empty_like(response)
        turn.real, turn.imag = np.cos(angle), np.sin(angle)
        band.add(response * turn, total[number])

    shared(add, range(len(total)))


def _weights(taps: Float, times: range, needed: range, total: int) -> Single:
    """(N, T - 1): the filter at some ``times`` as weights of the steps between the pictures
    ``needed``. Beyond both ends of the film, of ``total`` pictures, a history goes on
    point-reflected."""
    reach = len(taps) // 2
    weights = np.zeros((len(times), len(needed)))
    for row, time in enumerate(times):
        for place, tap in zip(range(time - reach, time + reach + 1), taps, strict=True):
            end = min(max(place, 0), total - 1)
            if place != end:
                weights[row, end - needed.start] += 2 * tap
                place, tap = 2 * end - place, -tap
            weights[row, place - needed.start] += tap
    return weights[:, :0:-1].cumsum(axis=1)[:, ::-1].astype(np.float32)


def _parts(shape: tuple[int, ...], taps: int, total: int) -> tuple[list[_Part], int]:
    """Parts of pictures, and how many of ``total`` pictures are worked out at once, within
    ``MEMORY``."""
    least = 3 * max(taps, LEAST_PICTURES)
    splits = [1, 1]
    while True:
        sides = [-(-size // split) for size, split in zip(shape, splits, strict=True)]
        pictures = int(MEMORY / (PIXEL_BYTES * np.prod([side + 2 * MARGIN for side in sides])))
        longer = int(sides[1] > sides[0])
        if pictures >= min(least, total) or sides[longer] <= 2 * MARGIN:
            break
        splits[longer] += 1
    spans = [
        [_span(start, min(start + side, size), size) for start in range(0, size, side)]
        for side, size in zip(sides, shape, strict=True)
    ]
    parts = [
        _Part(rows, columns, (tall, wide)) for rows, tall in spans[0] for columns, wide in spans[1]
    ]
    return parts, max(pictures, least) - taps


def _span(start: int, stop: int, size: int) -> tuple[Long, slice]:
    """Indices of a stretch of an axis with its margins, and the stretch."""
    length = (stop - start + 2 * MARGIN) | 1
    while scipy.fft.next_fast_len(length) != length:
        length += 2
    mirrored = np.pad(np.arange(size), (MARGIN, length), mode="reflect")
    return mirrored[start : start + length], slice(start, stop)


def _as(shown: Single, dtype: np.dtype[Any]) -> Image:
    """Grey values in the type of the film."""
    if dtype.kind == "f":
        return shown.astype(dtype)
    limits = np.iinfo(dtype)
    return np.clip(np.rint(shown), limits.min, limits.max).astype(dtype)
