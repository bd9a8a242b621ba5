"""Correlation of a series of images with one reference, or with references that follow it.

A subset that has stretched, turned or changed its look too much no longer matches the first image.
The series then goes on from the last image that did: the points move there with their subsets, and
displacements and deformation gradients are put together step by step. Every such step adds its
own error, so the reference is kept as long as it does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeVar, get_args

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.choices import Update as Update
from gpusim.errors import InputError
from gpusim.measure.correlation.dic import dic, grid_points
from gpusim.measure.correlation.matching import DicResult, Status
from gpusim.measure.images import check_points
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import require, require_one_of, unmasked

Result = TypeVar("Result")
LOST = 0.03  # share of the points that may get lost before the reference is renewed


@dataclass(frozen=True)
class _Base:
    """A reference image, and what had happened to the points when it was taken."""

    image: npt.NDArray[Any]
    points: Float  # (K, 2) where they are in it
    which: Long  # (K,) rows of the series' points
    displacement: Float  # (K, 2) from the first image to this one
    deformation: Float  # (K, 2, 2) deformation gradients to this one
    variance: Float  # (K,)
    mask: Bool | None


@unmasked("reference", "images")
@one_blas_thread()
def dic_sequence(
    reference: npt.NDArray[Any],
    images: Iterable[npt.NDArray[Any]],
    *,
    update: Update = "never",
    update_zncc: float = 0.9,
    subset: int = 31,
    step: int = 10,
    roi: tuple[int, int, int, int] | None = None,
    points: npt.ArrayLike | None = None,
    mask: Bool | None = None,
    progress: Callable[[int, DicResult], None] | None = None,
    keep_results: bool = True,
    **options: Any,
) -> list[DicResult]:
    """Measure each of ``images`` against ``reference``; every image starts from the one before.

    Parameters
    ----------
    reference, subset, step, roi, points, mask : as for ``dic``; all results are at the same points.
    images : read one at a time, in the order in which they were taken.
    update : "never": all against the first image; "auto": against the image before as soon as
        the median correlation falls below ``update_zncc`` or more than 3 % of the points get
        lost; "always": every image against the one before.
    progress : called with each image's number and result.
    keep_results : return all results; False: the last one alone. A long series is then taken from
        ``progress``, and needs no more memory than a short one.
    options : anything else that ``dic`` takes.

    Returns
    -------
    One result per image, in terms of the first reference. ``sigma`` adds up over the updates; a
    point that was lost at an update stays lost, with the reason it had then.

    Raises
    ------
    InputError
        As ``dic``, or ``update`` or ``update_zncc`` is out of range.

    Examples
    --------
    >>> before, after = (gs.export.read_image(f"{name}.png") for name in ("before", "after"))
    >>> images, options = [before, after], {"points": [[80, 60]], "backend": "numpy"}
    >>> gs.measure.dic_sequence(before, images, **options)[-1].displacement.round(2) + 0.0
    array([[0.25, 0.  ]])
    """
    if points is not None:
        places = check_points(points, "points")
    elif np.ndim(reference) in (2, 3):
        places = grid_points(np.shape(reference)[:2], subset=subset, step=step, roi=roi)
    else:
        raise InputError(
            f"reference: not one image; got shape {np.shape(reference)}; expected (H, W), or "
            "(H, W, 3) in colour"
        )
    found = followed(
        reference, images, places, update=update, update_zncc=update_zncc, subset=subset, mask=mask,
        **options,
    )  # fmt: skip
    return gathered(found, progress, keep_results)


def gathered(
    found: Iterable[Result],
    progress: Callable[[int, Result], None] | None,
    keep_results: bool = True,
) -> list[Result]:
    """All results, or the last one alone; ``progress`` is told of each as soon as it is there."""
    results: list[Result] = []
    for number, result in enumerate(found):
        results.append(result)
        if progress is not None:
            progress(number, result)
        if not keep_results:
            del results[:-1]
    return results


def followed(
    reference: npt.NDArray[Any],
    images: Iterable[npt.NDArray[Any]],
    places: Float,
    *,
    update: Update = "never",
    update_zncc: float = 0.9,
    subset: int = 31,
    mask: Bool | None = None,
    **options: Any,
) -> Iterator[DicResult]:
    """What `dic_sequence` gives at ``places`` (M, 2), one result after the other."""
    require_one_of("update", update, get_args(Update))
    require(-1 <= update_zncc <= 1, "update_zncc", repr(update_zncc), "-1..1")
    count = len(places)
    straight = np.tile(np.eye(2), (count, 1, 1))
    base = _Base(
        reference, places, np.arange(count), np.zeros((count, 2)), straight, np.zeros(count), mask
    )
    total: DicResult | None = None
    last: tuple[npt.NDArray[Any], DicResult] | None = None  # the image before, from its base
    for image in images:
        guess = None if last is None else last[1]
        matched = _measured(base, image, guess, subset, options)
        if last is not None and _due(update, update_zncc, matched, last[1]):
            base = _moved(base, *last, mask, places)
            matched = _measured(base, image, None, subset, options)
        total = _total(base, matched, places, total)
        yield total
        last = image, matched


def _measured(
    base: _Base,
    image: npt.NDArray[Any],
    guess: DicResult | None,
    subset: int,
    options: dict[str, Any],
) -> DicResult:
    given = {"guess": guess} if guess is not None and guess.ok.any() else {}
    return dic(
        base.image, image, subset=subset, points=base.points, mask=base.mask, **(options | given)
    )


def _due(update: Update, update_zncc: float, matched: DicResult, before: DicResult) -> bool:
    """Whether to go on from the image before, which has been measured well enough."""
    if update == "never" or not before.ok.any():
        return False
    if update == "always" or not matched.ok.any():
        return True
    lost = before.ok.sum() - matched.ok.sum() > LOST * len(matched.points)
    return bool(lost or float(np.median(matched.zncc[matched.ok])) < update_zncc)


def _moved(
    base: _Base,
    image: npt.NDArray[Any],
    matched: DicResult,
    mask: Bool | None,
    places: Float,
) -> _Base:
    """The image as the new reference, with the points that were measured in it."""
    ok = matched.ok
    deformation = (np.eye(2) + matched.gradient[ok]) @ base.deformation[ok]
    displacement = base.displacement[ok] + matched.displacement[ok]
    which = base.which[ok]
    points = places[which] + displacement
    moved = None
    if mask is not None:
        moved = _moved_mask(mask, np.shape(image)[:2], places[which], points, deformation)
    variance = base.variance[ok] + matched.sigma[ok] ** 2
    return _Base(image, points, which, displacement, deformation, variance, moved)


def _moved_mask(
    mask: Bool,
    shape: tuple[int, ...],
    first: Float,
    points: Float,
    deformation: Float,
) -> Bool:
    """The mask of the first image as it lies in a later one: each pixel goes back with the
    nearest point; beyond the first image nothing is masked."""
    row, column = np.indices(shape)
    pixels = np.column_stack([column.ravel(), row.ravel()]).astype(np.float64)
    nearest = np.asarray(scipy.spatial.cKDTree(points).query(pixels)[1], dtype=np.int64)
    back = np.linalg.inv(deformation)[nearest]
    origin = first[nearest] + np.einsum("nij,nj->ni", back, pixels - points[nearest])
    x, y = np.rint(origin).astype(np.int64).T
    height, width = mask.shape
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    result = np.ones(x.size, dtype=bool)
    result[inside] = mask[y[inside], x[inside]]
    return result.reshape(shape)


def _total(base: _Base, matched: DicResult, places: Float, before: DicResult | None) -> DicResult:
    """The result in terms of the first reference."""
    count, which = len(places), base.which
    status = np.full(count, Status.NO_GUESS, dtype=np.int8)
    if before is not None and len(which) < count:
        status = np.where(before.ok, Status.NO_GUESS, before.status).astype(np.int8)
    status[which] = matched.status
    iterations = np.zeros(count, dtype=np.int32)
    iterations[which] = matched.iterations

    def every(values: Float) -> Float:
        result = np.full((count, *values.shape[1:]), np.nan)
        result[which] = values
        return result

    return replace(
        matched,
        points=places,
        displacement=every(base.displacement + matched.displacement),
        gradient=every((np.eye(2) + matched.gradient) @ base.deformation - np.eye(2)),
        zncc=every(matched.zncc),
        sigma=every(np.sqrt(base.variance + matched.sigma**2)),
        iterations=iterations,
        status=status,
    )
