"""What goes into matching subsets and what comes out, whichever way they are matched.

A blur G takes white noise n to G n: its variance shrinks to the sum of G's squares, and so does
what a match leaves as residuals. But neighbouring pixels now err together, and a displacement comes
from sums over many: with the slopes J of the blurred image its variance is J^T G G^T J over
(J^T J)^2, times that of the noise, where independent residuals would give 1 over J^T J
(`noise_factor`).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from math import sqrt
from typing import TYPE_CHECKING, Any, Literal

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float, Int
from gpusim.display import notebook_html, plotted
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.measure.correlation.warp import SHAPES, UNKNOWNS, Shape
from gpusim.measure.images import BLUR_REACH, SplineImage
from gpusim.validation import require, require_one_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Window = Literal["square", "round"]

# sum of squares of the slope filter: an impulse's `SplineImage.pixel_gradients`
SLOPE_NOISE = 1.89396
MIN_BLUR = 0.5  # px: it takes noise off the slopes
MIN_SHARE = 1e-3  # of the slopes' energy that a second blur leaves


class Status(IntEnum):
    """What became of a point. Only ``OK`` points carry numbers; the others are NaN.

    Examples
    --------
    >>> flat = np.full((64, 64), 128, np.uint8)
    >>> result = gs.measure.dic(flat, flat, points=[[32, 32]], backend="numpy")
    >>> gs.measure.Status(result.status[0]).name
    'NO_TEXTURE'
    """

    OK = 0
    OUTSIDE = 1  # its subset leaves one of the images
    NO_TEXTURE = 2  # nothing in the subset tells the motion
    NOT_CONVERGED = 3
    LOW_CORRELATION = 4
    NO_GUESS = 5  # never reached: no start value nearby
    BACKWARD = 6  # tracking back from the deformed image doesn't return to the point
    AMBIGUOUS = 7  # another point, elsewhere before, was tracked to the same place
    MASKED = 8  # its subset is masked, or not a number, for the most part
    SATURATED = 9  # its subset lies in an area at full scale, here or where it went
    EPIPOLAR = 10  # the two cameras of a pair don't see it on matching lines
    INCOHERENT = 11  # parts of its subset move differently, or don't match: an edge, a crack


@dataclass(frozen=True)
class Settings:
    """How subsets are matched.

    window : (S, S) float64 weights in 0..1, S odd.
    tolerance : how far a pixel of the subset may still be from where it would end, px.
    max_move : a subset that leaves its start by more than this has diverged, px.
    apart_px : how far parts of a subset may move apart, px; see ``subset_consistency``.
    slope_noise : variance of the spline's slope at a pixel for white noise of variance 1.
    """

    window: Float
    shape: Shape = "affine"
    tolerance: float = 1e-4
    max_iterations: int = 40
    min_zncc: float = 0.8
    max_move: float = 10.0
    apart_px: float = 0.1
    slope_noise: float = SLOPE_NOISE

    def __post_init__(self) -> None:
        window, most = self.window, self.max_iterations
        require(0 < self.tolerance < 1, "tolerance", repr(self.tolerance), "0 < tolerance < 1 px")
        if not isinstance(most, (int, np.integer)) or most < 1:
            raise InputError(f"max_iterations: got {most!r}; expected a whole number >= 1")
        require(-1 <= self.min_zncc <= 1, "min_zncc", repr(self.min_zncc), "-1..1")
        require(0 < self.max_move < np.inf, "max_move", repr(self.max_move), "px > 0")
        require(self.apart_px > 0, "apart_px", repr(self.apart_px), "px > 0, or inf")
        require_one_of("shape: unknown shape function", self.shape, SHAPES)
        size = len(window)
        fits = window.shape == (size, size) and size % 2 == 1 and size >= 5
        require(fits, "window: wrong shape", window.shape, "(S, S), S odd, at least 5")
        if not (np.isfinite(window).all() and window.min() >= 0 and 0 < window.max() <= 1):
            raise InputError("window: weights out of range; expected 0..1, not all 0")
        if window.sum() <= UNKNOWNS[self.shape] + 2:
            raise InputError("window: too few pixels with weight for the unknowns of the shape")

    @property
    def half(self) -> int:
        """Half width of the subset: it spans 2 half + 1 pixels."""
        return len(self.window) // 2


def make_settings(
    subset: int, window: Window | npt.ArrayLike, *, blur_px: float = 0.0, **others: Any
) -> Settings:
    """Settings of square subsets ``subset`` px wide; ``others`` as of `Settings`."""
    # a blur takes noise off the slopes first
    slope_noise = SLOPE_NOISE if blur_px < MIN_BLUR else 0.0
    return Settings(make_window(subset, window), slope_noise=slope_noise, **others)


def make_window(subset: int, window: Window | npt.ArrayLike) -> Float:
    """Weights (subset, subset) in 0..1: all pixels, those of the inscribed disc, or an array."""
    if not isinstance(subset, (int, np.integer)) or subset % 2 == 0 or not 5 <= subset <= 255:
        raise InputError(f"subset: got {subset!r}; expected an odd whole number of px, 5..255")
    if isinstance(window, str):
        if window == "square":
            return np.ones((subset, subset))
        if window == "round":
            offset = np.arange(subset) - subset // 2
            radius = np.hypot(offset[:, None], offset[None, :])
            return (radius <= subset / 2).astype(np.float64)
        raise InputError(f"window: got {window!r}; expected 'square', 'round' or an array")
    weights = np.asarray(window, dtype=np.float64)
    expected = f"({subset}, {subset}) as subset"
    require(weights.shape == (subset, subset), "window: wrong shape", weights.shape, expected)
    return weights.copy()


@dataclass(frozen=True)
class Correlation:
    """Matches of M subsets, raw: coefficients of failed ones are NaN.

    coefficients : (M, 2, 6) float64, px (see ``warp``).
    zncc : (M,) float64, correlation coefficient, NaN where it was never computed.
    sigma : (M,) float64, standard uncertainty of the worse displacement component, px.
    residual : (M,) float64, variance of what the match leaves; the grey range is 1.
    iterations : (M,) int32.      status : (M,) int8, values of ``Status``.
    """

    coefficients: Float
    zncc: Float
    sigma: Float
    residual: Float
    iterations: Int
    status: npt.NDArray[np.int8]

    @staticmethod
    def unmatched(count: int) -> Correlation:
        """``count`` subsets of which nothing is known."""
        return Correlation(
            np.full((count, 2, 6), np.nan),
            np.full(count, np.nan),
            np.full(count, np.nan),
            np.full(count, np.nan),
            np.zeros(count, dtype=np.int32),
            np.full(count, Status.NO_GUESS, dtype=np.int8),
        )

    @property
    def ok(self) -> Bool:
        """(M,) bool: the subsets that were matched."""
        return np.asarray(self.status == Status.OK)

    def put(self, rows: Any, found: Correlation, chosen: Any = slice(None)) -> None:
        """Take over those of the matches ``found`` that are ``chosen``."""
        for field in fields(self):
            getattr(self, field.name)[rows] = getattr(found, field.name)[chosen]

    def refuse(self, rows: Any, status: Any) -> None:
        """Count ``rows`` as failed."""
        self.status[rows] = status
        self.coefficients[rows] = np.nan
        self.sigma[rows] = np.nan
        self.residual[rows] = np.nan


class PointResult:
    """What results at M points share; status 0 is that of a point that was measured."""

    status: npt.NDArray[np.int8]

    @property
    def ok(self) -> Bool:
        """(M,) bool: the points that were measured."""
        return np.asarray(self.status == Status.OK)

    def _repr_html_(self) -> str | None:
        return notebook_html("correlation", self)

    def plot(
        self,
        ax: Axes | None = None,
        *,
        component: str | None = None,
        image: npt.NDArray[Any] | None = None,
        **style: Any,
    ) -> Axes:
        """Draw a map of one component in matplotlib's axes, over the reference ``image`` (H, W)
        or (H, W, 3) if given.

        Components: "u", "v", "magnitude", "sigma", "zncc" of a `DicResult`; "U", "V", "W",
        "magnitude", "Z", "residual" in space; "u", "v", "magnitude", "sigma" of a `MappedResult`;
        "exx", "eyy", "exy", "e1", "e2" (principal) of a `StrainResult`.
        ``style`` goes to what draws the map (``cmap``, ``norm``, ``vmin``). Returns the axes.
        """
        return plotted("correlation", self, ax, component=component, image=image, **style)

    def counts(self) -> dict[str, int]:
        """How many points ended in each status, only those that occur."""
        numbers = {status.name: int((self.status == status).sum()) for status in Status}
        return {name: number for name, number in numbers.items() if number}


@dataclass(frozen=True)
class DicResult(PointResult):
    """Displacement of M points. Only points with status ``OK`` carry numbers, the others NaN.

    Attributes
    ----------
    points : (M, 2) float64, x, y in the reference image, px.
    displacement : (M, 2) float64, where each point went, px.
    gradient : (M, 2, 2) float64, [[du/dx, du/dy], [dv/dx, dv/dy]].
    zncc : (M,) float64, correlation coefficient of the match (also of poor ones).
    sigma : (M,) float64, standard uncertainty of the worse displacement component from the grey
        residuals, px; with a blur, what independent noise before the blur would give. It doesn't
        contain the interpolation's own bias.
    iterations : (M,) int32.
    status : (M,) int8, values of ``Status``.
    subset : width of the subsets, px.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> result = gs.measure.dic(before, after, subset=31, step=20, backend="numpy")
    >>> result.points.shape, bool(result.ok.all())
    ((35, 2), True)
    """

    points: Float
    displacement: Float
    gradient: Float
    zncc: Float
    sigma: Float
    iterations: Int
    status: npt.NDArray[np.int8]
    subset: int
    __repr__ = field_summary


def make_result(points: Float, matches: Correlation, subset: int, widening: Float) -> DicResult:
    """Turn raw matches into the public result; ``widening`` (M,) is the `noise_factor`.

    A match is uncertain in the pixels of the reference; what it says of the deformed image is
    stretched with the subset.
    """
    coefficients = matches.coefficients
    gradient = coefficients[:, :, 1:3] / (subset // 2)
    (a, b), (c, d) = (np.eye(2) + gradient).transpose(1, 2, 0)
    stretch = 0.5 * (np.hypot(a + d, b - c) + np.hypot(a - d, b + c))  # largest singular value
    return DicResult(
        points=points,
        displacement=coefficients[:, :, 0].copy(),
        gradient=gradient,
        zncc=matches.zncc,
        sigma=matches.sigma * stretch * widening,
        iterations=matches.iterations,
        status=matches.status,
        subset=subset,
    )


def noise_factor(blurred: SplineImage, points: Float, half: int, blur_px: float) -> Float:
    """Standard uncertainty over that from the residuals alone, of subsets at ``points`` (M, 2).

    ``blurred`` is the reference after a Gaussian of ``blur_px``. The slopes along the axis that
    fares worse are taken, the window as a square. 1 without a blur.
    """
    if not blur_px > 0:
        return np.ones(len(points))
    reach = int(np.ceil(BLUR_REACH * blur_px))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / blur_px) ** 2)
    kernel /= kernel.sum()
    pixels = blurred.pixels
    height, width = pixels.shape
    column = np.clip(np.rint(points[:, 0]).astype(np.int64) - blurred.origin[0], 0, width - 1)
    row = np.clip(np.rint(points[:, 1]).astype(np.int64) - blurred.origin[1], 0, height - 1)
    left, right = np.maximum(column - half, 0), np.minimum(column + half + 1, width)
    top, bottom = np.maximum(row - half, 0), np.minimum(row + half + 1, height)
    shares = []
    for axis in (0, 1):
        slope = np.gradient(pixels, axis=axis)
        again = scipy.ndimage.gaussian_filter(slope, sqrt(2.0) * blur_px, truncate=BLUR_REACH)
        sums = []
        for product in (slope * again, slope * slope):
            table = cv2.integral(product, sdepth=cv2.CV_64F)
            sums.append(
                table[bottom, right] - table[top, right] - table[bottom, left] + table[top, left]
            )
        shares.append(sums[0] / np.maximum(sums[1], 1e-300))
    share = np.clip(np.maximum(*shares), MIN_SHARE, 1.0)
    return np.asarray(np.sqrt(share) / np.square(kernel).sum())
