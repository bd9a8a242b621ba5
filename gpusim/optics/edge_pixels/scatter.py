"""Single values into an image on the device: one upload, however many there are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Buffer, Device
from gpusim.optics.frame import Band

__all__ = ["scatter", "scatter_twin", "write_pixels"]


def scatter(
    device: Device,
    places: npt.NDArray[np.int64],
    values: npt.NDArray[np.float32],
    target: Buffer,
) -> None:
    """Write ``values`` (n,) to the words ``places`` (n,) of ``target``, all different."""
    if not len(places):
        return
    entries = np.stack([places.astype(np.uint32), values.view(np.uint32)], axis=1)
    kernel = device.kernel("optics/edge_pixels/scatter")
    bindings = kernel.bind(
        params={"count": len(places)},
        entries=device.buffer(entries, "scatter.entries"),
        radiance=target,
    )
    with device.recording("optics.scatter") as recording:
        recording.dispatch(kernel, bindings, threads=(len(places),))


def write_pixels(
    device: Device,
    bands: Sequence[Band],
    width: int,
    pixel: npt.NDArray[np.int64],
    value: npt.NDArray[np.float32],
) -> None:
    """Write ``value`` (n,) to the pixels of linear indices ``pixel`` (n,) in an image's bands."""
    row, column = np.divmod(pixel, width)
    for band in bands:
        own = np.flatnonzero((row >= band.row0) & (row < band.row0 + band.rows))
        places = (row[own] - band.row0) * band.stride + column[own]
        scatter(device, places, value[own], band.buffer)


def scatter_twin(
    there: npt.NDArray[np.float32],
    places: npt.NDArray[np.int64],
    values: npt.NDArray[np.float32],
) -> npt.NDArray[np.float32]:
    """A copy of ``there`` with the values in it."""
    result = there.copy()
    result.reshape(-1)[places] = values
    return result
