"""What the differences between measured and true fields say, in numbers.

A difference has three parts: the smoothing of subset and strain window (levelled less true), noise
(what the stated uncertainties let expect), and the rest: interpolation, calibration, lens, light.
Noise times spatial resolution, the metrological efficiency, stays about the same whatever the
subset: a larger one has less noise and resolves less.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.measure.correlation.matching import MIN_BLUR, SLOPE_NOISE
from gpusim.measure.correlation.subset_filter import (
    metrological_efficiency,
    spatial_resolution,
)
from gpusim.pipeline.measurements.dic.point_fields import PointFields
from gpusim.report import Measurement
from gpusim.scene.description.table import name_and_unit

MICROSTRAIN = 1e6
GOAL = 1e-2
"""Relative error up to which the largest displacement counts as good."""


LEAST_MEAN = 0.1
"""Share of the RMS strain from which on a mean strain has a relative error."""


def rms(values: Float) -> float:
    """Root mean square of what is finite; NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else float("nan")


def mean(values: Float) -> float:
    """Mean of what is finite; NaN of nothing."""
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else float("nan")


def rows(result: PointFields) -> list[Measurement]:
    """The last frame's numbers, the main one first."""
    return [*_motion(result), *_errors(result), *_noise(result), *_filters(result),
            *_strains(result)]  # fmt: skip


def _motion(result: PointFields) -> Iterator[Measurement]:
    """The displacement where it is largest, and how many points were lost."""
    names = result.displacements
    unit = name_and_unit(names[0])[1]
    measured, true = (
        np.linalg.norm(result.values(kind, names)[-1], axis=1) for kind in ("measured", "true")
    )
    known = np.isfinite(measured) & np.isfinite(true)
    most = int(np.argmax(np.where(known, true, -1.0)))
    yield Measurement.compare(
        f"{result.name}: largest displacement", unit, float(measured[most]), float(true[most]),
        tolerance_relative=GOAL,
    )  # fmt: skip
    lost = result.reasons(-1)
    told = f" ({', '.join(f'{count} {why}' for why, count in lost.items())})" if lost else ""
    count = float(sum(lost.values()))
    yield Measurement.noise(f"{result.name}: points lost of {len(known)}{told}", "1", count)


def _errors(result: PointFields) -> Iterator[Measurement]:
    """Of displacements, less the truth and less the levelled truth."""
    name = result.name
    lengths = [one for one in result.displacements if one.endswith("_mm")]
    if lengths:
        measured = result.values("measured", lengths)[-1]
        for kind, told in (("true", ""), ("levelled", ", beyond the subsets' smoothing")):
            difference = measured - result.values(kind, lengths)[-1]
            yield Measurement.noise(
                f"{name}: RMS error of displacements{told}", "mm", rms(difference)
            )
    for errors, told in ((result.raw_px, ""), (result.rest_px, ", beyond the subsets' smoothing")):
        last = errors[-1]
        yield Measurement.noise(f"{name}: RMS error in the picture{told}", "px", rms(last))
        biases = np.array([[mean(axis) for axis in one.T] for one in last])
        spread = rms(last - biases[:, None])
        yield Measurement.noise(f"{name}: standard deviation{told}", "px", spread)
        largest = biases.flat[np.argmax(np.abs(np.nan_to_num(biases)))]
        yield Measurement.noise(f"{name}: bias{told}", "px", float(largest))


def _noise(result: PointFields) -> Iterator[Measurement]:
    """The noise floor, and whether differences are as large as it lets expect."""
    name, table = result.name, result.table
    units = {"sigma_px": "px", "sigma_mm": "mm"}
    units |= {f"sigma_{one}": "mm" for one in result.displacements}
    for column, unit in units.items():
        if column in table.columns:
            known = table[column][-1][result.ok[-1]]
            if known.size:
                what = column.removeprefix("sigma_").removesuffix(f"_{unit}")
                along = f" along {what}" if what != unit else ""
                floor = float(np.median(known))
                yield Measurement.noise(f"{name}: noise floor (median sigma){along}", unit, floor)
    still = [
        k for k, one in enumerate(result.values("true", result.displacements)) if not one.any()
    ]
    if still:
        spread = rms(result.raw_px[still])
        yield Measurement.noise(f"{name}: noise floor (frames at rest)", "px", spread)
    chi = mean(scores(result)[-1] ** 2)
    yield Measurement.compare(f"{name}: mean square of error over sigma", "1", chi, 1.0)


def scores(result: PointFields) -> Float:
    """Measured less levelled displacements over their standard uncertainty, (F, M, K)."""
    table, names = result.table, result.displacements
    if "sigma_px" in table.columns:
        sigma = table["sigma_px"][..., None] * result.spread
        difference = result.rest_px[:, 0]
    else:
        sigma = np.stack([table[f"sigma_{one}"] for one in names], axis=-1)
        difference = result.values("measured", names) - result.values("levelled", names)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(sigma > 0.0, difference / sigma, np.nan))


def _filters(result: PointFields) -> Iterator[Measurement]:
    """What the settings resolve, and how near noise times resolution is to the least there is."""
    name, subset, unknown = result.name, result.subset_px, float("nan")
    shape: Any = result.shape
    period = spatial_resolution(subset, shape)
    gauge = spatial_resolution(subset, shape, result.step_px, result.strain_window)
    for what, value in (("displacements", period), ("strains", gauge)):
        if what == "strains" and not result.strains:
            continue
        told = f"{name}: spatial resolution of {what} (10 % loss)"
        yield Measurement(told, "px", value, unknown, unknown, unknown)
        yield Measurement(told, "mm", value * result.pixel_mm, unknown, unknown, unknown)
    if "zncc" not in result.table.columns:
        return
    noise = result.contrast * np.sqrt(np.maximum(1.0 - result.table["zncc"][-1], 0.0))
    # the noise of a pixel steepens the slopes that are seen
    own = SLOPE_NOISE if result.blur_px < MIN_BLUR else 0.0
    slope = np.sqrt(np.maximum(result.slope**2 - own * noise**2, 1e-30))
    ok = result.ok[-1]
    if ok.any():
        best = metrological_efficiency(subset, shape) * float(np.median((noise / slope)[ok]))
        found = period * float(np.median(result.table["sigma_px"][-1][ok]))
        told = f"{name}: noise x resolution, beside the least of such subsets"
        yield Measurement.compare(told, "px^2", found, best)


def _strains(result: PointFields) -> Iterator[Measurement]:
    """Of strains, at the points themselves and through the same subsets and windows."""
    for name in result.strains:
        measured = result.table[f"measured_{name}"][-1]
        known = np.isfinite(measured)
        average = [
            mean(result.table[f"{kind}_{name}"][-1][known]) for kind in ("measured", "levelled")
        ]
        one = Measurement.compare(
            f"{result.name}: mean {name}", "1e-6", *(MICROSTRAIN * one for one in average)
        )
        # of a mean near zero a relative error says nothing
        large = abs(average[1]) > LEAST_MEAN * rms(result.table[f"true_{name}"][-1][known])
        yield one if large else replace(one, error_relative=float("nan"))
        for kind, told in (("true", "at the points"), ("levelled", "beyond smoothing")):
            error = measured - result.table[f"{kind}_{name}"][-1]
            what = f"{result.name}: error of {name} {told}, RMS"
            yield Measurement.noise(what, "1e-6", MICROSTRAIN * rms(error))
