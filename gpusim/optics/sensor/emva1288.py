"""The noise of a camera sensor by the linear model of EMVA 1288, release 4.0.

Photons that arrive and electrons they free are Poisson distributed (shot noise, dark current); the
read-out adds normal noise, and every pixel has an offset (DSNU) and a gain (PRNU) of its own.
Random numbers are those of the pixel, drawn by counter (Philox 4x32-10): the same seed, camera and
frame give the same image in any order of work, and another frame an independent one. Poisson
numbers are quantiles: summed exactly below a mean of 12, from there on by Giles' asymptotic
expansion, whose probabilities differ by less than 2e-5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Single
from gpusim.gpu import Device
from gpusim.optics.frame import Band

U32 = npt.NDArray[np.uint32]
SMALL = 12.0
MOST_SUMMED = 60


@dataclass(frozen=True)
class Signal:
    """What the stage needs to know of a sensor; electrons, and grey values (DN) per electron.

    ``tile``: relative response of the four pixels of a Bayer tile, row by row.
    """

    bits: int
    electrons: float
    gain: float
    black: float
    full_well: float
    shot: bool
    dark: float
    read_noise: float
    dsnu: float
    prnu: float
    gamma: float
    tile: tuple[float, float, float, float]
    seed: int
    camera: int
    frame: int

    def constants(self) -> dict[str, float]:
        """What this sensor has, as override constants."""
        return {
            "bits": float(self.bits),
            "shot": float(self.shot),
            "readout": float(self.read_noise > 0.0),
            "pattern": float(self.dsnu > 0.0 or self.prnu > 0.0),
            "mosaic": float(self.tile != (1.0, 1.0, 1.0, 1.0)),
            "curved": float(self.gamma != 1.0),
        }


def philox(counter: U32, key: U32) -> U32:
    """Philox 4x32-10: (…, 4) words from counters (…, 4) and keys (2,)."""
    c = [counter[..., i].astype(np.uint64) for i in range(4)]
    k = [int(key[0]), int(key[1])]
    low = np.uint64(0xFFFFFFFF)
    for _ in range(10):
        a, b = np.uint64(0xD2511F53) * c[0], np.uint64(0xCD9E8D57) * c[2]
        c = [
            (b >> np.uint64(32)) ^ c[1] ^ np.uint64(k[0]),
            b & low,
            (a >> np.uint64(32)) ^ c[3] ^ np.uint64(k[1]),
            a & low,
        ]
        k = [(k[0] + 0x9E3779B9) & 0xFFFFFFFF, (k[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return np.stack(c, axis=-1).astype(np.uint32)


def uniform_of(words: U32) -> Single:
    """Words as numbers in (0, 1): multiples of 2^-24 plus half of one, but for the last, which
    would be rounded to 1."""
    shares = ((words >> np.uint32(8)).astype(np.float32) + np.float32(0.5)) * np.float32(2.0**-24)
    below: Single = np.minimum(shares, np.float32(1.0 - 2.0**-24))
    return below


# M. Giles, "Approximating the erfinv function", GPU Computing Gems, 2011, single precision
_CENTRAL = (2.81022636e-08, 3.43273939e-07, -3.5233877e-06, -4.39150654e-06, 0.00021858087,
            -0.00125372503, -0.00417768164, 0.246640727, 1.50140941)  # fmt: skip
_TAIL = (-0.000200214257, 0.000100950558, 0.00134934322, -0.00367342844, 0.00573950773,
         -0.0076224613, 0.00943887047, 1.00167406, 2.83297682)  # fmt: skip


def _horner(coefficients: tuple[float, ...], x: Single) -> Single:
    result = np.full_like(x, np.float32(coefficients[0]))
    for value in coefficients[1:]:
        result = result * x + np.float32(value)
    return result


def normal_quantile(p: Single) -> Single:
    """The p-quantile of the normal distribution, sqrt(2) erfinv(2 p - 1), in float32 (Giles)."""
    one = np.float32(1.0)
    w = -np.log(np.float32(4.0) * p * (one - p))
    central = _horner(_CENTRAL, w - np.float32(2.5))
    tail = _horner(_TAIL, np.sqrt(np.maximum(w, np.float32(0.0))) - np.float32(3.0))
    x = np.float32(2.0) * p - one
    result: Single = np.float32(np.sqrt(2.0)) * x * np.where(w < 5.0, central, tail)
    return result


def poisson_quantile(mean: Single, u: Single) -> Single:
    """The u-quantile of the Poisson distribution of ``mean``, float32 whole numbers."""
    one = np.float32
    z = normal_quantile(u)
    safe = np.maximum(mean, one(SMALL))
    large = (
        mean + np.sqrt(mean) * z + (one(1 / 3) + z * z / one(6.0))
        - (z / one(36.0) + z * z * z / one(72.0)) / np.sqrt(safe)
        + (z * z * (one(7 / 810) + z * z / one(270.0)) - one(8 / 405)) / safe
    )  # fmt: skip
    result = np.maximum(np.floor(large), one(0.0)).astype(np.float32)
    few = np.flatnonzero(mean.ravel() < SMALL)
    m, v = mean.ravel()[few], u.ravel()[few]
    k = np.zeros_like(m)
    term = np.exp(-m)
    total = term.copy()
    for turn in range(1, MOST_SUMMED + 1):
        on = v > total
        if not on.any():
            break
        k[on] = turn
        term = term * (m / one(turn))
        total = np.where(on, total + term, total)
    result.reshape(-1)[few] = k
    return result


def emva_twin(signal: Signal, radiance: Single, row0: int = 0) -> npt.NDArray[np.uint32]:
    """Grey values of radiance (rows, width), rows from ``row0`` of the image on; in float32."""
    rows, width = radiance.shape
    one = np.float32
    full = one(2**signal.bits - 1)
    numbers = (np.arange(rows * width, dtype=np.uint32) + np.uint32(row0 * width)).reshape(
        rows, width
    )
    key = np.array([signal.seed, signal.camera], np.uint32)
    has = {name: value == 1.0 for name, value in signal.constants().items()}

    def words(frame: int, stream: int) -> U32:
        counter = np.zeros((rows, width, 4), np.uint32)
        counter[..., 0], counter[..., 1], counter[..., 2] = numbers, frame, stream
        return philox(counter, key)

    finite = np.isfinite(radiance)
    value = np.maximum(np.where(finite, radiance, one(0.0)), one(0.0)) * one(signal.electrons)
    if has["mosaic"]:
        tile = np.array(signal.tile, np.float32).reshape(2, 2)
        value = value * tile[(np.arange(rows) + row0) % 2][:, np.arange(width) % 2]
    offset = np.zeros_like(radiance)
    if has["pattern"]:
        fixed = words(0, 1)
        offset = one(signal.dsnu) * normal_quantile(uniform_of(fixed[..., 0]))
        spread = one(1.0) + one(signal.prnu) * normal_quantile(uniform_of(fixed[..., 1]))
        value = value * np.maximum(spread, one(0.0))
    value = value + one(signal.dark)
    random = words(signal.frame, 0) if has["shot"] or has["readout"] else None
    if has["shot"]:
        assert random is not None
        value = poisson_quantile(value, uniform_of(random[..., 0]))
    value = np.minimum(value, one(signal.full_well)) + offset
    if has["readout"]:
        assert random is not None
        value = value + one(signal.read_noise) * normal_quantile(uniform_of(random[..., 1]))
    grey = one(signal.gain) * value + one(signal.black)
    if has["curved"]:
        share = np.clip(grey / full, one(0.0), one(1.0))
        grey = full * share ** one(1.0 / signal.gamma)
    grey = np.clip(np.rint(grey), one(0.0), full)
    return np.where(finite, grey, full).astype(np.uint32)


def expose_noisy(
    device: Device, signal: Signal, band: Band, width: int, dtype: npt.DTypeLike
) -> npt.NDArray[np.uint8] | npt.NDArray[np.uint16]:
    """Grey values of a band of rows, (rows, width)."""
    kernel = device.kernel("optics/sensor/emva1288", constants=signal.constants())
    per_word = 4 // np.dtype(dtype).itemsize
    count = band.rows * width
    words = -(-count // per_word)
    out = device.empty(4 * words, "emva.words")
    params = {
        "count": count, "width": width, "stride": band.stride, "first": band.row0 * width,
        "row0": band.row0, "frame": signal.frame, "seed": signal.seed, "camera": signal.camera,
        "electrons": signal.electrons, "dark": signal.dark, "full_well": signal.full_well,
        "read_noise": signal.read_noise, "dsnu": signal.dsnu, "prnu": signal.prnu,
        "gain": signal.gain, "black": signal.black, "exponent": 1.0 / signal.gamma,
        "tile": np.array(signal.tile),
    }  # fmt: skip
    bindings = kernel.bind(params=params, radiance=band.buffer, words=out)
    with device.recording("optics.emva") as recording:
        recording.dispatch(kernel, bindings, threads=(words,))
    return out.read(dtype, (band.rows, width))


@dataclass(frozen=True)
class Preset:
    """Values of a `gpusim.optics.sensor.sensor.Sensor`, and where they come from."""

    values: dict[str, Any]
    source: str


CAMERAS = {
    "stereo-dic-5mp": Preset(
        {
            "bits": 8,
            "gain": 1.0 / 124.0,
            "full_well": 32_000.0,
            # 0.07 DN^2 of temporal dark noise
            "read_noise": 124.0 * 0.07**0.5,
        },
        "photon transfer of a 5 megapixel stereo-DIC camera: 124 electrons per DN at 8 bit, full "
        "well 32,000 electrons, dark noise 0.07 DN^2",
    ),
    "imx174": Preset(
        {
            "bits": 12,
            "full_well": 32_691.0,
            "read_noise": 6.83,
            "quantum_efficiency": 0.77,
        },
        "Sony IMX174 (2.3 megapixels, 5.86 um) as published for Point Grey's Grasshopper3 "
        "GS3-U3-23S6M by EMVA 1288: quantum efficiency 77 % at 525 nm, temporal dark noise 6.83 "
        "electrons, saturation capacity 32,691 electrons",
    ),
    "icx625-pilot": Preset(
        {
            "bits": 12,
            "full_well": 7_000.0,
            "read_noise": 13.0,
            "quantum_efficiency": 0.47,
        },
        "Sony ICX625 (5 megapixels, 3.45 um) in Basler's piA2400-17gm, EMVA 1288: quantum "
        "efficiency 47 % at 545 nm, temporal dark noise 13 electrons, saturation capacity 7,000 "
        "electrons",
    ),
    "icx625-grasshopper": Preset(
        {
            "bits": 12,
            "full_well": 5_903.0,
            "read_noise": 8.28,
            "quantum_efficiency": 0.57,
        },
        "Sony ICX625 (5 megapixels, 3.45 um) in Point Grey's GS3-PGE-50S5M, EMVA 1288: quantum "
        "efficiency 57 % at 525 nm, temporal dark noise 8.28 electrons, saturation capacity 5,903 "
        "electrons",
    ),
}
