"""Measured points that are given up: their subsets see two motions, or have texture to one side.

Only what stands out is looked at, and the neighbours of what is refused.
"""

from __future__ import annotations

from dataclasses import replace
from math import ceil

import numpy as np

from gpusim.arrays.array_types import Bool, Long
from gpusim.arrays.unique import distinct
from gpusim.measure.correlation.icgn import correlate
from gpusim.measure.correlation.image_pair import Subsets
from gpusim.measure.correlation.matching import Status
from gpusim.measure.correlation.propagation import NEIGHBOURS, Front
from gpusim.measure.correlation.subset_consistency import MAX_SPREAD, inconsistent_subsets

OUTLIER_PX = 0.01  # px beyond four standard deviations: further from what a neighbour says, look
# 1 - correlation over the lower quartile of all points
POOR_CORRELATION = 1.5
# square of the standard deviations by which what is left must stand out, too: contrast isn't even
POOR_RESIDUAL = 60.0
# over the jump that is looked for: less change of slopes, px at a subset's rim, is smooth
MIN_SLOPE_CHANGE = 0.5
CENTRE_SHARE = 0.6  # of a subset's width: its middle, asked by itself
# lost neighbours that settle a doubt where noise hardly explains it, else twice as many
MIN_REJECTED_NEIGHBOURS = 3
BESIDE_EDGES = (Status.INCOHERENT, Status.NO_TEXTURE, Status.LOW_CORRELATION, Status.NOT_CONVERGED)
DOUBTFUL_SPREAD = 0.5  # of MAX_SPREAD: what a match says of it needn't be exact
# px times the root of the number of pixels: what noise alone tells is as uncertain as 0.56
DOUBTFUL_SIGMA = 0.3
MANY_STRIPED = 0.1  # share of what was looked at with slopes one way only: look at everything


class CheckedFront(Front):
    """Points in progress, and what is asked of them once they are measured."""

    def reject_discontinuities(self) -> None:
        """Give up subsets that see two motions, or something that isn't in both images.

        Only those are looked at that stand out, and the neighbours of those that are refused.
        """
        if not (self._looks_at_parts and self.ok.any()):
            return
        which, usual = self._outliers(), self._usual()
        one_sided, striped = self._one_sided_matches(which, usual)
        # the pattern itself may have slopes one way only
        if striped.any() and striped.mean() > MANY_STRIPED:
            others = np.setdiff1d(np.flatnonzero(self.ok), which)
            self.matches.refuse(others[self._one_sided(others, usual)[0]], Status.NO_TEXTURE)
        asked, uncertain, likely = np.zeros((3, len(self.points)), dtype=np.bool_)
        while which.size:
            asked[which] = True
            self.matches.refuse(which[one_sided], Status.NO_TEXTURE)
            both = which[~one_sided]
            matched = self.points[both], self.matches.coefficients[both]
            torn, uncertain[both], likely[both] = inconsistent_subsets(
                self.pair, *matched, self.settings, self.blur_px
            )
            self.matches.refuse(both[torn], Status.INCOHERENT)
            if len(self.points) < NEIGHBOURS:
                return
            near = distinct(self._neighbours[which[~self.ok[which]]])
            which = near[self.ok[near] & ~asked[near]]
            one_sided, _ = self._one_sided_matches(which, usual)
        if uncertain.any() and len(self.points) >= NEIGHBOURS:
            self._resolve_uncertain(uncertain & self.ok, likely)

    def _one_sided_matches(self, which: Long, usual: float) -> tuple[Bool, Bool]:
        """`_one_sided` of measured points: of those that their match leaves in doubt.

        With a change of light to be told, too, that says no less of how uncertain a point is.
        """
        sigma, residual = self.matches.sigma[which], self.matches.residual[which]
        doubt = sigma > DOUBTFUL_SPREAD * MAX_SPREAD * usual * np.sqrt(residual)
        doubt |= sigma > DOUBTFUL_SIGMA / np.sqrt(self.settings.window.sum())
        found = np.zeros((2, which.size), dtype=np.bool_)
        found[:, doubt] = self._one_sided(which[doubt], usual)
        return found[0], found[1]

    def _resolve_uncertain(self, uncertain: Bool, likely: Bool) -> None:
        """Give up uncertain subsets beside lost ones: an edge goes on, short waves have none.

        Those whose middle by itself says something else of the point; and likely ones among
        several: an edge through a subset's middle looks the same in there.
        """
        lost = np.isin(self.matches.status[self._neighbours], BESIDE_EDGES).sum(axis=1)
        asked = np.flatnonzero(uncertain & (lost > 0))
        company = np.where(likely[asked], MIN_REJECTED_NEIGHBOURS, 2 * MIN_REJECTED_NEIGHBOURS)
        torn = self._centre_disagrees(asked) | (lost[asked] >= company)
        self.matches.refuse(asked[torn], Status.INCOHERENT)

    def _centre_disagrees(self, which: Long) -> Bool:
        """Whether the middle of a subset by itself says something else of its point.

        It does beside an edge that only the outer part sees.
        """
        if which.size == 0:
            return np.zeros(0, dtype=np.bool_)
        half = self.settings.half
        inner = max(ceil(CENTRE_SHARE * half), 3)
        cut = slice(half - inner, half + inner + 1)
        settings = replace(self.settings, window=self.settings.window[cut, cut])
        scale = np.array([1.0, *[inner / half] * 2, *[(inner / half) ** 2] * 3])
        start = self.matches.coefficients[which] * scale
        result = correlate(Subsets(self.pair, self.points[which], start), settings, self.device)
        away = np.abs(result.coefficients[:, :, 0] - start[:, :, 0]).max(axis=1)
        # blurred noise is correlated: the uncertainty is that much larger
        sigma = result.sigma * max(1.0, 2.0 * np.sqrt(np.pi) * self.blur_px)
        limit = np.maximum(self.settings.apart_px, 4.0 * sigma)
        return np.asarray(result.ok & (away > limit))

    def _outliers(self) -> Long:
        """Measured points that a neighbour would put elsewhere, or that leave much."""
        which = np.flatnonzero(self.ok)
        if which.size < NEIGHBOURS:
            return which
        neighbour = self._neighbours[which].T
        own = self._linear_warps.take(which, axis=2)[:, :, None]
        displacement, slopes = self._by_neighbours(which)
        away = np.abs(displacement - own[:, 0]).max(axis=0)
        unsure = np.hypot(self.matches.sigma[which], self.matches.sigma[neighbour])
        # a jump bends the field before it moves a point: slopes are known sqrt(3) times worse
        bent = np.abs(slopes - own[:, 1:]).sum(axis=1).max(axis=0)
        bent -= np.maximum(MIN_SLOPE_CHANGE * self.settings.apart_px, 10.0 * unsure)
        uncertain = np.maximum(away - 4.0 * unsure - OUTLIER_PX, bent)
        # beyond the picture's border no body ends; along a mask one does
        lost = ~self.ok & ((self.mask is not None) | (self.matches.status != Status.OUTSIDE))
        alone = lost[neighbour].any(axis=0)
        unlike = 1.0 - self.matches.zncc[which]
        poor = unlike > POOR_CORRELATION * np.quantile(unlike, 0.25)
        residual = self.matches.residual[which]
        usual = 1.0 + POOR_RESIDUAL / self.settings.window.sum()
        poor &= residual > usual * np.quantile(residual, 0.25)
        return np.asarray(which[(np.nan_to_num(uncertain).max(axis=0) > 0.0) | alone | poor])
