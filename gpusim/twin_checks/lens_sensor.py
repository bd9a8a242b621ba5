"""Stages of the lens and the sensor against NumPy."""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Device, compare, twin_check
from gpusim.optics.frame import Band
from gpusim.optics.lens.convolution import (
    ConvolvePass,
    Target,
    accumulate,
    accumulate_twin,
    convolve_twin,
)
from gpusim.optics.lens.psf import Disc, sample
from gpusim.optics.sensor.emva1288 import Signal, emva_twin, expose_noisy
from gpusim.optics.sensor.sensor import Sensor, _expose, sensor_twin


@twin_check("optics/lens/convolution")
def _convolution(device: Device) -> None:
    kernel = sample(Disc(1.3), fill_factor=0.8, n=3)
    columns, rows = 37, 22  # blocks of four that aren't full, in both directions
    shape = (rows * 3 + 2 * kernel.halo, columns * 3 + 2 * kernel.halo)
    cells = np.random.default_rng(5).uniform(0.0, 1.0, shape).astype(np.float32)
    work = ConvolvePass(device, kernel, columns, rows)
    out = device.empty(4 * 3 * (40 * rows + 5), "convolve.out")
    work.run(device.buffer(cells, "convolve.cells"), columns, rows, Target(out, 5, 40))
    got = out.read(np.float32)[5 : 5 + 40 * rows].reshape(rows, 40)[:, :columns]
    compare("optics/lens/convolution", got, convolve_twin(kernel, cells), atol=5e-6, rtol=1e-5)


@twin_check("optics/lens/accumulation")
def _accumulation(device: Device) -> None:
    random = np.random.default_rng(8)
    values = random.uniform(-1.0, 1.0, (23, 40)).astype(np.float32)
    there = random.uniform(-1.0, 1.0, (30, 50)).astype(np.float32)
    for gain in (False, True):
        sums = device.buffer(there, "accumulate.sums")
        place = Target(sums, 4 * 50 + 7, 50)
        accumulate(
            device, device.buffer(values, "accumulate.values"), 40, (23, 37), place, weight=0.3,
            gain=gain,
        )  # fmt: skip
        want = there.astype(np.float64)
        want[4:27, 7:44] = accumulate_twin(want[4:27, 7:44], values[:, :37], 0.3, gain)
        compare("optics/lens/accumulation", sums.read(np.float32, (30, 50)), want)


@twin_check("optics/sensor/sensor")
def _sensor(device: Device) -> None:
    radiance = np.random.default_rng(3).uniform(-0.1, 1.2, (33, 64)).astype(np.float32)
    for bits in (8, 12):
        sensor = Sensor(bits, 0.9)
        buffer = device.buffer(radiance, "sensor.radiance")
        got = _expose(device, sensor, [Band(0, 33, 64, buffer)], 57)
        compare(
            f"optics/sensor/sensor, {bits} bit", got, sensor_twin(sensor, radiance[:, :57]), "exact"
        )


@twin_check("optics/sensor/emva1288")
def _emva1288(device: Device) -> None:
    radiance = np.random.default_rng(4).uniform(-0.02, 1.1, (29, 64)).astype(np.float32)
    radiance[:7] *= 0.01  # so dark that electrons are counted
    signal = Signal(12, 3000.0, 1.3, 40.0, 3100.0, True, 2.0, 2.5, 1.5, 0.01, 1.0,
                    (0.6, 1.0, 1.0, 0.5), 77, 5, 3)  # fmt: skip
    got = expose_noisy(device, signal, device.buffer(radiance, "emva.radiance"), (29, 57), 64, 3,
                       np.uint16)  # fmt: skip
    want = emva_twin(signal, radiance[:, :57], 3)
    # logarithms and exponentials may differ in their last bit: a quantile may fall on the next
    # electron (1.3 grey values), which happens to one pixel in some thousands
    compare("optics/sensor/emva1288", got.astype(np.float64), want.astype(np.float64), atol=2.0)
    differ = float(np.mean(got != want))
    compare("optics/sensor/emva1288: share of pixels that differ", [differ], [0.0], atol=2e-3)
