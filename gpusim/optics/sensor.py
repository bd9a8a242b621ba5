"""The sensor: digital numbers from linear radiance.

This version is noise-free and linear: DN = round(radiance x scale), clipped to [0, 2^bits - 1].
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.gpu import Buffer, Device, compare, twin_check
from gpusim.optics.frame import Frame

__all__ = ["Sensor", "sensor_twin"]

AUTO_LEVEL = 0.95


@dataclass(frozen=True)
class Sensor:
    """A linear grey sensor.

    Parameters
    ----------
    bits : 8 to 16; more than 8 are stored as uint16.
    full_scale : radiance that gives the largest digital number.
    """

    bits: int = 8
    full_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.bits not in range(8, 17):
            raise InputError(f"Sensor bits; got {self.bits}; expected 8 to 16")
        if not (np.isfinite(self.full_scale) and self.full_scale > 0.0):
            raise InputError(
                f"Sensor full_scale; got {self.full_scale}; expected a radiance above 0"
            )

    @staticmethod
    def auto_exposed(frame: Frame, bits: int = 8) -> Sensor:
        """A sensor exposed so that the brightest pixel of ``frame`` is at 95 % of full scale.

        The maximum, not a quantile: the white of small markers is the first to saturate, and a
        clipped edge moves. Radiance has no noise, so that no outlier can decide.
        """
        level = float(frame.radiance.max())
        if not level > 0.0:
            raise InputError("auto exposure: the frame is black; got radiance 0; add a light")
        return Sensor(bits, level / AUTO_LEVEL)

    @property
    def dtype(self) -> np.dtype[Any]:
        """uint8 up to 8 bits, else uint16."""
        return np.dtype(np.uint8 if self.bits <= 8 else np.uint16)

    @property
    def scale(self) -> np.float32:
        """Digital numbers per unit of radiance."""
        return np.float32((2**self.bits - 1) / self.full_scale)

    def expose(self, frame: Frame, seed: int = 0) -> npt.NDArray[Any]:
        """The image of ``frame``, (H, W) uint8 or uint16.

        ``seed`` drives the noise; this sensor has none, so that it changes nothing.
        """
        if frame.device is None or not frame.bands:  # made by the twin, or released
            return sensor_twin(self, frame.radiance)
        parts = [
            _expose(frame.device, self, band.buffer, (band.rows, frame.width), band.stride)
            for band in frame.bands
        ]
        return np.concatenate(parts)


def _expose(
    device: Device, sensor: Sensor, radiance: Buffer, shape: tuple[int, int], stride: int
) -> npt.NDArray[Any]:
    count = shape[0] * shape[1]
    kernel = device.kernel("optics/sensor", constants={"bits": float(sensor.bits)})
    per_word = 4 // sensor.dtype.itemsize
    words = -(-count // per_word)
    out = device.empty(4 * words, "sensor.words")
    bindings = kernel.bind(
        params={"count": count, "width": shape[1], "stride": stride, "scale": sensor.scale},
        radiance=radiance,
        words=out,
    )
    with device.recording("optics.sensor") as recording:
        recording.dispatch(kernel, bindings, threads=(words,))
    return out.read(sensor.dtype, shape)


def sensor_twin(sensor: Sensor, radiance: npt.NDArray[np.float32]) -> npt.NDArray[Any]:
    """The same in NumPy float32; values that aren't finite become full scale."""
    full = np.float32(2**sensor.bits - 1)
    values = np.clip(np.rint(radiance * sensor.scale), 0.0, full)
    return np.where(np.isfinite(radiance), values, full).astype(sensor.dtype)


@twin_check("optics/sensor")
def _check(device: Device) -> None:
    radiance = np.random.default_rng(3).uniform(-0.1, 1.2, (33, 64)).astype(np.float32)
    for bits in (8, 12):
        sensor = Sensor(bits, 0.9)
        buffer = device.buffer(radiance, "sensor.radiance")
        got = _expose(device, sensor, buffer, (33, 57), 64)
        compare(f"optics/sensor, {bits} bit", got, sensor_twin(sensor, radiance[:, :57]), "exact")
