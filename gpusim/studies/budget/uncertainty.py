"""Measurement uncertainty from draws: each source alone, beside all of them together.

After the Guide to the expression of uncertainty in measurement (JCGM 100:2008): the law of
propagation for sources that are independent of each other (5.1.2), effective degrees of freedom by
Welch and Satterthwaite (G.4.1), expanded uncertainty (6.2.1); and after its Supplement 1 (JCGM
101:2008): the coverage interval of the drawn errors (7.7).
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.stats import t as student

from gpusim.arrays.array_types import Float
from gpusim.validation import require

ADDITIVE = 0.05  # relative difference from which on sources count as acting on each other
_RESAMPLED = 200
"""Sets of draws that tell by how much chance alone makes such a difference."""
_TOLD = ("combined", "freedom", "factor", "expanded", "joint_uncertainty", "ratio_uncertainty",
         "bias", "interval", "correlation")  # fmt: skip


@dataclass(frozen=True, eq=False)
class SourceDraws:
    """What a source ``name`` was drawn as, and what was measured: ``parameters`` and their
    ``values`` (N, P), NaN for those that are no quantities, as seeds; ``errors`` (N, Q), NaN where
    nothing was measured. ``degrees_of_freedom``: of what is known of the source; without it those
    of the draws.

    Examples
    --------
    >>> import numpy as np
    >>> from gpusim.studies.budget import SourceDraws
    >>> focal = np.array([[34.9], [35.0], [35.1], [35.0]])
    >>> SourceDraws("lens", ("focal_mm",), focal, 2.0 * (focal - 35.0)).sensitivity.round(6)
    array([[2.]])
    """

    name: str
    parameters: tuple[str, ...]
    values: Float
    errors: Float
    degrees_of_freedom: float | None = None

    @cached_property
    def uncertainty(self) -> Float:
        """The standard uncertainty (Q,) by this source: standard deviation of the errors."""
        return np.asarray(np.nanstd(self.errors, axis=0, ddof=1))

    @cached_property
    def freedom(self) -> Float:
        """Degrees of freedom (Q,)."""
        drawn = np.count_nonzero(np.isfinite(self.errors), axis=0) - 1.0
        known = self.degrees_of_freedom
        return np.asarray(drawn if known is None else np.full_like(drawn, known))

    @cached_property
    def sensitivity(self) -> Float:
        """Sensitivity coefficients (P, Q): slopes of the errors by linear regression on all
        parameters at once; NaN for what is no quantity, or isn't drawn often enough."""
        numbers = np.isfinite(self.values).all(axis=0) & (np.ptp(self.values, axis=0) > 0.0)
        slopes = np.full((len(self.parameters), self.errors.shape[1]), np.nan)
        for column, error in enumerate(self.errors.T):
            known = np.isfinite(error)
            if np.count_nonzero(known) > np.count_nonzero(numbers) + 1:
                scale = np.std(self.values[:, numbers], axis=0)
                drawn = self.values[known][:, numbers] / scale
                base = np.column_stack([np.ones(len(drawn)), drawn - drawn.mean(axis=0)])
                slopes[numbers, column] = np.linalg.lstsq(base, error[known])[0][1:] / scale
        return slopes

    @cached_property
    def correlation(self) -> Float:
        """Correlation coefficients (P, Q) of parameters and errors; NaN likewise."""
        return _correlation(self.values, self.errors)


class UncertaintyBudget:
    """The uncertainty of Q measured ``quantities`` (name and unit of each).

    ``nominal`` (Q,): the errors where nothing is drawn. ``joint`` (N, Q): errors with all sources
    drawn together; draw n of it has the values that draw n of each of the ``sources`` has.
    ``coverage``: the probability of intervals. ``remarks``: what else is to be known, in sentences.

    Attributes
    ----------
    uncertainties, biases, shares : (S, Q) float64
        Standard uncertainty by each source alone, what it adds to the mean error (what isn't
        linear), and its share of the variance; NaN where nothing varies.
    combined, freedom, factor, expanded : (Q,) float64
        Root of the sum of squares, effective degrees of freedom, coverage factor, and half the
        interval that holds the truth around a result without its mean error.
    joint_uncertainty, bias : (Q,) float64
        Standard uncertainty with all sources together, less what draws of different sources have in
        common by chance (their sum is a control variate, whose variance is known to be that of the
        combined uncertainty); the mean error, by which a result is to be corrected.
    ratio_uncertainty : (Q,) float64
        Standard uncertainty of ``joint_uncertainty / combined``, by bootstrap over the draws.
    interval : (2, Q) float64
        What holds the joint errors by the coverage, as many below as above it.
    correlation : (Q, Q) float64
        Correlation coefficients of the joint errors.

    Raises
    ------
    InputError
        No sources; other numbers of draws, or fewer than 3 that were measured.

    Examples
    --------
    >>> import numpy as np
    >>> from gpusim.studies.budget import SourceDraws, UncertaintyBudget
    >>> noise = np.array([[-1.0], [1.0], [0.0], [1.0], [-1.0]])
    >>> source = SourceDraws("noise", ("seed",), np.nan * noise, noise)
    >>> budget = UncertaintyBudget((("length", "mm"),), np.zeros(1), (source,), noise)
    >>> budget.combined, budget.factor.round(2)
    (array([1.]), array([2.78]))
    """

    def __init__(
        self, quantities: tuple[tuple[str, str], ...], nominal: Float,
        sources: tuple[SourceDraws, ...], joint: Float, *, coverage: float = 0.95,
        remarks: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        require(len(sources) > 0, "uncertainty budget", "no sources", "one or more")
        shape = len(joint), len(quantities)
        for name, errors in [*((one.name, one.errors) for one in sources), ("all", joint)]:
            found = np.count_nonzero(np.isfinite(errors), axis=0)
            fits = errors.shape == shape and bool((found >= 3).all())
            expected = f"as many draws of all, 3 or more of each of {shape[1]} quantities"
            require(fits, f"uncertainty budget: draws of {name}", found.tolist(), expected)
        self.quantities, self.nominal, self.sources = quantities, nominal, sources
        self.joint, self.coverage, self.remarks = joint, coverage, remarks
        alone = np.array([one.errors for one in sources])
        self.uncertainties = np.array([one.uncertainty for one in sources])
        self.biases = np.nanmean(alone, axis=1) - nominal
        squares = self.uncertainties**2
        self.combined, self.joint_uncertainty = _sums(alone - nominal, joint)
        with np.errstate(divide="ignore", invalid="ignore"):
            self.shares = squares / self.combined**2
            terms = squares**2 / np.array([one.freedom for one in sources])
            self.freedom = self.combined**4 / terms.sum(axis=0)
        freedom = np.nan_to_num(self.freedom, nan=np.inf)
        self.factor = np.asarray(student.ppf(0.5 + 0.5 * coverage, freedom))
        self.expanded = self.factor * self.combined
        rows = np.random.default_rng(0).integers(len(joint), size=(_RESAMPLED, len(joint)))
        with np.errstate(all="ignore"), warnings.catch_warnings(action="ignore"):  # no two draws
            drawn = [_sums(alone[:, row] - nominal, joint[row]) for row in rows]
            self.ratio_uncertainty = np.nanstd([one / root for root, one in drawn], axis=0)
        self.bias = np.nanmean(joint, axis=0)
        ends = 0.5 - 0.5 * coverage, 0.5 + 0.5 * coverage
        self.interval = np.nanquantile(joint, ends, axis=0)
        self.correlation = _correlation(joint, joint)

    def advice(self, quantity: int) -> str:
        """What to mend first for a ``quantity``, by its number, in words."""
        name, unit = self.quantities[quantity]
        combined, bias, joint = (
            float(one[quantity]) for one in (self.combined, self.bias, self.joint_uncertainty)
        )
        if not combined > 0.0:
            return f"{name}: none of the sources changes it."
        first = int(np.argmax(self.uncertainties[:, quantity]))
        share = float(self.shares[first, quantity])
        left = rounded(combined * math.sqrt(max(1.0 - share, 0.0)), combined)
        told = [
            f"{name}: mend {self.sources[first].name} first, {100.0 * share:.0f} % of the variance;"
            f" without it the standard uncertainty falls from {rounded(combined)} to {left} {unit}."
        ]
        if abs(bias) > combined:
            told.append(
                f"The mean error, {rounded(bias, combined)} {unit}, is larger than that: correct "
                "results by it, or mend what makes it (`gpusim explain`, `gpusim budget`)."
            )
        ratio, chance = joint / combined, float(self.ratio_uncertainty[quantity])
        if not abs(ratio - 1.0) <= max(ADDITIVE, 2.0 * chance):
            told.append(
                f"Together the sources make {ratio:.2f} of what their squares add up to (chance "
                f"alone: 1 +- {chance:.2f}): they act on each other."
            )
        return " ".join(told)

    def content(self) -> dict[str, Any]:
        """For report.json: by quantity, and by source within it."""

        def of(k: int, q: int) -> dict[str, Any]:
            one = self.sources[k]
            parameters = zip(
                one.parameters, one.sensitivity[:, q], one.correlation[:, q], strict=True
            )
            return {
                "name": one.name, "uncertainty": one.uncertainty[q], "freedom": one.freedom[q],
                "bias": self.biases[k, q], "share": self.shares[k, q],
                "parameters": [
                    {"name": key, "sensitivity": slope, "correlation": correlation}
                    for key, slope, correlation in parameters
                ],
            }  # fmt: skip

        told = [
            {"name": name, "unit": unit, "nominal_error": self.nominal[q], "advice": self.advice(q),
             **{key: getattr(self, key).T[q] for key in _TOLD},
             "sources": [of(k, q) for k in range(len(self.sources))]}
            for q, (name, unit) in enumerate(self.quantities)
        ]  # fmt: skip
        return {"coverage": self.coverage, "quantities": told, "remarks": self.remarks}


def rounded(value: float, uncertainty: float | None = None) -> str:
    """A number with the digits of two significant ones of its ``uncertainty`` (JCGM 100, 7.2.6), or
    of itself.

    Examples
    --------
    >>> from gpusim.studies.budget import rounded
    >>> rounded(0.0123456), rounded(12.3456, 0.0123456), rounded(1234.5, 345.0)
    ('0.012', '12.346', '1230')
    """
    size = abs(value if uncertainty is None else uncertainty)
    if not (math.isfinite(value) and math.isfinite(size) and size > 0.0):
        return f"{value:.2g}"
    digits = 1 - math.floor(math.log10(float(f"{size:.1e}")))
    return f"{round(value, digits):z.{max(digits, 0)}f}"


def _sums(alone: Float, joint: Float) -> tuple[Float, Float]:
    """Root of the sum of squares, and uncertainty of the ``joint`` errors (N, Q) less what draws of
    the sources ``alone`` (S, N, Q) have in common by chance."""
    squares = np.nanvar(alone, axis=1, ddof=1).sum(axis=0)
    added = alone.sum(axis=0)
    known = np.where(np.isfinite(added + joint), 1.0, np.nan)
    by_chance = np.nanvar(known * added, axis=0, ddof=1) - squares
    variance = np.nanvar(known * joint, axis=0, ddof=1) - by_chance
    return np.sqrt(squares), np.sqrt(np.maximum(variance, 0.0))


def _correlation(first: Float, second: Float) -> Float:
    """(A, B) of columns (N, A) and (N, B), over the rows that both have."""
    result = np.full((first.shape[1], second.shape[1]), np.nan)
    for i, x in enumerate(first.T):
        for k, y in enumerate(second.T):
            known = np.isfinite(x) & np.isfinite(y)
            if np.count_nonzero(known) > 2 and np.ptp(x[known]) > 0.0 and np.ptp(y[known]) > 0.0:
                result[i, k] = np.corrcoef(x[known], y[known])[0, 1]
    return result
