"""Modes that were identified: frequency, damping, shape, and how sure they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Complex, Float
from gpusim.field_summary import field_summary
from gpusim.validation import checked, require


@dataclass(frozen=True)
class OperationalModes:
    """N modes at P points, by rising frequency.

    Attributes
    ----------
    frequency_Hz, damping : (N,) float64, undamped natural frequency; share of critical damping.
    frequency_sigma_Hz, damping_sigma : (N,) float64, their standard uncertainties.
    points : (P, 2) float64, x, y px.
    shapes : (N, P, 2) float64, real, the greatest component 1; only their ratios mean anything.
    shape_sigma : (N, P, 2) float64, standard uncertainty of each component.
    complexity : (N,) float64, 0 of a shape whose points move in step, up to 1: noise, strong or
        uneven damping, or two modes in one.
    method : how they were identified.

    Examples
    --------
    >>> times = np.arange(400) / 100
    >>> decay = np.exp(-0.02 * 2 * np.pi * 8 * times) * np.cos(2 * np.pi * 8 * times)
    >>> shape = np.array([[1.0, 0.2], [-0.5, 0.0]])
    >>> motion, points = decay[:, None, None] * shape, [[10, 10], [40, 10]]
    >>> series = gs.measure.PointSeries.of(times, points, motion)
    >>> modes = gs.measure.identify_modes(series, modes=1, excitation="release")
    >>> modes.frequency_Hz.round(2), modes.damping.round(3)
    (array([8.]), array([0.02]))
    >>> gs.measure.mac(modes.shapes, shape[None]).round(4)
    array([[1.]])
    """

    frequency_Hz: Float
    frequency_sigma_Hz: Float
    damping: Float
    damping_sigma: Float
    points: Float
    shapes: Float
    shape_sigma: Float
    complexity: Float
    method: str
    __repr__ = field_summary


@dataclass(frozen=True)
class Poles:
    """N modes of one estimate: frequency_Hz, damping (N,), complex shapes (N, r)."""

    frequency_Hz: Float
    damping: Float
    shapes: Complex

    def __getitem__(self, chosen: npt.NDArray[np.generic] | list[int]) -> Poles:
        return Poles(self.frequency_Hz[chosen], self.damping[chosen], self.shapes[chosen])


@dataclass(frozen=True)
class Sensors:
    """C of them: what r responses are at each (C, r), and how much later than the responses each is
    looked at (C,), s."""

    loadings: Float
    delays: Float

    def shapes(self, poles: Poles) -> Complex:
        """(N, C) of modes at one time: what is looked at later has gone on by the pole."""
        rate = 2 * np.pi * poles.frequency_Hz * np.exp(1j * np.arccos(-poles.damping))
        return np.asarray((poles.shapes @ self.loadings.T) * np.exp(-np.outer(rate, self.delays)))


def distances(first: Poles, second: Poles) -> Float:
    """(N, M) how unlike modes are: relative difference of frequency, plus 1 - MAC."""
    apart = np.abs(first.frequency_Hz[:, None] - second.frequency_Hz)
    apart = apart / np.minimum(first.frequency_Hz[:, None], second.frequency_Hz)
    return apart + np.maximum(1.0 - mac(first.shapes, second.shapes), 0.0)


@checked
def mac(first: npt.ArrayLike, second: npt.ArrayLike) -> Float:
    """Modal assurance criterion (N, M) of shapes (N, ...) with shapes (M, ...): 1 of equal ones.

    Examples
    --------
    >>> gs.measure.mac([[1, 2, 1], [1, 0, -1]], [[2, 4, 2]])
    array([[1.],
           [0.]])
    """
    one, two = (np.reshape(shapes, (len(np.asarray(shapes)), -1)) for shapes in (first, second))
    fits = one.shape[1] == two.shape[1] > 0
    require(fits, "mac: shapes", f"{one.shape} and {two.shape}", "as many components of both")
    product = np.abs(one.conj() @ two.T) ** 2
    size = [(np.abs(each) ** 2).sum(axis=1) for each in (one, two)]
    return np.asarray(product / np.maximum(np.outer(*size), 1e-300))


def amplitudes(shapes: Float, displacement: Float) -> Float:
    """(N,) by which each of the shapes (N, P, 2) moves the point of its greatest component at most,
    of points' displacements (T, P, 2)."""
    moved = (displacement - displacement.mean(axis=0)).reshape(len(displacement), -1)
    share = np.linalg.lstsq(shapes.reshape(len(shapes), -1).T, moved.T, rcond=None)[0]
    return np.asarray(np.abs(share).max(axis=1))


def real_shapes(shapes: Complex) -> tuple[Float, Float]:
    """Shapes (N, C) turned to be as real as can be, their greatest component 1; and what share of
    each is left imaginary, (N,): 0 to 1."""
    square = (shapes**2).sum(axis=1)
    turned = shapes * np.exp(-0.5j * np.angle(square))[:, None]
    size = (np.abs(shapes) ** 2).sum(axis=1)
    complexity = 1.0 - np.abs(square) / size
    rows = np.arange(len(shapes))
    greatest = turned.real[rows, np.abs(turned.real).argmax(axis=1)]
    return turned.real / greatest[:, None], complexity


def jackknife(
    blocks: Float | Complex, estimate: Callable[[Float | Complex], Poles], sensors: Sensors
) -> Poles:
    """Standard uncertainties of what ``estimate`` makes of the mean of ``blocks`` (B, ...): each
    is left out once (Efron 1982). Shapes are taken to the ``sensors`` and made real."""
    count = len(blocks)
    total = blocks.sum(axis=0)
    found = [estimate((total - block) / (count - 1)) for block in blocks]
    whole = real_shapes(sensors.shapes(estimate(total / count)))[0]
    shapes = []
    for each in found:
        real = real_shapes(sensors.shapes(each))[0]
        size = (real * whole).sum(axis=1) / (real**2).sum(axis=1)
        shapes.append(real * size[:, None])
    spread = np.sqrt(count - 1)
    return Poles(
        spread * np.std([each.frequency_Hz for each in found], axis=0),
        spread * np.std([each.damping for each in found], axis=0),
        spread * np.std(shapes, axis=0),
    )
