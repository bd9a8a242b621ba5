"""Sums of images: along rows, then along columns of sampled kernels, and weighted (lens positions,
moments of an exposure), and gains per pixel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float, Real, Single
from gpusim.gpu import Buffer, Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.frame import Frame
from gpusim.optics.lens.psf import SampledKernel


@dataclass(frozen=True, eq=False)
class Target:
    """Where an image of rows goes: a buffer of float32, its first element and elements a row."""

    buffer: Buffer
    first: int
    stride: int


def _table(weights: Float, n: int) -> Single:
    """(taps + 3 n, 4): what a value counts for in each of four neighbouring outputs."""
    table = np.zeros((len(weights) + 3 * n, 4), np.float32)
    for k in range(4):
        table[k * n : k * n + len(weights), k] = weights
    return table


class ConvolvePass:
    """Applies a kernel to images of cells that start ``kernel.halo`` cells before the first pixel.

    ``columns``, ``rows``: the largest image of pixels that it will be asked for.
    """

    def __init__(self, device: Device, kernel: SampledKernel, columns: int, rows: int) -> None:
        self.device, self.kernel = device, kernel
        cells = rows * kernel.n + 2 * kernel.halo
        self.between = device.empty(4 * columns * cells, "convolve.between")
        self._kernels = [
            device.kernel("optics/lens/convolution", constants={"vertical": vertical, "add": add})
            for vertical, add in ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0))
        ]
        self._tables = []
        for term in kernel.terms:
            pair = []
            for weights in term:
                table = _table(weights, kernel.n)
                texels = Texels(device, len(table), "rgba32float", "convolve.weights")
                texels.write(table)
                pair.append(texels)
            self._tables.append(pair)

    def run(self, cells: Buffer, columns: int, rows: int, target: Target) -> None:
        """Make ``rows`` x ``columns`` pixels from ``cells``, whose rows follow without gaps."""
        n, taps = self.kernel.n, self.kernel.taps + 3 * self.kernel.n
        wide, high = columns * n + 2 * self.kernel.halo, rows * n + 2 * self.kernel.halo
        for number, (along, across) in enumerate(self._tables):
            for vertical, table, values, sums, sizes in (
                (0, along, cells, self.between, (columns, high, 1, wide, 0, 1, columns)),
                (1, across, self.between, target.buffer,
                 (rows, columns, columns, 1, target.first, target.stride, 1)),
            ):  # fmt: skip
                count, lines, step_in, line_in, first, step_out, line_out = sizes
                kernel = self._kernels[vertical + int(vertical and number > 0)]
                params = {
                    "count": count, "lines": lines, "factor": n, "taps": taps,
                    "step_in": step_in, "line_in": line_in, "first_out": first,
                    "step_out": step_out, "line_out": line_out,
                }  # fmt: skip
                bindings = kernel.bind(params=params, table=table, values=values, sums=sums)
                blocks = -(-count // 4)
                threads = (lines, blocks) if vertical else (blocks, lines)
                with self.device.recording("optics.convolve") as recording:
                    recording.dispatch(kernel, bindings, threads=threads)

    def release(self) -> None:
        """Give the device memory back."""
        self.between.release()
        for pair in self._tables:
            for texels in pair:
                texels.release()


def convolve_twin(kernel: SampledKernel, cells: Real) -> Float:
    """The same in float64: cells (rows n + 2 halo, columns n + 2 halo) to pixels."""
    n, taps = kernel.n, kernel.taps
    rows, columns = ((side - 2 * kernel.halo) // n for side in cells.shape)
    result = np.zeros((rows, columns))
    values = cells.astype(np.float64)
    for along, across in kernel.terms:
        between = np.zeros((len(values), columns))
        for t in range(taps):
            between += along[t] * values[:, t : t + n * columns : n][:, :columns]
        for t in range(taps):
            result += across[t] * between[t : t + n * rows : n][:rows]
    return result


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
    sums: Float,
    values: Real,
    weight: float = 1.0,
    gain: bool = False,
) -> Float:
    """The same in float64, as a new array."""
    scaled = weight * values.astype(np.float64)
    result: Float = sums * scaled if gain else sums + scaled
    return result


def row_gains(gains: Float, width: int) -> Callable[[int, int], Float]:
    """As `multiplied` has them, from those (H,) of whole rows."""
    return lambda row0, rows: np.outer(gains[row0 : row0 + rows], np.ones(width))


def multiplied(frame: Frame, gains: Callable[[int, int], Float]) -> Frame:
    """A frame's pixels times ``gains``, which has (rows, W) of so many rows from one on; in place
    where the device has them."""
    if frame.coloured:
        return Frame.of_planes([multiplied(plane, gains) for plane in frame.planes])
    if frame.device is None:
        there, factors = frame.radiance.astype(np.float64), gains(0, frame.height)
        radiance = accumulate_twin(there, factors, gain=True).astype(np.float32)
        return Frame(frame.view, None, radiance=radiance)
    for band in frame.bands:
        factors = gains(band.row0, band.rows).astype(np.float32)
        buffer = frame.device.buffer(factors, "photograph.gains")
        accumulate(frame.device, buffer, frame.width, (band.rows, frame.width),
                   Target(band.buffer, 0, band.stride), gain=True)  # fmt: skip
        buffer.release()
    return frame


def added(frame: Frame, other: Frame) -> Frame:
    """The sum of two frames of the same bands, in place of the first where the device has them."""
    pairs = list(zip(frame.planes, other.planes, strict=True))
    if frame.device is None:
        sums = [a.radiance + b.radiance for a, b in pairs]
        return Frame.of_planes([Frame(frame.view, None, radiance=one) for one in sums])
    for plane, more in pairs:
        for band, own in zip(plane.bands, more.bands, strict=True):
            accumulate(frame.device, own.buffer, own.stride, (own.rows, frame.width),
                       Target(band.buffer, 0, band.stride))  # fmt: skip
    other.release()
    return frame
