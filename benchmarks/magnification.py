"""Amplitude of magnified motion: ``python -m benchmarks.magnification [--write]``.

A random band-limited pattern moves by a sine along x, as a trigonometric polynomial does: exactly.
`gs.measure.magnify` makes the motion larger, and Lucas-Kanade measures in its pictures how large it
has become, against the pattern at rest. Theory (Wadhwa et al. 2013, of octave bands): phases move
a detail of wavelength L by up to about L / 4.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.measure.vibration.magnification import band_pass

Float = npt.NDArray[np.float64]
RESULTS = Path(__file__).parent / "results" / "magnification.md"
HEIGHT, WIDTH, CONTRAST = 72, 96, 40.0
RATE, BAND = 60.0, (12.0, 18.0)
TIMES = np.arange(80) / RATE
INNER = slice(20, 60)  # whole periods of all frequencies
POINTS = np.stack(np.meshgrid([36, 48, 60], [32, 40]), axis=-1).reshape(-1, 2) * 1.0
DISPLACEMENT = 0.02  # px
FACTORS = (5, 25, 50, 100, 150, 200, 300, 400)
FREQUENCIES = (3.0, 6.0, 9.0, 12.0, 15.0, 18.0, 21.0)
COARSE = (3.0, 6.0)  # px


def pattern(coarse: float) -> tuple[Float, Float]:
    """Spectrum of a pattern, and its frequencies along x."""
    fy, fx = np.fft.fftfreq(HEIGHT)[:, None], np.fft.rfftfreq(WIDTH)[None]
    frequency = np.hypot(fy, fx)
    noise = np.random.default_rng(1).normal(size=(HEIGHT, WIDTH))
    share = np.exp(-2.5 * (frequency * coarse) ** 2) * (frequency < 0.45) * (frequency > 0)
    spectrum = np.fft.rfft2(noise) * share
    return spectrum * (CONTRAST / np.fft.irfft2(spectrum, noise.shape).std()), fx


def film(coarse: float, places: Iterable[float]) -> Float:
    spectrum, fx = pattern(coarse)
    size = (HEIGHT, WIDTH)
    return np.array(
        [128 + np.fft.irfft2(spectrum * np.exp(-2j * np.pi * fx * x), size) for x in places]
    )


def magnified(coarse: float, frequency: float, factor: float) -> tuple[float, float, float]:
    """Amplitude over the original one; phase, degrees; share of the points that were found."""
    angle = 2 * np.pi * frequency * TIMES
    frames = film(coarse, DISPLACEMENT * np.sin(angle))
    pictures = np.array(list(gs.measure.magnify(frames, BAND, factor, rate_Hz=RATE)))[INNER]
    rest = film(coarse, [0.0])[0]
    series = gs.measure.point_series(pictures, POINTS, reference=rest, subset=31)
    found = series.displacement[:, series.ok, 0]
    terms = np.stack([np.sin(angle), np.cos(angle), np.ones_like(angle)], axis=1)[INNER]
    if not found.size:
        return np.nan, np.nan, 0.0
    sine, cosine, _ = np.linalg.lstsq(terms, found, rcond=None)[0].mean(axis=1)
    size = float(np.hypot(sine, cosine)) / DISPLACEMENT
    return size, float(np.degrees(np.arctan2(cosine, sine))), float(series.ok.mean())


def noise_growth(factor: float) -> tuple[float, float]:
    """Noise of a still film after magnification over that before; and theory's bound."""
    noise = np.random.default_rng(5).normal(size=(len(TIMES), HEIGHT, WIDTH))
    frames = film(3.0, [0.0]) + noise
    pictures = np.array(list(gs.measure.magnify(frames, BAND, factor, rate_Hz=RATE)))
    left = float((pictures - pictures.mean(axis=0))[INNER].std())
    taps = band_pass(*BAND, RATE, 60.0)
    return left, float(np.sqrt(1 + 0.5 * (factor - 1) ** 2 * np.square(taps).sum()))


def lines() -> Iterable[str]:
    yield "# Amplitude of magnified motion"
    yield ""
    yield (
        f"A sine of {DISPLACEMENT} px and 15 Hz along x, {RATE:.0f} pictures a second, band "
        f"{BAND[0]:.0f} to {BAND[1]:.0f} Hz. Error of the amplitude, of its phase, share of points "
        "that Lucas-Kanade still finds."
    )
    yield ""
    yield "| factor | motion shown px | pattern | error % | phase deg | found |"
    yield "|---|---|---|---|---|---|"
    for coarse in COARSE:
        for factor in FACTORS:
            size, phase, found = magnified(coarse, 15.0, factor)
            numbers = f"{100 * (size / factor - 1):+.1f} | {phase:+.2f}" if found else "lost | "
            shown = f"{factor * DISPLACEMENT:.2f}"
            yield f"| {factor} | {shown} | {coarse:.0f} px | {numbers} | {100 * found:.0f} % |"
    yield ""
    yield "Factor 25 over frequency, pattern of 3 px; the filter fades to 6 Hz and to 24 Hz:"
    yield ""
    yield "| frequency Hz | magnified by | phase deg |"
    yield "|---|---|---|"
    for frequency in FREQUENCIES:
        size, phase, _ = magnified(3.0, frequency, 25.0)
        yield f"| {frequency:.0f} | {size:.2f} | {phase:+.2f} |"
    yield ""
    yield "White noise on a still film:"
    yield ""
    yield "| factor | noise over noise | bound of theory |"
    yield "|---|---|---|"
    for factor in (5, 25):
        left, bound = noise_growth(factor)
        yield f"| {factor} | {left:.2f} | {bound:.2f} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help=f"write {RESULTS.name}")
    wanted = parser.parse_args()
    began, text = time.process_time(), []
    for line in lines():
        print(line, flush=True)
        text.append(line)
    if wanted.write:
        RESULTS.write_text("\n".join(text) + "\n", encoding="utf-8")
    print(f"{time.process_time() - began:.0f} processor seconds")


if __name__ == "__main__":
    main()
