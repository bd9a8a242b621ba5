"""Advice on settings against a full grid: ``python -m benchmarks.advice [--write] [--only NAME]``.

Ten speckle plates are rendered as they are and moved by waves (a mesh of 2 px quadrilaterals whose
nodes go where the waves take them), 8 bit, with the noise of a sensor. `gs.measure.advise` sees one
picture of each. Then every setting of a grid is measured on the rendered pairs, which know nothing
of how the advice moves pictures, and so is the one that it chose: the root mean square error of
strains, noise and loss of the waves together, over that of the best of the grid.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from itertools import product
from math import pi, sqrt
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import Lens, photograph, psf

Float = npt.NDArray[np.float64]
RESULTS = Path(__file__).parent / "results" / "advice.md"
SIZE, MARGIN, EDGE, CELL = 640, 24, 8, 2  # px
PERIOD, STRAIN = 100.0, 0.002
SUBSETS, SHAPES, BLURS = (15, 21, 29, 39, 53, 71, 97), ("affine", "quadratic"), (0.0, 0.7, 1.2)
STEPS, WINDOWS = (1, 2, 3), (3, 5, 7, 9, 11, 15, 21)  # sixths of a subset, points


@dataclass(frozen=True)
class Plate:
    """Speckle (px, share, px), albedo of dots and ground, lens (px), sensor (electrons)."""

    diameter: float
    coverage: float
    softness: float
    dot: float
    ground: float
    blur: float
    full_well: float
    read_noise: float


PLATES = {
    "3 px": Plate(3, 0.5, 0.6, 0.05, 0.95, 0.5, 10000, 8),
    "4 px": Plate(4, 0.5, 0.6, 0.1, 0.9, 0.7, 10000, 5),
    "5 px": Plate(5, 0.5, 1.0, 0.1, 0.9, 0.7, 5000, 10),
    "5 px, faint": Plate(5, 0.5, 1.0, 0.4, 0.6, 0.7, 10000, 10),
    "5 px, clean": Plate(5, 0.5, 1.0, 0.1, 0.9, 0.7, 200000, 0),
    "6 px, noisy": Plate(6, 0.5, 1.5, 0.05, 0.95, 0.7, 1500, 20),
    "7 px": Plate(7, 0.5, 1.0, 0.2, 0.7, 1.0, 8000, 10),
    "8 px, sparse": Plate(8, 0.25, 1.0, 0.1, 0.9, 0.7, 8000, 10),
    "10 px": Plate(10, 0.5, 1.5, 0.1, 0.8, 1.0, 10000, 10),
    "14 px, noisy": Plate(14, 0.5, 2.0, 0.2, 0.7, 1.2, 2000, 20),
}


def waves(x: Float, y: Float) -> tuple[Float, Float, Float]:
    """Displacement at places, the waves in it, and the waves' slopes (u by y, v by x): (..., 2)."""
    k = 2 * pi / PERIOD

    def shift(place: Float) -> tuple[Float, Float, Float]:
        wave = STRAIN / k * np.sin(k * place)
        return wave + place / SIZE - 0.5, wave, STRAIN * np.cos(k * place)

    u = shift(y)
    v = shift(x + u[0])
    first, second, third = (np.stack(pair, -1) for pair in zip(u, v, strict=True))
    return first, second, third


def picture(plate: Plate, moved: bool, number: int, device: Device) -> npt.NDArray[np.uint8]:
    """One exposure, the ``number``-th of the sensor."""
    middle, z = (SIZE - 1) / 2, 4.0 * SIZE
    side = np.arange(-MARGIN, SIZE + MARGIN + 1, CELL, dtype=np.float64)
    x, y = np.meshgrid(side, side)
    rest = np.stack([x - middle, y - middle, np.full_like(x, z)], -1).reshape(-1, 3)
    points = rest.copy()
    if moved:
        points[:, :2] += waves(x, y)[0].reshape(-1, 2)
    node = np.arange(x.size).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], -1)
    paint = gs.paint.Speckle(
        plate.diameter, plate.coverage, plate.softness, seed=3, dot=plate.dot, ground=plate.ground
    )
    frames = {"plate": gs.PaintFrame(rest[0], np.eye(3)[0], np.eye(3)[1])}
    surface = gs.Surface(
        points, faces.reshape(-1, 4), {"plate": paint}, reference=rest, frames=frames
    )
    camera = gs.Camera(SIZE, SIZE, np.array([[z, 0.0, middle], [0.0, z, middle], [0.0, 0.0, 1.0]]))
    sensor = gs.Sensor(8, 1.0, full_well=plate.full_well, read_noise=plate.read_noise)
    lens = Lens(psf=psf.Gaussian(plate.blur))
    frame = photograph([surface], camera, lens=lens, device=device)
    exposure: npt.NDArray[np.uint8] = sensor.expose(frame, number=number)
    return exposure


def measured(
    pairs: list[tuple[npt.NDArray[np.uint8], npt.NDArray[np.uint8]]],
    matching: tuple[int, str, float],
    step: int,
    gauges: list[tuple[int, int]],
    device: Device,
) -> dict[tuple[int, int], float]:
    """Root mean square error of strains by gauge: multiple of ``step``, points."""
    subset, shape, blur = matching
    sums: dict[tuple[int, int], list[tuple[float, float]]] = {gauge: [] for gauge in gauges}
    for before, after in pairs:
        roi = EDGE, EDGE, SIZE - 1 - EDGE, SIZE - 1 - EDGE
        found = gs.measure.dic(
            before, after, subset=subset, shape=shape, blur_px=blur, step=step, roi=roi,
            guess=(0.0, 0.0), apart_px=np.inf, tolerance=1e-3, device=device,
        )  # fmt: skip
        true, wave, slopes = waves(*found.points.T)
        columns = len(np.unique(found.points[:, 0]))
        field = (found.displacement - true + wave).reshape(-1, columns, 2)
        slopes = slopes.reshape(-1, columns, 2)
        for times, window in gauges:
            one = strain_parts(field, slopes, times, step, window)
            sums[times, window].append(one if found.ok.mean() > 0.98 else (np.nan, np.nan))
    errors = {}
    for gauge, parts in sums.items():
        noise, loss = np.transpose(parts)
        errors[gauge] = sqrt((noise**2).mean() + (loss.mean() * STRAIN) ** 2 / 2)
    return errors


def strain_parts(
    field: Float, slopes: Float, times: int, step: int, window: int
) -> tuple[float, float]:
    """Noise of strains, and the share of the waves that they lose, over all whole gauges."""
    place = np.arange(window) - window // 2
    slope, mean = np.zeros((2, times * (window - 1) + 1))
    slope[::times], mean[::times] = place / (place @ place * times * step), 1.0 / window
    inner = (slice(len(slope) // 2, -(len(slope) // 2)),) * 2
    by_y, by_x = (
        scipy.ndimage.correlate1d(
            scipy.ndimage.correlate1d(field, slope, axis=axis), mean, axis=1 - axis
        )[inner]
        for axis in (0, 1)
    )
    true = slopes[inner]
    error = np.stack([by_y[..., 0], by_x[..., 1]], -1) - true
    good = np.isfinite(error)
    if not good.any():
        return np.nan, np.nan
    loss = -float((error * true)[good].sum() / np.square(true[good]).sum())
    rest = [(error + loss * true)[good], by_y[..., 1].ravel(), by_x[..., 0].ravel()]
    return float(np.sqrt(np.nanmean(np.square(np.concatenate(rest))))), loss


def compare(name: str, exposures: int, device: Device) -> str:
    """One row: the choice, its error, the best of the grid and its error."""
    plate = PLATES[name]
    pairs = [
        (picture(plate, False, 2 * n + 1, device), picture(plate, True, 2 * n + 2, device))
        for n in range(exposures)
    ]
    start = time.process_time()
    advice = gs.measure.advise(
        picture(plate, False, 0, device), detail_px=PERIOD, peak_strain=STRAIN, device=device
    )
    spent, chosen = time.process_time() - start, advice.chosen
    grid = {}
    for subset, shape, blur in product(SUBSETS, SHAPES, BLURS):
        step = max(4, round(subset / 6))
        gauges = [
            (times, window)
            for times, window in product(STEPS, WINDOWS)
            if subset + times * step * (window - 1) <= SIZE // 2
        ]
        for (times, window), error in measured(
            pairs, (subset, shape, blur), step, gauges, device
        ).items():
            grid[subset, shape, blur, times * step, window] = error
    best = min(grid, key=lambda one: grid[one] if np.isfinite(grid[one]) else np.inf)
    own = measured(pairs, chosen.matching, chosen.step, [(1, chosen.strain_window)], device)
    ((_, error),) = own.items()
    words = "{0} px {1}, blur {2:g}, step {3}, window {4}"
    mine = words.format(*chosen.matching, chosen.step, chosen.strain_window)
    return (
        f"| {name} | {advice.pattern.speckle_px:.1f} | {advice.pattern.noise:.2f} | {mine} "
        f"| {1e6 * error:.0f} ({1e6 * chosen.strain.total:.0f}) | {words.format(*best)} "
        f"| {1e6 * grid[best]:.0f} | {error / grid[best]:.3f} | {spent:.1f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="plates whose name contains this")
    parser.add_argument("--exposures", type=int, default=1, help="pairs, each with its own noise")
    parser.add_argument("--write", action="store_true", help=f"also write {RESULTS.name}")
    arguments = parser.parse_args()
    device = Device()
    lines = [
        "# Settings advised, and the best of a full grid",
        "",
        f"{device.name}. Waves of {PERIOD:g} px and {STRAIN:g} strain, {arguments.exposures} "
        f"rendered pairs of {SIZE} x {SIZE} px; errors of strain in 1e-6, noise and loss, in "
        "brackets what the advice expects. The grid: "
        f"subsets {', '.join(map(str, SUBSETS))}, {' and '.join(SHAPES)}, blur "
        f"{', '.join(f'{b:g}' for b in BLURS)}, steps of 1/6, 1/3, 1/2 subset, windows "
        f"{', '.join(map(str, WINDOWS))}.",
        "",
        "| speckle | size px | noise | chosen | error | best of the grid | error | ratio | advice, "
        "processor s |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    for name in PLATES:
        if arguments.only in name:
            lines.append(compare(name, arguments.exposures, device))
            print(lines[-1], flush=True)
    if arguments.write:
        RESULTS.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()
