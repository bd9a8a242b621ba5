"""Covariance-driven stochastic subspace identification (Peeters and De Roeck 1999).

Responses y of a structure that is excited by white noise, or let go, have covariances between times
that decay as the structure itself: R_i = C A^(i-1) G. The block Hankel matrix of R_1 … R_(2m-1)
is a product of [C; CA; ...] with [G, AG, ...]. Its first n left singular vectors span the first
factor, whose shift by a block gives A; A's eigenvalues are the poles, C's products with its
eigenvectors the shapes. R_0 isn't used: white noise of the sensor is in that alone.

Orders n rise. What is physical stays (frequency, damping, shape) from order to order; poles that do
are gathered by likeness, and the largest groups are the modes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from gpusim.arrays.array_types import Bool, Complex, Float, Int, Long
from gpusim.measure.vibration.operational_modes import Poles, Sensors, distances, jackknife

SAME_FREQUENCY, SAME_DAMPING, SAME_SHAPE = 0.01, 0.1, 0.05  # relative, relative, 1 - MAC
MOST_DAMPING = 0.3
UNDAMPED = 1e-3  # what noise may make of no damping, of either sign
SAME_MODE = 0.06  # of `distances` within a group
LEAST_ORDERS = 0.3  # share of all orders in which a mode shows
BLOCKS = 12
ROUNDING = 1e-12  # of the greatest singular value: what lies below is no response
ORDERS = 8  # for each mode that is asked for


@dataclass(frozen=True)
class Covariances:
    """Covariances (B, 2m - 1, r, r) of B parts of responses at lags 1 … 2m - 1."""

    blocks: Float
    rate_Hz: float

    @property
    def depth(self) -> int:
        """m, blocks along a side of the Hankel matrix."""
        return len(self.blocks[0]) // 2 + 1

    def hankel(self, covariances: Float) -> Float:
        """The block Hankel matrix (m r, m r) of covariances (2m - 1, r, r)."""
        index = np.arange(self.depth)[:, None] + np.arange(self.depth)
        side = self.depth * covariances.shape[1]
        return np.asarray(covariances[index].transpose(0, 2, 1, 3).reshape(side, side))

    def poles(self, observability: Float) -> Poles:
        """Modes of a basis (m r, n) of [C; CA; ...]."""
        channels = self.blocks.shape[2]
        ahead, back = observability[channels:], observability[:-channels]
        transition = np.linalg.lstsq(back, ahead, rcond=None)[0]
        values, vectors = np.linalg.eig(transition)
        chosen = values.imag > 0
        with np.errstate(divide="ignore"):
            rates = np.log(values[chosen]) * self.rate_Hz
        shapes = (observability[:channels] @ vectors[:, chosen]).T
        size = np.abs(rates)
        return Poles(size / (2 * np.pi), -rates.real / size, shapes)


def covariances(responses: Float, rate_Hz: float, depth: int, interleaved: bool) -> Covariances:
    """Of ``responses`` (T, r), in parts of successive times, or of every B-th time."""
    count = len(responses) - 2 * depth + 1
    parts = np.arange(count) * BLOCKS // count
    if interleaved:
        parts = np.arange(count) % BLOCKS
    blocks = np.empty((BLOCKS, 2 * depth - 1, *[responses.shape[1]] * 2))
    for part in range(BLOCKS):
        times = np.flatnonzero(parts == part)
        now = responses[times]
        for lag in range(1, 2 * depth):
            blocks[part, lag - 1] = responses[times + lag].T @ now * (BLOCKS / count)
    return Covariances(blocks, rate_Hz)


@dataclass(frozen=True)
class Stabilisation:
    """Poles of rising orders.

    order : (K,) of each pole.    stable : (K,) whether the order before has the same.
    """

    order: Int | Long
    poles: Poles
    stable: Bool


def stabilisation(statistics: Covariances, vectors: Float, orders: Long) -> Stabilisation:
    """Poles of rising ``orders``, from left singular vectors of the Hankel matrix."""
    found: list[Poles] = []
    stable: list[Bool] = []
    for order in orders:
        poles = statistics.poles(vectors[:, :order])
        poles = poles[(poles.damping > -UNDAMPED) & (poles.damping < MOST_DAMPING)]
        same = np.zeros(len(poles.damping), dtype=bool)
        if found and len(found[-1].damping) and len(poles.damping):
            before = found[-1][distances(poles, found[-1]).argmin(axis=1)]
            same = np.abs(poles.frequency_Hz / before.frequency_Hz - 1) < SAME_FREQUENCY
            damping = np.maximum(np.abs(before.damping), UNDAMPED)
            same &= np.abs(poles.damping - before.damping) < SAME_DAMPING * damping
            unlike = distances(poles, before).diagonal()
            same &= unlike < SAME_FREQUENCY + SAME_SHAPE
        found.append(poles)
        stable.append(same)
    every = joined(found)
    order = np.repeat(orders, [len(p.damping) for p in found])
    return Stabilisation(order, every, np.concatenate(stable))


def subspace_modes(
    statistics: Covariances, band_Hz: tuple[float, float], count: int, sensors: Sensors
) -> tuple[Poles, Poles]:
    """The ``count`` modes in a band that show at most orders, and their uncertainties (of shapes at
    ``sensors``)."""
    hankel = statistics.hankel(statistics.blocks.mean(axis=0))
    left, size, right = scipy.linalg.svd(hankel, full_matrices=False)
    most = min(ORDERS * count, len(hankel) - statistics.blocks.shape[2])
    most = min(most, int((size > ROUNDING * size[0]).sum()) + ORDERS)
    orders = np.arange(2, most + 1, 2)
    diagram = stabilisation(statistics, left, orders)
    within = (diagram.poles.frequency_Hz >= band_Hz[0]) & (diagram.poles.frequency_Hz <= band_Hz[1])
    kept = np.flatnonzero(diagram.stable & within)
    groups = [
        rows for rows in _groups(diagram.poles, kept) if len(rows) >= LEAST_ORDERS * len(orders)
    ]
    groups = sorted(groups, key=len, reverse=True)[:count]
    if not groups:
        return diagram.poles[[]], diagram.poles[[]]
    chosen = np.array([_typical(diagram.poles, rows) for rows in groups], dtype=np.int64)
    chosen = chosen[np.argsort(diagram.poles.frequency_Hz[chosen])]
    modes = diagram.poles[chosen]

    def estimate(covariances: Float | Complex) -> Poles:
        # the right singular vectors stay: of first order in the noise, that is as good
        turned = statistics.hankel(covariances.real) @ right[: orders[-1]].T
        found = []
        for number, order in enumerate(diagram.order[chosen]):
            poles = statistics.poles(turned[:, :order])
            found.append(poles[[int(distances(modes[[number]], poles).argmin())]])
        return joined(found)

    return modes, jackknife(statistics.blocks, estimate, sensors)


def joined(parts: list[Poles]) -> Poles:
    """Poles of several estimates, one after the other."""
    fields = zip(*(vars(part).values() for part in parts), strict=True)
    return Poles(*(np.concatenate(field) for field in fields))


def _groups(poles: Poles, kept: Long) -> list[Long]:
    """Rows of poles, of those ``kept``, that are of one mode each."""
    if len(kept) < 2:
        return [kept] if len(kept) else []
    apart = distances(poles[kept], poles[kept])
    tree = scipy.cluster.hierarchy.average(apart[np.triu_indices(len(kept), 1)])
    group = scipy.cluster.hierarchy.fcluster(tree, SAME_MODE, "distance")
    return [kept[group == number] for number in range(1, group.max() + 1)]


def _typical(poles: Poles, rows: Long) -> int:
    """The pole nearest to the medians of its group."""
    unlike = np.zeros(len(rows))
    for values in (poles.frequency_Hz[rows], poles.damping[rows]):
        middle = np.median(values)
        unlike += np.abs(values - middle) / max(np.median(np.abs(values - middle)), 1e-12 * middle)
    return int(rows[unlike.argmin()])
