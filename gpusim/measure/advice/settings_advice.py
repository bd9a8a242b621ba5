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
from itertools import product
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.field_summary import field_summary
from gpusim.gpu import Device, working_device
from gpusim.measure.advice.image_noise import ImageNoise, image_noise
from gpusim.measure.advice.pattern_quality import (
    PatternQuality,
    pattern_quality,
    richest_part,
    textured_pixels,
)
from gpusim.measure.advice.pattern_trial import PatternTrial, TrialErrors, WaveError
from gpusim.measure.advice.synthetic_motion import TAPER, WaveMotion
from gpusim.measure.correlation.dic import grid_points
from gpusim.measure.correlation.gauge_filter import GaugeFilter, gauge_filter
from gpusim.measure.correlation.pixel_mask import check_mask
from gpusim.measure.correlation.warp import Shape
from gpusim.measure.images import check_image
from gpusim.validation import checked, is_number, require, within

SETTINGS = "subset", "step", "shape", "blur_px", "strain_window"
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


@dataclass(frozen=True)
class RatedSettings:
    """Settings, as in ``dic`` and ``strain``, and what they err by on the waves asked for."""

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
    def filters(self) -> tuple[GaugeFilter, GaugeFilter]:
        """Of displacements and of strains."""
        return _filters(self.subset, self.shape, self.step, self.strain_window)


@dataclass(frozen=True)
class Advice:
    """Settings for a picture, and what they were chosen from.

    Attributes
    ----------
    motion : the waves on which strains are to err least.
    noise, pattern : of the picture.
    pixel_px : uncertainty of the motion that a pixel tells without a blur, sqrt(2) s / g.
    chosen : the settings, with what they err by.
    check : the same, measured again with other noise.
    table : all that were compared.
    trials : what was measured, by subset, shape and blur.

    Examples
    --------
    >>> picture = gs.export.read_image("before.png")
    >>> advice = gs.measure.advise(picture, detail_px=60, backend="numpy")
    >>> list(advice.settings), advice.chosen in advice.table
    (['subset', 'step', 'shape', 'blur_px', 'strain_window'], True)
    """

    motion: WaveMotion
    noise: ImageNoise
    pattern: PatternQuality
    pixel_px: float
    chosen: RatedSettings
    check: TrialErrors
    table: list[RatedSettings]
    trials: dict[Matching, TrialErrors]
    __repr__ = field_summary

    @property
    def settings(self) -> dict[str, Any]:
        """As keywords of ``CorrelationSettings``, or of ``dic`` and ``strain``."""
        return {name: getattr(self.chosen, name) for name in SETTINGS}


@checked
def advise(
    picture: npt.NDArray[Any],
    *,
    still: npt.NDArray[Any] | None = None,
    roi: tuple[int, int, int, int] | None = None,
    mask: Any = None,
    noise: ImageNoise | float | None = None,
    detail_px: Annotated[float, within(10.0, 1e5, "px")] | None = None,
    peak_strain: Annotated[float, within(1e-6, 0.1)] = 0.002,
    device: Device | None = None,
    backend: str = "auto",
) -> Advice:
    """Find the settings whose strains err least on a picture with its own speckle and noise.

    Parameters
    ----------
    picture : (H, W) or (H, W, 3), the reference of the correlation, finite.
    still : another picture of the same scene at rest, from which the noise is taken; else from
        ``picture``'s finest details.
    roi, mask : as of ``dic``; (H, W) bool.
    noise : of the picture, if it is known: its standard deviation in grey levels, or an
        ``ImageNoise`` that grows with them.
    detail_px : period of the finest waves that are to be seen; a tenth of the shorter side, from
        80 px up.
    peak_strain : their largest strain. Less of it calls for larger subsets and windows.
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
    image = check_image(picture, "picture")
    height, width = image.shape
    x0, y0, x1, y1 = roi or (0, 0, width - 1, height - 1)
    grid_points(image.shape, subset=LEAST_AREA, step=LEAST_AREA, roi=(x0, y0, x1, y1))
    box = slice(y0, y1 + 1), slice(x0, x1 + 1)
    allowed = check_mask(mask, image, 0.0)
    area, used = image[box], np.ones(image[box].shape, bool) if allowed is None else allowed[box]
    textured = textured_pixels(area.astype(np.float64), used)
    require(textured.any(), "picture", "no texture that isn't masked", "a speckle pattern")
    part = richest_part(textured, PATCH)
    if noise is not None and not isinstance(noise, ImageNoise):
        good = is_number(noise) and 0.0 <= noise < np.inf
        require(good, "advise noise", repr(noise), "grey levels from 0 up, or an ImageNoise")
        noise = ImageNoise(float(noise) ** 2)
    if noise is None:
        other = image if still is None else check_image(still, "still")
        require(other.shape == image.shape, "still", other.shape, f"{image.shape} as `picture`")
        grey, again = (one[box][part].astype(np.float64) for one in (image, other))
        noise = image_noise(grey, None if still is None else again, textured[part])
    period = float(detail_px or max(min(area.shape) / DETAILS, LEAST_DETAIL))
    motion = WaveMotion(area[part].shape, period, float(peak_strain))
    trial = PatternTrial(area[part], textured[part], noise, motion, device)
    search = _Search(trial)
    chosen = search.best()
    good = np.isfinite(chosen.strain.total)
    require(good, "picture", "a pattern that no setting measures", "a speckle pattern")
    options = dict(zip(("subset", "shape", "blur_px"), chosen.matching, strict=True))
    check = trial.errors(chosen.step, chosen.strain_window, seed=2, **options)
    quality = pattern_quality(area, used, textured, trial)
    table, unit = search.table(), trial.pixel_uncertainty()
    return Advice(motion, noise, quality, unit, chosen, check, table, search.trials)


class _Search:
    """Settings compared on the waves of a trial."""

    def __init__(self, trial: PatternTrial) -> None:
        self.trial = trial
        self.trials: dict[Matching, TrialErrors] = {}
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
        """The one whose strains err least, its subset, shape and blur being measured; with the
        widest step at which they err hardly more."""
        while (best := min(self.table(), key=_total)).matching not in self.trials:
            subset, shape, blur = best.matching
            # whether subsets are torn isn't asked, nor for the last digits: half the time
            self.trials[best.matching] = self.trial.errors(
                _lattice(subset), TRIAL_WINDOW, seed=1, subset=subset, shape=shape, blur_px=blur,
                apart_px=np.inf, tolerance=1e-3,
            )  # fmt: skip
        most = CHEAPER * _total(best)
        good = (o for o in self.table() if o.matching == best.matching and _total(o) <= most)
        return max(good, key=lambda one: (one.step, -_total(one)))

    def table(self) -> list[RatedSettings]:
        """All settings, rated by what is known by now."""
        period = self.trial.motion.period
        excess = {one: self._excess(one) for one in product(SUBSETS, SHAPES, BLURS)}
        result = []
        for subset, step, shape, blur, window in self.candidates:
            filters, more = _filters(subset, shape, step, window), excess[subset, shape, blur]
            noise = [self.pixel_px[blur] * f.noise * e for f, e in zip(filters, more, strict=True)]
            errors = self.trial.wave_errors(noise, [1.0 - f.response(period) for f in filters])
            result.append(RatedSettings(subset, step, shape, blur, window, *errors))
        return result

    def _excess(self, matching: Matching) -> list[float]:
        """Noise of displacements and of strains over what theory says: of the measured subset
        nearest in size, 1 where there is none."""
        alike = [one for one in self.trials if one[1:] == matching[1:]]
        if not alike:
            return [1.0, 1.0]
        nearest = min(alike, key=lambda one: abs(np.log(one[0] / matching[0])))
        (subset, shape, blur), errors = nearest, self.trials[nearest]
        unit = self.pixel_px[blur] * errors.measured**LOST_WEIGHT
        filters = _filters(subset, shape, _lattice(subset), TRIAL_WINDOW)
        return [
            error.noise / (unit * f.noise) if error.noise > 0 and unit > 0 else np.inf
            for error, f in zip((errors.displacement, errors.strain), filters, strict=True)
        ]


def _filters(subset: int, shape: Shape, step: int, window: int) -> tuple[GaugeFilter, GaugeFilter]:
    """Of displacements and of strains."""
    return gauge_filter(subset, shape), gauge_filter(subset, shape, step, window)


def _lattice(subset: int) -> int:
    """Distance of the points of a trial, px."""
    return max(2, round(subset / 6))


def _total(rated: RatedSettings) -> float:
    return rated.strain.total
