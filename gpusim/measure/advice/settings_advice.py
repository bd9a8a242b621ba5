"""Subset, step, shape, blur and strain window that err least on a picture.

What is to be measured are waves of a period and a peak strain. A setting's error on them is, root
of the sum of squares, its noise and what it takes off the waves. Both follow from its linear filter
(`gauge_filter`), the pattern's slopes and the noise; but where noise is strong or interpolation
biased, small subsets err by more. By how much more is measured: the picture's own pattern is moved
and correlated (`pattern_trial`). What hasn't been measured counts as ideal, so that the setting
that looks best is measured next, until it has been: few are, and the one that is chosen is best by
its measured error. Lastly it is measured once more, with other noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, pi, sqrt
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool
from gpusim.field_summary import field_summary
from gpusim.gpu import Device, working_device
from gpusim.measure.advice.gauge_filter import gauge_filter
from gpusim.measure.advice.image_noise import ImageNoise, image_noise
from gpusim.measure.advice.pattern_quality import PatternQuality, pattern_quality, usable_area
from gpusim.measure.advice.pattern_trial import PatternTrial, TrialErrors
from gpusim.measure.advice.synthetic_motion import TAPER, WaveMotion
from gpusim.measure.correlation.warp import Shape
from gpusim.validation import Positive, checked, require_one_of

Goal = Literal["strain", "displacement"]
Matching = tuple[int, Shape, float]
"""Subset, shape, blur: what displacements depend on."""
SUBSETS = (11, 13, 15, 17, 19, 21, 25, 29, 33, 39, 45, 53, 61, 71)
SHAPES: tuple[Shape, ...] = ("affine", "quadratic")
BLURS = (0.0, 0.7, 1.2)  # px
STEPS = (1, 2, 3)  # times a sixth of the subset
WINDOWS = (3, 5, 7, 9, 11, 15, 21)
PATCH = 512  # px, side of the part of the picture that is moved
DETAILS = 10  # waves across the shorter side of what is measured, unless said otherwise
MOST_LOST = 0.02  # share of the points with texture that a setting may fail to measure
CHEAPER = 1.03  # times the least error, for which points may be further apart


@dataclass(frozen=True)
class RatedSettings:
    """Settings, as in ``dic`` and ``strain``, and what they err by on the waves asked for.

    Attributes
    ----------
    gauge_px : width of the virtual strain gauge.
    noise_px, strain_noise : standard deviations.
    loss, strain_loss : shares of the waves that displacements and strains lose.
    resolution_px, strain_resolution_px : periods of which a tenth is lost.
    error_px, strain_error : root mean squares, noise and loss together.

    Examples
    --------
    >>> picture = gs.export.read_image("before.png")
    >>> rated = gs.measure.advise(picture, detail_px=60, backend="numpy").chosen
    >>> rated.gauge_px == rated.subset + rated.step * (rated.strain_window - 1)
    True
    """

    subset: int
    step: int
    shape: Shape
    blur_px: float
    strain_window: int
    gauge_px: int
    noise_px: float
    loss: float
    resolution_px: float
    error_px: float
    strain_noise: float
    strain_loss: float
    strain_resolution_px: float
    strain_error: float
    __repr__ = field_summary

    @property
    def matching(self) -> Matching:
        """What displacements depend on."""
        return self.subset, self.shape, self.blur_px


@dataclass(frozen=True)
class Advice:
    """Settings for a picture, and what they were chosen from.

    Attributes
    ----------
    goal, detail_px, peak_strain : what errs least: strains or displacements, of waves of this
        period and strain.
    noise, pattern : of the picture.
    pixel_px : uncertainty of the motion that a pixel tells without a blur, sqrt(2) s / g.
    chosen : the settings.
    table : all settings that were compared.
    measured : the subsets, shapes and blurs that were measured, with what they erred by.
    check : the chosen ones, measured again with other noise.

    Examples
    --------
    >>> picture = gs.export.read_image("before.png")
    >>> advice = gs.measure.advise(picture, detail_px=60, backend="numpy")
    >>> sorted(advice.settings)
    ['blur_px', 'shape', 'step', 'strain_window', 'subset']
    """

    goal: Goal
    detail_px: float
    peak_strain: float
    noise: ImageNoise
    pattern: PatternQuality
    pixel_px: float
    chosen: RatedSettings
    table: list[RatedSettings]
    measured: dict[Matching, TrialErrors]
    check: TrialErrors
    __repr__ = field_summary

    @property
    def settings(self) -> dict[str, Any]:
        """As keywords of ``CorrelationSettings``, and of ``dic`` and ``strain``."""
        names = ("subset", "step", "shape", "blur_px", "strain_window")
        return {name: getattr(self.chosen, name) for name in names}

    @property
    def efficiency(self) -> tuple[float, float]:
        """Noise x resolution of the displacements, px^2: measured, and what a least-squares subset
        of this shape can do at best (5.65 s / g affine, 3.42 s / g quadratic)."""
        ideal = gauge_filter(self.chosen.subset, self.chosen.shape)
        resolution = self.chosen.resolution_px
        return self.check.noise_px * resolution, self.pixel_px * ideal.noise * resolution


@checked
def advise(
    picture: npt.NDArray[Any],
    *,
    still: npt.NDArray[Any] | None = None,
    roi: tuple[int, int, int, int] | None = None,
    mask: Bool | None = None,
    noise: ImageNoise | None = None,
    detail_px: Positive | None = None,
    peak_strain: Positive = 0.002,
    goal: str = "strain",
    device: Device | None = None,
    backend: str = "auto",
) -> Advice:
    """Find the settings that err least on a picture with its own speckle and its own noise.

    Parameters
    ----------
    picture : (H, W) or (H, W, 3), the reference of the correlation.
    still : another picture of the same scene at rest, from which the noise is taken; else from
        ``picture``'s finest details.
    roi, mask : as of ``dic``.
    noise : of the picture, if it is known.
    detail_px : period of the finest waves that are to be seen; a tenth of the shorter side.
    peak_strain : their largest strain. Less of it calls for larger subsets and windows.
    goal : what is to err least on such waves, "strain" or "displacement".
    backend, device : as of ``dic``.

    Raises
    ------
    InputError
        An argument is wrong, or there is no texture, or less than 100 x 100 px of picture.

    Examples
    --------
    >>> picture = gs.export.read_image("before.png")
    >>> gs.measure.advise(picture, detail_px=60, backend="numpy").chosen.shape
    'quadratic'
    """
    device = working_device("advise", backend, device)
    require_one_of("goal", goal, get_args(Goal))
    area = usable_area(picture, roi, mask)
    detail = detail_px or min(area.image.shape) / DETAILS
    box = area.patch(PATCH)
    part, used = area.image[box], area.textured[box]
    if noise is None:
        grey = part.astype(np.float64)
        noise = image_noise(grey, None if still is None else area.same_part(still)[box], used)
    motion = WaveMotion(part.shape, float(detail), float(peak_strain))
    trial = PatternTrial(part, used, noise, motion, device)
    search = _Search(trial, goal)
    chosen = search.best()
    gauge = chosen.step, chosen.strain_window
    check = trial.errors(*chosen.matching, chosen.step, [gauge], seed=2)
    return Advice(
        goal, motion.period, motion.peak_strain, noise, pattern_quality(area, trial),
        trial.pixel_uncertainty(), chosen, search.table(), search.measured, check,
    )  # fmt: skip


class _Search:
    """Settings compared on the waves of a trial; ``goal`` is what decides."""

    def __init__(self, trial: PatternTrial, goal: Goal) -> None:
        self.trial = trial
        self.goal = goal
        self.measured: dict[Matching, TrialErrors] = {}
        room = min(trial.mask.shape) - 2 * TAPER
        self.candidates = [
            (subset, shape, step, window)
            for subset in SUBSETS
            if 2 * subset <= room
            for shape in SHAPES
            for step in (times * _lattice(subset) for times in STEPS)
            for window in WINDOWS
            if subset + step * (window - 1) <= room
        ]
        self.pixel_px = {blur: trial.pixel_uncertainty(blur) for blur in BLURS}

    def best(self) -> RatedSettings:
        """The best of all, of which what displacements depend on has been measured; the widest step
        that errs hardly more."""
        while True:
            table = self.table()
            best = min(table, key=self.error)
            if best.matching in self.measured:
                break
            self._measure(best.matching)
        alike = [one for one in table if one.matching == best.matching]
        most = CHEAPER * min(one.strain_error for one in alike)
        good = [one for one in alike if one.strain_error <= most]
        return max(good, key=lambda one: (one.step, -one.strain_error))

    def error(self, rated: RatedSettings) -> tuple[float, float]:
        """What is to be small."""
        errors = rated.strain_error, rated.error_px
        return errors if self.goal == "strain" else errors[::-1]

    def table(self) -> list[RatedSettings]:
        """All settings, rated by what is known by now."""
        return [
            self._rated((subset, shape, blur), step, window)
            for subset, shape, step, window in self.candidates
            for blur in BLURS
        ]

    def _measure(self, matching: Matching) -> None:
        lattice = _lattice(matching[0])
        gauges = [
            (step, window)
            for subset, shape, step, window in self.candidates
            if (subset, shape) == matching[:2]
        ]
        # whether subsets are torn isn't asked, and the last digits aren't: they cost half the time
        self.measured[matching] = self.trial.errors(
            *matching, lattice, gauges, apart_px=np.inf, tolerance=1e-3
        )

    def _excess(self, matching: Matching) -> tuple[float, float]:
        """Noise of displacements and of strains over what theory says: measured, between measured
        subsets interpolated; 1 where nothing is known, inf where points get lost."""
        subset, shape, blur = matching
        known = {
            one[0]: errors for one, errors in self.measured.items() if one[1:] == (shape, blur)
        }
        least = max((e.measured for e in self.measured.values()), default=0.0) - MOST_LOST
        lost = [one for one, errors in known.items() if not errors.measured >= least]
        if subset <= max(lost, default=0):
            return np.inf, np.inf
        good = sorted(set(known) - set(lost))
        if not good:
            return 1.0, 1.0
        excess = [self._excess_of((one, shape, blur), known[one]) for one in good]
        along = [float(np.interp(subset, good, values)) for values in zip(*excess, strict=True)]
        return along[0], along[1]

    def _excess_of(self, matching: Matching, errors: TrialErrors) -> tuple[float, float]:
        """The same of a subset that was measured."""
        pixel_px, kind = self.pixel_px[matching[2]], matching[:2]
        strains = [
            noise / (pixel_px * gauge_filter(*kind, *gauge).noise)
            for gauge, noise in errors.strain_noise.items()
        ]
        return errors.noise_px / (pixel_px * gauge_filter(*kind).noise), float(
            np.nanmedian(strains)
        )

    def _rated(self, matching: Matching, step: int, window: int) -> RatedSettings:
        subset, shape, blur = matching
        motion, values = self.trial.motion, []
        # root mean squares of the waves: of displacements and of strains
        waves = (
            motion.peak_strain * motion.period / (2 * pi * sqrt(2)),
            motion.peak_strain / sqrt(2),
        )
        filters = gauge_filter(subset, shape), gauge_filter(subset, shape, step, window)
        for one, excess, wave in zip(filters, self._excess(matching), waves, strict=True):
            noise, loss = (
                self.pixel_px[blur] * one.noise * excess,
                1.0 - one.response(motion.period),
            )
            values += [noise, loss, one.resolution, hypot(noise, loss * wave)]
        return RatedSettings(
            subset, step, shape, blur, window, subset + step * (window - 1), *values
        )


def _lattice(subset: int) -> int:
    """Distance of the points of a trial, px."""
    return max(2, round(subset / 6))
