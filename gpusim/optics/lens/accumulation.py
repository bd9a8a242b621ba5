"""Weighted sums of images (lens positions, moments of an exposure), and gains per pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device
from gpusim.optics.lens.convolution import Target

__all__ = ["accumulate", "accumulate_twin"]


def accumulate(
    device: Device,
    values: Buffer,
    stride: int,
    shape: tuple[int, int],
    target: Target,
    *,
    weight: float = 1.0,
    gain: bool = False,
) -> None:
    """Add ``weight`` x ``values`` (rows of ``stride`` float32) to the target's ``shape`` pixels.

    ``gain``: multiply what is there by ``weight`` x ``values`` instead.
    """
    rows, columns = shape
    kernel = device.kernel("optics/lens/accumulation", constants={"scale_only": float(gain)})
    params = {
        "columns": columns, "rows": rows, "stride": stride, "first_out": target.first,
        "stride_out": target.stride, "weight": weight,
    }  # fmt: skip
    bindings = kernel.bind(params=params, values=values, sums=target.buffer)
    with device.recording("optics.accumulate") as recording:
        recording.dispatch(kernel, bindings, threads=(columns, rows))


def accumulate_twin(
    sums: npt.NDArray[np.float64],
    values: npt.NDArray[np.floating],
    weight: float = 1.0,
    gain: bool = False,
) -> npt.NDArray[np.float64]:
    """The same in float64, as a new array."""
    scaled = weight * values.astype(np.float64)
    result: npt.NDArray[np.float64] = sums * scaled if gain else sums + scaled
    return result
