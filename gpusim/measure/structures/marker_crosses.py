"""Crosses of markers near known places: located, then fitted to a thousandth of a pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.measure.targets.checker_markers import Markers, MarkerStatus, locate_markers
from gpusim.measure.targets.crossings import fit_crossings

SEARCH_SHARE = 0.5  # of a marker's width, around where the rough camera expects it
LEAST_WIDTH = 10.0  # px; a marker's cross can't be fitted in less
SIZES = (0.5, 1.3)  # of the width that a marker has when it is seen from the front
ALIKE = 0.08  # logarithm of the ratio of widths that are looked for together
FIRST_SHARE = 0.6  # of a marker's half width that a first fit of its cross looks at
END_MARGIN = 1.2, 2.5  # px, and lens blurs, kept from a marker's own border


@dataclass(frozen=True, eq=False)
class CrossFits:
    """M markers, px; NaN where there is none.

    ``points`` (M, 2); ``arms`` (M, 2, 2), half widths along both borders; ``blur`` (M,) of the
    lens; ``sigma`` (M,), standard uncertainty; ``rough`` (M,) bool: only located, because the fit
    of the cross didn't settle.
    """

    points: Float
    arms: Float
    blur: Float
    sigma: Float
    rough: Bool

    @property
    def known(self) -> Bool:
        """(M,) bool: seen."""
        return np.asarray(np.isfinite(self.points).all(axis=1))

    def rows(self, chosen: Long | Bool) -> CrossFits:
        """Some of them."""
        return CrossFits(*(values[chosen] for values in vars(self).values()))

    def where(self, kept: Bool, others: CrossFits) -> CrossFits:
        """Those that are ``kept`` (M,), and ``others`` in place of the rest."""
        pairs = zip(vars(self).values(), vars(others).values(), strict=True)
        return CrossFits(*(np.where(kept, a.T, b.T).T for a, b in pairs))


def size_range(width: float, sizes: tuple[float, float] = SIZES) -> tuple[float, float]:
    """Lowest and highest width (px) of a marker that is ``width`` px wide from the front."""
    return max(LEAST_WIDTH, sizes[0] * width), sizes[1] * width


def find_crosses(
    image: npt.NDArray[Any],
    near: Float,
    widths: Float,
    share: float = SEARCH_SHARE,
    sizes: tuple[float, float] = SIZES,
) -> CrossFits:
    """Find the markers that are about ``widths`` (M,) px wide near the places (M, 2): at most a
    ``share`` of their width away, and of ``sizes`` times it."""
    points, arms = np.full_like(near, np.nan), np.full((len(near), 2, 2), np.nan)
    seen = np.isfinite(near).all(axis=1)
    # markers of about the same size together; which sizes are near one doesn't depend on the others
    kind = np.where(seen, np.round(np.log(widths) / ALIKE), np.nan)
    for one in np.unique(kind[seen]):
        rows, width = np.flatnonzero(kind == one), float(np.exp(ALIKE * one))
        located = locate_markers(image, near[rows], size_range(width, sizes), share * width)
        hit = located.status == MarkerStatus.FOUND
        points[rows[hit]] = located.points[hit]
        arms[rows[hit]] = arms_of(located)[hit]
    fine, sigma, blur = fit_crosses(image, points, arms)
    fitted = np.isfinite(fine)
    rough = np.asarray((np.isfinite(points) & ~fitted).all(axis=1))
    return CrossFits(np.where(fitted, fine, points), arms, blur, sigma, rough)


def fit_crosses(
    image: npt.NDArray[Any], near: Float, arms: Float, blur: Float | None = None
) -> tuple[Float, Float, Float]:
    """Centres (M, 2) by a fit of each cross, their standard uncertainty and the lens blur (M,).

    Where the ``blur`` isn't known, a first fit tells it, and with it how close to a marker's own
    border the last one may look.
    """
    points = np.full_like(near, np.nan)
    sigma, found = np.full((2, len(near)), np.nan)
    rows = np.flatnonzero(np.isfinite(near).all(axis=1) & np.isfinite(arms).all(axis=(1, 2)))
    if rows.size:
        fit = fit_crossings(
            image, near[rows], arms[rows, 0], arms[rows, 1], share=FIRST_SHARE,
            margin=END_MARGIN, blur=None if blur is None else np.nan_to_num(blur[rows]),
        )  # fmt: skip
        points[rows], sigma[rows], found[rows] = fit.points, fit.sigma, fit.blur
    return points, sigma, found


def arms_of(located: Markers) -> Float:
    """Half widths (M, 2, 2) along both borders, px."""
    half, turn = 0.5 * located.size, located.angle
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.stack([half[:, :1] * along, half[:, 1:] * across], axis=1)
