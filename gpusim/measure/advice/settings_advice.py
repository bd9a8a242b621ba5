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
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float
from gpusim.arrays.grey import grey_of
from gpusim.field_summary import field_summary
from gpusim.gpu import Device, working_device
from gpusim.measure.advice.gauge_filter import gauge_filter
from gpusim.measure.advice.image_noise import ImageNoise, image_noise
from gpusim.measure.advice.pattern_quality import (
    PatternQuality,
    richest_part,
    speckle_size,
    textured_pixels,
)
from gpusim.measure.advice.pattern_trial import PatternTrial, TrialErrors, WaveError
from gpusim.measure.advice.synthetic_motion import TAPER, WaveMotion
from gpusim.measure.correlation.dic import grid_points
from gpusim.measure.correlation.pixel_mask import full_scale, masked_image
from gpusim.measure.correlation.warp import Shape
from gpusim.measure.images import check_image, pixels_of
from gpusim.validation import Positive, checked, require, require_one_of

Goal = Literal["strain", "displacement"]
Matching = tuple[int, Shape, float]
"""Subset, shape, blur: what displacements depend on."""
SUBSETS = (11, 13, 15, 17, 19, 21, 25, 29, 33, 39, 45, 53, 61, 71, 83, 97, 113)
SHAPES: tuple[Shape, ...] = ("affine", "quadratic")
BLURS = (0.0, 0.7, 1.2)  # px
STEPS = (1, 2, 3)  # sixths of a subset
WINDOWS = (3, 5, 7, 9, 11, 15, 21)
PATCH = 512  # px, longest side of the part of the picture that is moved
LEAST_AREA = 101  # px, shortest side of what is measured
DETAILS = 10  # waves across the shorter side of what is measured, unless said otherwise
LEAST_DETAIL = 80.0  # px
TRIAL_WINDOW = 5  # points across the gauge whose excess of noise stands for all
LOST_WEIGHT = 10.0  # of a lost point: a tenth of them costs as much as 2.9 times the noise
CHEAPER = 1.03  # times the least error, for which points may be further apart


class RatedSettings(NamedTuple):
    """Settings, as in ``dic`` and ``strain``, and what they err by on the waves asked for.

    Examples
    --------
    >>> error = gs.measure.WaveError(0.003, 0.1, 0.005)
    >>> rated = gs.measure.RatedSettings(21, 7, "affine", 0.0, 5, error, error)
    >>> rated.gauge_px, round(rated.resolution_px), round(rated.strain_resolution_px)
    (49, 84, 132)
    """

    subset: int
    step: int
    shape: Shape
    blur_px: float
    strain_window: int
    displacement: WaveError
    strain: WaveError

    @property
    def matching(self) -> Matching:
        """What displacements depend on."""
        return self.subset, self.shape, self.blur_px

    @property
    def gauge_px(self) -> int:
        """Width of the virtual strain gauge."""
        return self.subset + self.step * (self.strain_window - 1)

    @property
    def resolution_px(self) -> float:
        """Period of a wave of which displacements lose a tenth."""
        return gauge_filter(self.subset, self.shape).resolution

    @property
    def strain_resolution_px(self) -> float:
        """Period of a wave of which strains lose a tenth."""
        return gauge_filter(self.subset, self.shape, self.step, self.strain_window).resolution


@dataclass(frozen=True)
class Advice:
    """Settings for a picture, and what they were chosen from.

    Attributes
    ----------
    goal, motion : what errs least: strains or displacements, of which waves.
    noise, pattern : of the picture.
    pixel_px : uncertainty of the motion that a pixel tells without a blur, sqrt(2) s / g.
    chosen : the settings.
    table : all that were compared.
    trials : what was measured, by subset, shape and blur.
    check : the chosen ones, measured again with other noise.

    Examples
    --------
    >>> picture = gs.export.read_image("before.png")
    >>> advice = gs.measure.advise(picture, detail_px=60, backend="numpy")
    >>> list(advice.settings), advice.chosen in advice.table
    (['subset', 'step', 'shape', 'blur_px', 'strain_window'], True)
    """

    goal: Goal
    motion: WaveMotion
    noise: ImageNoise
    pattern: PatternQuality
    pixel_px: float
    chosen: RatedSettings
    table: list[RatedSettings]
    trials: dict[Matching, TrialErrors]
    check: TrialErrors
    __repr__ = field_summary

    @property
    def settings(self) -> dict[str, Any]:
        """As keywords of ``CorrelationSettings``, or of ``dic`` and ``strain``."""
        return dict(zip(RatedSettings._fields[:5], self.chosen, strict=False))

    @property
    def efficiency(self) -> tuple[float, float]:
        """Noise x resolution of the displacements, px^2: as measured, and what a least-squares
        subset of this shape can do at best (5.65 s / g affine, 3.42 s / g quadratic)."""
        ideal = self.pixel_px * gauge_filter(self.chosen.subset, self.chosen.shape).noise
        resolution = self.chosen.resolution_px
        return self.check.displacement.noise * resolution, ideal * resolution


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
    goal: Goal = "strain",
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
    detail_px : period of the finest waves that are to be seen; a tenth of the shorter side, from
        80 px up.
    peak_strain : their largest strain. Less of it calls for larger subsets and windows.
    goal : what is to err least on such waves, "strain" or "displacement".
    backend, device : as of ``dic``.

    Raises
    ------
    InputError
        An argument is wrong, there is no texture, or the area is less than 101 x 101 px.

    Examples
    --------
    >>> picture = gs.export.read_image("before.png")
    >>> gs.measure.advise(picture, detail_px=60, backend="numpy").chosen.shape
    'quadratic'
    """
    device = working_device("advise", backend, device)
    require_one_of("goal", goal, get_args(Goal))
    image, used, box = _region(picture, roi, mask)
    grey = np.where(used, image, np.median(image[used])).astype(np.float64)
    textured = textured_pixels(grey, used)
    part = richest_part(textured, PATCH)
    if noise is None:
        other = None if still is None else _other_still(still, picture)[box][part]
        noise = image_noise(grey[part], other, textured[part])
    period = float(detail_px or max(min(image.shape) / DETAILS, LEAST_DETAIL))
    motion = WaveMotion(grey[part].shape, period, float(peak_strain))
    trial = PatternTrial(image[part], textured[part], noise, motion, device)
    top = full_scale(image)
    pattern = PatternQuality(
        speckle_px=speckle_size(trial.pattern), slope=trial.slope, noise=trial.noise_level,
        flat=1.0 - float(textured.sum() / used.sum()),
        saturated=0.0 if top is None else float((image[used] >= top).mean()),
    )  # fmt: skip
    search = _Search(trial, goal)
    chosen = search.best()
    options = dict(zip(("subset", "shape", "blur_px"), chosen.matching, strict=True))
    check = trial.errors(chosen.step, chosen.strain_window, seed=2, **options)
    pixel_px = trial.pixel_uncertainty()
    return Advice(
        goal, motion, noise, pattern, pixel_px, chosen, search.table(), search.trials, check
    )


def _region(
    picture: npt.NDArray[Any], roi: tuple[int, int, int, int] | None, mask: Bool | None
) -> tuple[npt.NDArray[Any], Bool, tuple[slice, slice]]:
    """Grey values (H, W) of the region of interest, whether they may be used, and where it is."""
    good = masked_image(picture, "picture", LEAST_AREA, mask).good
    image = grey_of(pixels_of(picture))
    x0, y0, x1, y1 = roi or (0, 0, image.shape[1] - 1, image.shape[0] - 1)
    grid_points(image.shape, subset=LEAST_AREA, step=LEAST_AREA, roi=(x0, y0, x1, y1))
    box = slice(y0, y1 + 1), slice(x0, x1 + 1)
    used = np.ones(image[box].shape, dtype=bool) if good is None else good[box]
    flat = not used.any() or np.ptp(image[box][used]) == 0
    require(not flat, "picture", "no texture that isn't masked", "a speckle pattern")
    return image[box], used, box


def _other_still(still: npt.NDArray[Any], picture: npt.NDArray[Any]) -> Float:
    other = check_image(still, "still")
    shape = picture.shape[:2]
    require(other.shape == shape, "still", f"shape {other.shape}", f"{shape} as `picture`")
    return other.astype(np.float64)


class _Search:
    """Settings compared on the waves of a trial; ``goal`` is what decides."""

    def __init__(self, trial: PatternTrial, goal: Goal) -> None:
        self.trial, self.goal = trial, goal
        self.trials: dict[Matching, TrialErrors] = {}
        self.excess: dict[Matching, tuple[float, float]] = {}
        self.pixel_px = {blur: trial.pixel_uncertainty(blur) for blur in BLURS}
        room = min(trial.used.shape) - 2 * TAPER
        self.candidates = [
            (subset, step, shape, blur, window)
            for subset in SUBSETS
            if 2 * subset <= room
            for step in (times * _lattice(subset) for times in STEPS)
            for window in WINDOWS
            if subset + step * (window - 1) <= room
            for shape in SHAPES
            for blur in BLURS
        ]

    def best(self) -> RatedSettings:
        """The best of all, of which what displacements depend on has been measured; the widest step
        that errs hardly more."""
        while (best := min(self.table(), key=self._error)).matching not in self.trials:
            self._measure(*best.matching)
        alike = [one for one in self.table() if one.matching == best.matching]
        most = CHEAPER * min(one.strain.total for one in alike)
        good = (one for one in alike if one.strain.total <= most)
        return max(good, key=lambda one: (one.step, -one.strain.total))

    def _error(self, rated: RatedSettings) -> tuple[float, float]:
        """What is to be small."""
        totals = rated.strain.total, rated.displacement.total
        return totals if self.goal == "strain" else totals[::-1]

    def table(self) -> list[RatedSettings]:
        """All settings, rated by what is known by now."""
        period = self.trial.motion.period
        result = []
        for subset, step, shape, blur, window in self.candidates:
            filters = gauge_filter(subset, shape), gauge_filter(subset, shape, step, window)
            excess = self._excess((subset, shape, blur))
            noise = [
                self.pixel_px[blur] * f.noise * e for f, e in zip(filters, excess, strict=True)
            ]
            errors = self.trial.wave_errors(noise, [1.0 - f.response(period) for f in filters])
            result.append(RatedSettings(subset, step, shape, blur, window, *errors))
        return result

    def _excess(self, matching: Matching) -> tuple[float, float]:
        """Noise of displacements and of strains over what theory says: of the measured subset
        nearest in size, 1 where there is none."""
        alike = [one for one in self.excess if one[1:] == matching[1:]]
        if not alike:
            return 1.0, 1.0
        return self.excess[min(alike, key=lambda one: abs(np.log(one[0] / matching[0])))]

    def _measure(self, subset: int, shape: Shape, blur: float) -> None:
        lattice = _lattice(subset)
        # whether subsets are torn isn't asked, nor for the last digits: half the time
        errors = self.trial.errors(
            lattice, TRIAL_WINDOW, seed=1, subset=subset, shape=shape, blur_px=blur,
            apart_px=np.inf, tolerance=1e-3,
        )  # fmt: skip
        filters = gauge_filter(subset, shape), gauge_filter(subset, shape, lattice, TRIAL_WINDOW)
        unit = self.pixel_px[blur] * errors.measured**LOST_WEIGHT
        both = errors.displacement, errors.strain
        one, other = (
            error.noise / (unit * f.noise) if error.noise > 0 and unit > 0 else np.inf
            for error, f in zip(both, filters, strict=True)
        )
        self.trials[subset, shape, blur] = errors
        self.excess[subset, shape, blur] = one, other


def _lattice(subset: int) -> int:
    """Distance of the points of a trial, px."""
    return max(2, round(subset / 6))
