"""What a study's parameters do to what was measured: one of them, two together, Sobol indices."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.studies.table import SampleTable

MOST_LEVELS = 8
"""Of a parameter: more values are put into so many groups of equal size."""
_RESAMPLED = 500
"""Sets of points that the bootstrap draws."""


@dataclass(frozen=True)
class Levels:
    """A parameter's values in groups: their ``labels`` (K,), where they are on an axis, ``places``
    (K,), ``of`` (S,) which of them each sample has, and whether the places are numbers, in whose
    order there is a meaning."""

    parameter: str
    labels: tuple[str, ...]
    places: Float
    of: npt.NDArray[np.intp]
    are_numbers: bool = True


@dataclass(frozen=True)
class Effect:
    """A response at a parameter's ``levels``: ``values`` (K,), RMS of errors or mean of what has no
    truth, with the standard uncertainties ``sigmas`` (K,) and the numbers of samples ``counts``
    (K,). ``share``: of the variance of all samples what lies between the levels."""

    levels: Levels
    values: Float
    sigmas: Float
    counts: npt.NDArray[np.intp]
    share: float


@dataclass(frozen=True)
class SobolIndices:
    """Shares of a response's variance: ``first`` (P,) of each parameter alone, ``total`` (P,) with
    all that it acts together with; (P, 2) 95 % intervals by bootstrap; ``points`` used."""

    parameters: tuple[str, ...]
    first: Float
    total: Float
    first_interval: Float
    total_interval: Float
    points: int


def response(table: SampleTable, quantity: tuple[str, str]) -> tuple[Float, bool]:
    """Of a quantity (S,): its error, or where nothing is true of it what was measured; and whether
    it is an error. NaN where there is none."""
    error = np.asarray(table.of(quantity), np.float64)
    if np.isfinite(error).any():
        return error, True
    return np.asarray(table.of(quantity, "measured"), np.float64), False


def levels_of(table: SampleTable, parameter: str) -> Levels:
    """The groups of a parameter's values."""
    values = table[parameter]
    if values.dtype.kind not in "fiu":
        texts = [one if isinstance(one, str) else json.dumps(one) for one in values.tolist()]
        labels, of = np.unique(texts, return_inverse=True)
        return Levels(parameter, tuple(labels), np.arange(len(labels), dtype=float), of, False)
    places, of = np.unique(values.astype(float), return_inverse=True)
    digits = 4
    if len(places) > MOST_LEVELS:
        digits = 3
        edges = np.quantile(values, np.linspace(0.0, 1.0, MOST_LEVELS + 1)[1:-1])
        of = np.unique(np.searchsorted(edges, values), return_inverse=True)[1]
        places = np.bincount(of, values) / np.bincount(of)
    return Levels(parameter, tuple(f"{one:.{digits}g}" for one in places), places, of)


def effect(values: Float, levels: Levels, is_error: bool) -> Effect:
    """What a response ``values`` (S,) is at the levels of a parameter; NaN doesn't count."""
    measured = np.isfinite(values)
    judged = values**2 if is_error else values
    groups = [judged[measured & (levels.of == k)] for k in range(len(levels.labels))]
    counts = np.array([len(one) for one in groups])
    means = np.array([one.mean() if len(one) else np.nan for one in groups])
    spread = [one.std(ddof=1) / np.sqrt(len(one)) if len(one) > 1 else np.nan for one in groups]
    sigmas = np.array(spread)
    whole = judged[measured]
    between = np.nansum(counts * (means - whole.mean()) ** 2) if len(whole) else np.nan
    variance = np.sum((whole - whole.mean()) ** 2) if len(whole) else np.nan
    share = float(between / variance) if variance > 0.0 else 0.0
    if is_error:
        means = np.sqrt(means)
        sigmas = np.divide(sigmas, 2.0 * means, out=np.zeros_like(means), where=means > 0.0)
    return Effect(levels, means, sigmas, counts, share)


def association(
    one: Levels, other: Levels, among: npt.NDArray[Any], by_chance: bool = False
) -> float:
    """How much the values of two parameters go together ``among`` some samples (S,) bool, 0 to 1:
    Cramer's V; of values drawn ``by_chance`` less what chance makes of few samples (Bergsma, J.
    Korean Stat. Soc. 42 (2013) 323)."""
    counts = np.zeros((len(one.labels), len(other.labels)))
    np.add.at(counts, (one.of[among], other.of[among]), 1.0)
    counts = counts[counts.any(axis=1)][:, counts.any(axis=0)]
    if min(counts.shape) < 2:
        return 0.0
    size, less = counts.sum(), np.array(counts.shape) - 1.0
    expected = np.outer(counts.sum(axis=1), counts.sum(axis=0)) / size
    chance = by_chance / (size - 1.0)
    excess = ((counts - expected) ** 2 / expected).sum() / size - chance * less.prod()
    side = float((less - chance * less**2).min())
    return float(np.sqrt(max(excess, 0.0) / side)) if side > 0.0 else 0.0


def interaction(values: Float, one: Levels, other: Levels, is_error: bool) -> list[Effect]:
    """What a response is at the levels of ``one`` parameter, at each level of the ``other``."""
    return [
        effect(np.where(other.of == k, values, np.nan), one, is_error)
        for k in range(len(other.labels))
    ]


def sobol(values: Float, parameters: Sequence[str], seed: int = 0) -> SobolIndices:
    """First-order and total indices of a response ``values`` (P + 2, N) at Saltelli's points: two
    independent sets A and B of N points, then A with one parameter of B each.

    Points at which some value isn't finite are left out. Estimators of Saltelli et al., Comput.
    Phys. Commun. 181 (2010) 259, table 2 (b) and (f), as `scipy.stats.sobol_indices` has them,
    which takes powers of two alone; intervals by bootstrap.
    """
    points = values[:, np.isfinite(values).all(axis=0)]
    count = points.shape[1]
    if count < 2:
        points = np.full((len(values), 2), np.nan)
    rng = np.random.default_rng(seed)
    drawn = [_estimates(rng.choice(points, points.shape[1], axis=1)) for _ in range(_RESAMPLED)]
    first, total = _estimates(points)
    of_first, of_total = np.moveaxis(np.quantile(drawn, [0.025, 0.975], axis=0), 0, -1)
    return SobolIndices(tuple(parameters), first, total, of_first, of_total, count)


def _estimates(values: Float) -> Float:
    """First-order and total indices (2, P)."""
    values = values - values[:2].mean()
    a, b, mixed = values[0], values[1], values[2:]
    with np.errstate(invalid="ignore"):  # nothing varies: no share of nothing
        first = (b * (mixed - a)).mean(axis=-1) / values[:2].var()
        total = 0.5 * ((a - mixed) ** 2).mean(axis=-1) / values[:2].var()
    return np.stack([first, total])
