"""What the differences between measured and true fields say, in numbers.

A difference has three parts: the smoothing of subset and strain window (levelled less true), noise
(what the stated uncertainties let expect), and the rest: interpolation, calibration, lens, light.
Noise times spatial resolution, the metrological efficiency, stays about the same whatever the
subset: a larger one has less noise and resolves less.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.measure import gauge_filter
from gpusim.measure.correlation.matching import MIN_BLUR, SLOPE_NOISE
from gpusim.pipeline.measurements.dic.point_fields import PointFields
from gpusim.pipeline.measurements.results import mean, rms
from gpusim.report import Measurement
from gpusim.scene.tables.table import name_and_unit

MICROSTRAIN, MICRO_UNIT = 1e6, "um/m"
GOAL = 1e-2
"""Relative error up to which the largest displacement counts as good."""
LEAST_MEAN = 0.1
"""Share of the RMS strain from which on a mean strain is told: near zero it says nothing."""
AT_REST = 1e-9
"""px or mm of displacement that rounding makes."""
FARTHEST = 0.99
"""Quantile of the true displacements from which on points count for the largest one."""
MAIN = (
    "largest displacement", "points lost", "RMS error", "bias", "mean square of error", "mean e",
    "error of e",
)  # fmt: skip
"""What comes first in the report; the rest is told on demand."""
BEYOND = ", beyond the subsets' smoothing"

Row = tuple[str, str, float, float]
"""What it is, its unit, measured, true (zero of what should be zero, NaN where there is none)."""


def measurements(result: PointFields) -> list[Measurement]:
    """The last frame's numbers, the main one first."""
    rows = [*_motion(result), *_errors(result), *_noise(result), *_filters(result),
            *_strains(result)]  # fmt: skip
    return [
        Measurement.compare(
            f"{result.name}: {what}", unit, measured, true,
            tolerance_relative=None if number else GOAL, detail=_is_detail(what),
        )
        for number, (what, unit, measured, true) in enumerate(rows)
    ]  # fmt: skip


def _is_detail(what: str) -> bool:
    """Whether it is more than how far the result is from the truth."""
    return not what.startswith(MAIN) or "beyond" in what


def _motion(result: PointFields) -> Iterator[Row]:
    """The displacement where it is largest, of one point in a hundred so that it isn't noise that
    is told, and how many points were lost."""
    names = result.displacements
    lengths = (
        np.linalg.norm(result.values(one, names)[-1], axis=1) for one in ("measured", "true")
    )
    measured, true = lengths
    known = np.isfinite(measured)
    farthest = known & (true >= np.quantile(true[known], FARTHEST)) if known.any() else known
    unit = name_and_unit(names[0])[1]
    yield "largest displacement", unit, mean(measured[farthest]), mean(true[farthest])
    lost = result.reasons(-1)
    yield "points lost", "1", float(sum(lost.values())), 0.0
    for why, count in lost.items():
        yield f"lost points, {why}", "1", float(count), 0.0
    yield "points sought", "1", float(len(true)), np.nan


def _errors(result: PointFields) -> Iterator[Row]:
    """Of displacements, less the truth and less the levelled truth."""
    lengths = [one for one in result.displacements if one.endswith("_mm")]
    for kind, told in (("true", ""), ("levelled", BEYOND)) if lengths else ():
        difference = result.values("measured", lengths)[-1] - result.values(kind, lengths)[-1]
        yield f"RMS error of displacements{told}", "mm", rms(difference), 0.0
    for errors, told in ((result.raw_px[-1], ""), (result.rest_px[-1], BEYOND)):
        yield f"RMS error in the picture{told}", "px", rms(errors), 0.0
        biases = np.array([[mean(axis) for axis in one.T] for one in errors])
        yield f"standard deviation{told}", "px", rms(errors - biases[:, None]), 0.0
        largest = np.argmax(np.abs(np.nan_to_num(biases)))
        yield f"bias{told}", "px", float(biases.flat[largest]), 0.0


def _noise(result: PointFields) -> Iterator[Row]:
    """The noise floor, and whether differences are as large as it lets expect."""
    for name, sigma in result.table.columns.items():
        if name.startswith("sigma_") and result.ok[-1].any():
            what, unit = name_and_unit(name.removeprefix("sigma_"))
            whose, unit = (f" of {what.replace('_', ' ')}", unit) if unit else ("", what)
            floor = float(np.median(sigma[-1][result.ok[-1]]))
            yield f"noise floor (median sigma){whose}", unit, floor, 0.0
    if np.isfinite(result.calibration_px):
        yield "calibration, reprojection error", "px", result.calibration_px, 0.0
    moved = result.values("true", result.displacements)
    still = [place for place, one in enumerate(moved) if np.abs(one).max() <= AT_REST]
    if still:
        yield "noise floor (frames at rest)", "px", rms(result.raw_px[still]), 0.0
    yield "mean square of error over sigma", "1", mean(scores(result)[-1] ** 2), 1.0


def scores(result: PointFields) -> Float:
    """Measured less levelled displacements over their standard uncertainty, (F, M, K)."""
    table, names = result.table, result.displacements
    if "sigma_px" in table.columns:
        sigma, difference = table["sigma_px"][..., None] * result.spread, result.rest_px[:, 0]
    else:
        sigma = np.stack([table[f"sigma_{one}"] for one in names], axis=-1)
        difference = result.values("measured", names) - result.values("levelled", names)
    return np.asarray(difference / np.where(sigma > 0.0, sigma, np.nan))


def _filters(result: PointFields) -> Iterator[Row]:
    """What the settings resolve, and how near noise times resolution is to the least there is."""
    subset, shape = result.subset_px, result.shape
    alone = gauge_filter(subset, shape)
    periods = {"displacements": alone.resolution}
    if result.strains:
        gauge = gauge_filter(subset, shape, result.step_px, result.strain_window)
        periods["strains"] = gauge.resolution
    for what, period in periods.items():
        told = f"spatial resolution of {what} (10 % loss)"
        yield told, "px", period, float("nan")
        yield told, "mm", period * result.pixel_mm, float("nan")
    ok = result.ok[-1]
    if "zncc" not in result.table.columns or not ok.any():
        return
    noise = result.contrast * np.sqrt(np.maximum(1.0 - result.table["zncc"][-1], 0.0))
    # the noise of a pixel steepens the slopes that are seen
    own = SLOPE_NOISE if result.blur_px < MIN_BLUR else 0.0
    slope = np.sqrt(np.maximum(result.slope**2 - own * noise**2, 1e-30))
    best = alone.efficiency * float(np.median((noise / slope)[ok]))
    found = periods["displacements"] * float(np.median(result.table["sigma_px"][-1][ok]))
    yield "noise x resolution, beside the least of such subsets", "px^2", found, best


def _strains(result: PointFields) -> Iterator[Row]:
    """Of strains, at the points themselves and through the same subsets and windows."""
    for name in result.strains:
        kinds = "measured", "levelled", "true"
        measured, smooth, true = (MICROSTRAIN * result.table[f"{one}_{name}"][-1] for one in kinds)
        known = np.isfinite(measured)
        if abs(mean(smooth[known])) > LEAST_MEAN * rms(true[known]):
            yield f"mean {name}", MICRO_UNIT, mean(measured), mean(smooth[known])
        yield f"error of {name} at the points, RMS", MICRO_UNIT, rms(measured - true), 0.0
        yield f"error of {name} beyond smoothing, RMS", MICRO_UNIT, rms(measured - smooth), 0.0
