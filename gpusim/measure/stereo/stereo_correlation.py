"""Stereo correlation: shape, displacement and strain of a surface from two calibrated cameras.

The left reference image is matched with the right one once, then each camera's images are tracked
in time, and the two tracks of a point are triangulated.
Coordinates are those of the rig: the first camera's axes (x right, y down, z forward), in the unit
of the baseline.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.gpu import Device, working_device
from gpusim.measure.calibration.calibration import CalibratedCamera
from gpusim.measure.correlation.dic import given_or_grid
from gpusim.measure.correlation.matching import (
    DicResult,
    PointResult,
    Status,
    make_settings,
    noise_factor,
)
from gpusim.measure.correlation.pixel_mask import check_mask, masked_image, name_failures
from gpusim.measure.correlation.sequence import Update, followed, gathered
from gpusim.measure.correlation.warp import Shape
from gpusim.measure.images import SplineImage
from gpusim.measure.stereo.epipolar_matching import match_views, paired_epipolar_distance
from gpusim.measure.stereo.triangulation import check_calibrated, triangulate
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, unmasked

Cameras = tuple[CalibratedCamera, CalibratedCamera]


@dataclass(frozen=True)
class StereoResult(PointResult):
    """M points of a surface. Only points with status ``OK`` carry numbers, the others NaN.

    Attributes
    ----------
    points : (M, 2) float64, x, y in the left reference image, px.
    left, right : (M, 2) float64, where each point is seen now, px.
    shape : (M, 3) float64, position in the reference state, rig coordinates.
    displacement : (M, 3) float64, from there to now.
    sigma : (M, 3) float64, standard uncertainty of the position now along the rig's axes, from
        the noise of the images (not of the calibration).
    residual : (M,) float64, RMS distance between where the point is seen and where the
        triangulated one projects to, px.
    status : (M,) int8, values of ``Status``.
    subset : width of the subsets, px.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.02)]
    >>> left, right = (gs.export.read_image(f"{name}.png") for name in ("left", "right"))
    >>> result = gs.measure.stereo_shape(left, right, rig, points=[[80, 60]], backend="numpy")
    >>> result.shape.shape, bool(result.ok[0])
    ((1, 3), True)
    """

    points: Float
    left: Float
    right: Float
    shape: Float
    displacement: Float
    sigma: Float
    residual: Float
    status: npt.NDArray[np.int8]
    subset: int
    __repr__ = field_summary

    @property
    def position(self) -> Float:
        """(M, 3) float64, where each point is now."""
        return self.shape + self.displacement


def _check_pair(cameras: Cameras) -> None:
    require(len(cameras) == 2, "cameras", len(cameras), "the left and the right one")
    check_calibrated(cameras)


@unmasked("left", "right")
@one_blas_thread()
def stereo_shape(
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    cameras: Cameras,
    *,
    subset: int = 31,
    step: int = 10,
    roi: tuple[int, int, int, int] | None = None,
    points: npt.ArrayLike | None = None,
    mask: Bool | None = None,
    match_shape: Shape = "quadratic",
    epipolar_px: float = 1.0,
    saturation: float | None = None,
    blur_px: float = 0.0,
    tolerance: float = 1e-4,
    max_iterations: int = 60,
    min_zncc: float = 0.8,
    device: Device | None = None,
    backend: str = "auto",
) -> StereoResult:
    """Measure the shape of a surface from one pair of images; displacements are zero.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) images of the two cameras, sizes may differ.
    cameras : the two, as ``calibrate`` returns them or ``rig_camera`` makes them from arrays.
    match_shape : how a subset deforms between the views; "quadratic" follows perspective.
    epipolar_px : pairs further from the epipolar constraint are wrong (``EPIPOLAR``).
    others : as for ``dic``, in the left image.

    Raises
    ------
    InputError
        An argument is wrong. A point that can't be measured is no error: see ``status``.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.02)]
    >>> left, right = (gs.export.read_image(f"{name}.png") for name in ("left", "right"))
    >>> result = gs.measure.stereo_shape(left, right, rig, points=[[80, 60]], backend="numpy")
    >>> print(f"{result.shape[0, 2]:.2f} from the left camera")
    1.00 from the left camera
    """
    _check_pair(cameras)
    require(0 < epipolar_px < np.inf, "epipolar_px", repr(epipolar_px), "px > 0")
    settings = make_settings(
        subset, "square", shape=match_shape, tolerance=tolerance, max_iterations=max_iterations,
        min_zncc=min_zncc, max_move=float(subset), blur_px=blur_px,
    )  # fmt: skip
    device = working_device("stereo_shape", backend, device)
    first = masked_image(left, "left", subset, mask, saturation)
    second = masked_image(right, "right", subset, None, saturation)
    places = given_or_grid(points, first.image.shape, subset=subset, step=step, roi=roi)
    matches = match_views(
        first.image,
        second.image,
        places,
        cameras,
        settings,
        check_mask(first.good, first.image, blur_px),
        blur_px,
        epipolar_px,
        device,
    )
    name_failures(matches, places, settings, first, second)
    places_right = places + matches.coefficients[:, :, 0]
    # both images count alike, as they do later: what the calibration leaves between the rays is
    # split in the same way in every state and cancels in the displacement
    sigma_right = matches.sigma
    if blur_px > 0:
        blurred = SplineImage.from_image(first.image, blur_px=blur_px)
        sigma_right = sigma_right * noise_factor(blurred, places, settings.half, blur_px)
    sigma = np.stack([sigma_right, sigma_right])
    return paired_result(cameras, places, places, places_right, sigma, matches.status, None, subset)


@unmasked("left", "right", "lefts", "rights")
@one_blas_thread()
def stereo_dic(
    left: npt.NDArray[Any],
    right: npt.NDArray[Any],
    lefts: Iterable[npt.NDArray[Any]],
    rights: Iterable[npt.NDArray[Any]],
    cameras: Cameras,
    *,
    subset: int = 31,
    shape: Shape = "affine",
    epipolar_px: float = 1.0,
    match_shape: Shape = "quadratic",
    step: int = 10,
    roi: tuple[int, int, int, int] | None = None,
    points: npt.ArrayLike | None = None,
    mask: Bool | None = None,
    mask_right: Bool | None = None,
    update: Update = "never",
    saturation: float | None = None,
    blur_px: float = 0.0,
    tolerance: float = 1e-4,
    min_zncc: float = 0.8,
    device: Device | None = None,
    backend: str = "auto",
    progress: Callable[[int, StereoResult], None] | None = None,
    keep_results: bool = True,
    **options: Any,
) -> list[StereoResult]:
    """Measure how a surface moved in space.

    Parameters
    ----------
    left, right : the reference pair.
    lefts, rights : pairs of the following states, read one at a time.
    cameras, match_shape, epipolar_px, subset, step, roi, points, mask : as for ``stereo_shape``.
    mask_right : (H, W) bool, False = pixel of the right reference image that isn't followed.
    shape, update, progress, keep_results, options : as for ``dic_sequence``, by which each camera
        is tracked.

    Returns
    -------
    One result per pair, all at the same points of the left reference image.

    Raises
    ------
    InputError
        As ``stereo_shape`` and ``dic_sequence``, or the numbers of images differ.

    Examples
    --------
    >>> K = [[800, 0, 79.5], [0, 800, 59.5], [0, 0, 1]]
    >>> rig = [gs.measure.rig_camera((160, 120), K, t=(x, 0, 0)) for x in (0, -0.02)]
    >>> read = lambda name: gs.export.read_image(f"{name}.png")
    >>> pairs = read("left"), read("right"), [read("left-1")], [read("right-1")]
    >>> (moved,) = gs.measure.stereo_dic(*pairs, rig, points=[[80, 60]], backend="numpy")
    >>> moved.displacement.round(4) + 0.0
    array([[0.001, 0.   , 0.   ]])
    """
    device = working_device("stereo_dic", backend, device)
    common: dict[str, Any] = {
        "subset": subset, "saturation": saturation, "blur_px": blur_px, "tolerance": tolerance,
        "min_zncc": min_zncc, "device": device, "backend": "numpy" if device is None else "gpu",
    }  # fmt: skip
    begin = stereo_shape(
        left, right, cameras, step=step, roi=roi, points=points, mask=mask,
        match_shape=match_shape, epipolar_px=epipolar_px, **common,
    )  # fmt: skip
    known = np.flatnonzero(begin.ok)
    both: dict[str, Any] = {**common, "shape": shape, "update": update, **options}
    ones = followed(left, lefts, begin.left[known], mask=mask, **both)
    twos = followed(right, rights, begin.right[known], mask=mask_right, **both)

    found = moved_pairs(cameras, begin, ones, twos, epipolar_px)
    return gathered(found if known.size else (begin for _ in lefts), progress, keep_results)


def moved_pairs(
    cameras: Cameras,
    begin: StereoResult,
    ones: Iterable[DicResult],
    twos: Iterable[DicResult],
    epipolar_px: float,
) -> Iterator[StereoResult]:
    """The tracks of both cameras put together, which are of the points that are OK in ``begin``."""
    known = np.flatnonzero(begin.ok)
    for one, two in zip_longest(ones, twos):
        if one is None or two is None:
            raise InputError("lefts, rights: got more images of one camera; expected pairs")
        yield _moved(cameras, begin, known, one, two, epipolar_px)


def _moved(
    cameras: Cameras,
    begin: StereoResult,
    known: Long,
    one: DicResult,
    two: DicResult,
    epipolar_px: float,
) -> StereoResult:
    """Put the two tracks of a state together."""
    places_left = np.full_like(begin.left, np.nan)
    places_right = np.full_like(begin.right, np.nan)
    sigma = np.full((2, len(places_left)), np.nan)
    status = begin.status.copy()
    places_left[known] = one.points + one.displacement
    places_right[known] = two.points + two.displacement
    sigma[:, known] = np.sqrt(0.5 * (one.sigma**2 + two.sigma**2))
    status[known] = np.where(one.ok, two.status, one.status)
    good = np.flatnonzero(status == Status.OK)
    miss = paired_epipolar_distance(cameras, places_left[good], places_right[good])
    status[good[~(miss <= epipolar_px)]] = Status.EPIPOLAR
    return paired_result(
        cameras, begin.points, places_left, places_right, sigma, status, begin.shape, begin.subset
    )


def paired_result(
    cameras: Cameras,
    points: Float,
    places_left: Float,
    places_right: Float,
    sigma: Float,
    status: npt.NDArray[np.int8],
    shape: Float | None,
    subset: int,
) -> StereoResult:
    """Positions in space of what both cameras see; ``shape`` None: this is the reference."""
    good = status == Status.OK
    seen = np.where(good[None, :, None], np.stack([places_left, places_right]), np.nan)
    # images without noise have no sigma: any number will do
    noise = np.where(good & (sigma > 1e-9), sigma, 1e-9)
    triangulated = triangulate(cameras, seen, sigma_px=noise)
    spread = np.sqrt(np.einsum("mii->mi", triangulated.covariance))
    status = status.copy()
    status[good & ~np.isfinite(triangulated.points).all(axis=1)] = Status.EPIPOLAR
    bad = status != Status.OK

    def known(values: Float) -> Float:
        return np.where(bad if values.ndim == 1 else bad[:, None], np.nan, values)

    position = known(triangulated.points)
    origin = position if shape is None else known(shape)
    return StereoResult(
        points=points,
        left=known(seen[0]),
        right=known(seen[1]),
        shape=origin,
        displacement=position - origin,
        sigma=known(spread),
        residual=known(triangulated.residual),
        status=status,
        subset=subset,
    )
