"""Digital image correlation of two images on a grid of points or at given ones.

Start values: a coarse lattice of seeds is found by an integer search around no displacement and
around the one that most of the picture made; where that finds less than half of them, from
matched features. From the seeds the front spreads over the other points (see ``propagation``).
"""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.choices import Start
from gpusim.errors import InputError
from gpusim.gpu import Device, working_device
from gpusim.measure.correlation.coherence import CheckedFront
from gpusim.measure.correlation.matching import (
    Correlation,
    DicResult,
    Settings,
    Status,
    Window,
    make_result,
    make_settings,
    noise_factor,
)
from gpusim.measure.correlation.pixel_mask import check_mask, masked_image, name_failures
from gpusim.measure.correlation.propagation import Front, seeds
from gpusim.measure.correlation.start_values import feature_motions, global_shift
from gpusim.measure.correlation.warp import Shape
from gpusim.measure.images import check_points
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import count_of, require, require_one_of, unmasked

MIN_FOUND_SEEDS = 0.5  # share of the seeds that must be found by searching


@unmasked("reference", "deformed")
@one_blas_thread()
def dic(
    reference: npt.NDArray[Any],
    deformed: npt.NDArray[Any],
    *,
    subset: int = 31,
    step: int = 10,
    roi: tuple[int, int, int, int] | None = None,
    points: npt.ArrayLike | None = None,
    guess: npt.ArrayLike | DicResult | None = None,
    start: Start = "auto",
    search_px: int = 20,
    shape: Shape = "affine",
    window: Window | npt.ArrayLike = "square",
    mask: Bool | None = None,
    saturation: float | None = None,
    blur_px: float = 0.0,
    tolerance: float = 1e-4,
    max_iterations: int = 80,
    min_zncc: float = 0.8,
    apart_px: float = 0.1,
    device: Device | None = None,
    backend: str = "auto",
) -> DicResult:
    """Measure how ``reference`` moved to become ``deformed``.

    Parameters
    ----------
    reference, deformed : (H, W) or, in colour, (H, W, 3): the luminance. NaN and inf aren't used.
    subset : odd width of the square subsets, px.
    step : distance of the grid points, px (without ``points``).
    roi : (x0, y0, x1, y1), pixels included; the grid's subsets stay inside. Default: all.
    points : (M, 2) positions x, y in the reference, any fraction of a pixel, instead of a grid.
    guess : (2,) or (M, 2) px to start from, or an earlier result at the points; None: ``start``.
    start : how seeds are found. "search": to +-``search_px`` around no displacement and
        that of most of the picture; "features": matched features, for any distance and rotation;
        "auto": features where the search finds less than half of the seeds.
    shape : how a subset deforms: "translation", "rigid", "affine" or "quadratic".
    window : weights of the subset's pixels: "square", "round" or (subset, subset) in 0..1.
    mask : (H, W) bool, False = pixel that isn't used, nor are those within 1 px + 2 ``blur_px``.
    saturation : lowest grey level that counts as saturated; None: full scale of 8, 10, 12, 14 or
        16 bits if an integer image reaches it. Only areas wider than 0.4 subsets are left out.
    blur_px : standard deviation of a Gaussian over both images; 1 px takes most error off edges.
    tolerance : the iteration stops when no pixel of the subset has further to go than this, px, as
        the last steps shrink; or than a tenth of the standard uncertainty, where noise is stronger.
    max_iterations : under noise, where steps shrink slowly, ``blur_px`` of 1 px helps more.
    min_zncc : matches below are reported as ``LOW_CORRELATION``.
    apart_px : subsets ("affine", "quadratic") of which a ninth moved further from the rest, px, or
        doesn't match, are ``INCOHERENT``: they see an edge, a hole or a crack. inf: not looked at.
    backend, device : "auto": on the device (None: the process-wide one) where an adapter is found,
        else by the NumPy twins, with one warning; "gpu", "numpy": there or not at all.

    Raises
    ------
    InputError
        An argument is wrong. A point that can't be measured is no error: see ``status``.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> result = gs.measure.dic(before, after, points=[[80, 60]], backend="numpy")
    >>> result.displacement.round(2) + 0.0
    array([[0.25, 0.  ]])
    """
    device = working_device("dic", backend, device)
    settings = make_settings(
        subset, window, shape=shape, tolerance=tolerance, max_iterations=max_iterations,
        min_zncc=min_zncc, max_move=float(subset), apart_px=apart_px, blur_px=blur_px,
    )  # fmt: skip
    first = masked_image(reference, "reference", subset, mask, saturation)
    second = masked_image(deformed, "deformed", subset, None, saturation)
    allowed = check_mask(first.good, first.image, blur_px)
    require_one_of("start", start, get_args(Start))
    positions = given_or_grid(points, first.image.shape, subset=subset, step=step, roi=roi)
    begin = None if guess is None else _check_guess(guess, positions, settings)
    images, near = (first.image, second.image), _reach(begin, count_of("search_px", search_px))
    front = CheckedFront(images, positions, settings, allowed, blur_px, near, device)
    matches = _measure_all(front, begin, isinstance(guess, DicResult), start, int(search_px))
    name_failures(matches, positions, settings, first, second)
    widening = noise_factor(front.pair.reference, positions, settings.half, blur_px)
    return make_result(positions, matches, subset, widening)


def _measure_all(
    front: CheckedFront, begin: Float | None, earlier: bool, start: Start, search_px: int
) -> Correlation:
    """Measure every point: from guesses ``begin`` (M, 2, 3), those of an ``earlier`` image or of
    the caller, or from seeds; then from neighbours, as far as that leads."""
    known = np.zeros(0, dtype=np.int64)
    if begin is not None:
        known = np.flatnonzero(np.isfinite(begin).all(axis=(1, 2)))
        front.attempt(known, begin[known, :, 0], begin[known, :, 1:3])
    if begin is None or (earlier and not _found(front, known) >= MIN_FOUND_SEEDS):
        _seed(front, start, search_px)
    front.give_up_plain()
    front.propagate()
    if front.extend_deformed():
        front.propagate()
    if begin is None:
        unreached = np.flatnonzero(front.matches.status == Status.NO_GUESS)
        if unreached.size:
            front.search(unreached, search_px, np.zeros(2))
            front.propagate()
    else:
        # nothing led there; let the kernel say if it could have been measured at all
        untried = np.flatnonzero(front.matches.status == Status.NO_GUESS)
        front.attempt(untried, np.zeros((untried.size, 2)), keep=False)
    front.retry_with_tolerances()
    front.recheck_outliers()
    front.reject_discontinuities()
    return front.matches


def _seed(front: Front, start: Start, search_px: int) -> None:
    """Measure a coarse lattice of points without knowing where they went."""
    open_ = np.flatnonzero(~front.closed)
    chosen = open_[seeds(front.points[open_], front.spacing)]
    if start != "features":
        front.search_seeds(chosen, search_px)
        if _found(front, chosen) < MIN_FOUND_SEEDS:
            shift = global_shift(*front.images)
            if np.abs(shift).max() > 0:
                front.take_whole_image()
                front.search(chosen[~front.ok[chosen]], search_px, shift)
    if start == "features" or (start == "auto" and _found(front, chosen) < MIN_FOUND_SEEDS):
        front.start_from_features(chosen[~front.ok[chosen]], feature_motions(*front.images))


def _found(front: Front, chosen: Long) -> float:
    """Share of the points that have a texture which have been measured; 0 if there are none."""
    open_ = chosen[front.measurable[chosen]]
    return float(front.ok[open_].mean()) if open_.size else 0.0


def _check_guess(guess: npt.ArrayLike | DicResult, points: Float, settings: Settings) -> Float:
    """Coefficients (M, 2, 3) to start from, NaN where there are none."""
    begin = np.zeros((len(points), 2, 3))
    if isinstance(guess, DicResult):
        fits = guess.points.shape == points.shape and np.array_equal(guess.points, points)
        expected = f"one at the same {len(points)} points"
        require(fits, "guess", f"a result of {len(guess.points)} points", expected)
        begin[:, :, 0] = guess.displacement
        begin[:, :, 1:3] = guess.gradient * settings.half
        return begin
    values = np.asarray(guess, dtype=np.float64)
    if values.shape not in ((2,), points.shape) or not np.isfinite(values).all():
        raise InputError(f"guess: got shape {values.shape}; expected finite (2,) or {points.shape}")
    begin[:, :, 0] = values
    return begin


def _reach(begin: Float | None, search_px: int) -> float:
    """How far a match may be at the start, px: as far as is searched, or as the largest guess."""
    motion = 0.0 if begin is None else np.nan_to_num(np.abs(begin[:, :, 0])).max(initial=0.0)
    return max(float(search_px), float(motion))


def given_or_grid(
    points: npt.ArrayLike | None,
    image_shape: tuple[int, ...],
    *,
    subset: int,
    step: int,
    roi: tuple[int, int, int, int] | None,
) -> Float:
    """The caller's positions (M, 2), checked, or those of a grid."""
    if points is not None:
        return check_points(points, "points")
    return grid_points(image_shape, subset=subset, step=step, roi=roi)


def grid_points(
    image_shape: tuple[int, ...],
    *,
    subset: int,
    step: int,
    roi: tuple[int, int, int, int] | None = None,
) -> Float:
    """Grid positions (M, 2), row by row, whose subsets lie in the region of interest.

    Examples
    --------
    >>> gs.measure.grid_points((60, 80), subset=31, step=20)
    array([[15., 15.],
           [35., 15.],
           [55., 15.],
           [15., 35.],
           [35., 35.],
           [55., 35.]])
    """
    step = count_of("step", step)
    height, width = image_shape
    corners = np.asarray((0, 0, width - 1, height - 1) if roi is None else roi)
    if corners.shape != (4,) or corners.dtype.kind not in "iu":
        raise InputError(f"roi: got {roi!r}; expected (x0, y0, x1, y1) in whole pixels")
    x0, y0, x1, y1 = corners.tolist()
    if not (0 <= x0 <= x1 < width and 0 <= y0 <= y1 < height):
        raise InputError(
            f"roi: got {roi}; expected (x0, y0, x1, y1) inside the image of {width}x{height} px"
        )
    half = subset // 2
    columns = np.arange(x0 + half, x1 - half + 1, step, dtype=np.float64)
    rows = np.arange(y0 + half, y1 - half + 1, step, dtype=np.float64)
    fits = columns.size > 0 and rows.size > 0
    expected = f"at least {subset}x{subset}"
    require(fits, "roi: holds no subset", f"{x1 - x0 + 1}x{y1 - y0 + 1} px", expected)
    x, y = np.meshgrid(columns, rows)
    return np.column_stack([x.ravel(), y.ravel()])
