"""Digital numbers without noise: radiance scaled, rounded to nearest and clipped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Single
from gpusim.gpu import Device
from gpusim.optics.frame import Band

if TYPE_CHECKING:
    from gpusim.optics.sensor.sensor import Sensor


def scaled_on_device(
    sensor: Sensor, device: Device, bands: Sequence[Band], width: int
) -> npt.NDArray[Any]:
    """The bands' rows one below the other."""
    kernel = device.kernel("optics/sensor/sensor", constants={"bits": float(sensor.bits)})
    per_word = 4 // sensor.dtype.itemsize
    columns = -(-width // per_word)
    height = sum(band.rows for band in bands)
    out = device.empty(4 * columns * height, "sensor.words")
    with device.recording("optics.sensor") as recording:
        row = 0
        for band in bands:
            bindings = kernel.bind(
                params={"width": width, "rows": band.rows, "stride": band.stride,
                        "first_word": row * columns, "scale": sensor.scale},
                radiance=band.buffer,
                words=out,
            )  # fmt: skip
            recording.dispatch(kernel, bindings, threads=(columns, band.rows))
            row += band.rows
    image = out.read(sensor.dtype, (height, columns * per_word))
    return np.ascontiguousarray(image[:, :width])


def scaled_twin(sensor: Sensor, radiance: Single) -> npt.NDArray[Any]:
    """The same in NumPy float32; values that aren't finite become full scale."""
    full = np.float32(2**sensor.bits - 1)
    values = np.clip(np.rint(radiance * sensor.scale), 0.0, full)
    return np.where(np.isfinite(radiance), values, full).astype(sensor.dtype)
