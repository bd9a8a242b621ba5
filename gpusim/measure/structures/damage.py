"""Where a beam is damaged: slope changes in the difference of two deflection lines.

A notch makes a beam softer over a short length. Under the same loads its deflection line differs
from that of the intact beam by a broken line: straight, with a change of slope at each notch as
large as the bending moment there times the notch's compliance. The difference is fitted by a
continuous piecewise-linear curve with free breaks (Muggeo, "Estimating regression models with
unknown break-points", Statistics in Medicine 22, 2003), one break after another as long as an
F-test says that it explains more than noise.

Close to a notch it is no broken line: stress flows round the notch within about one depth of the
beam (Saint-Venant). Points there move a break by more than noise does, so `slope_changes` leaves
them out by its ``clearance``. A notch also gives way to the shear force V, by a step c_s V beside
the slope change c_b M. A broken line can't tell that step from a shift of the break, towards where
the moment grows, by c_s V / (c_b M): c_s / (c_b L) with a force at a distance L from the notch.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import scipy

from gpusim.arrays.array_types import Bool, Float
from gpusim.errors import InputError
from gpusim.field_summary import field_summary
from gpusim.validation import require, unmasked

ROUNDS = 60
SETTLED = 1e-9  # of the length
MIN_POINTS = 3  # on a piece of the broken line


@dataclass(frozen=True, eq=False)
class SlopeChanges:
    """The breaks that were found, from the lowest position on.

    Attributes
    ----------
    position, sigma : (K,) float64, where the slope changes and its standard uncertainty.
    change, change_sigma : (K,) float64, by how much (per unit of position).
    p_value : (K,) float64, F-test of each break against the same curve without it; small is sure.
    x, fitted : (M,) float64, the broken line at the points that were used (none within the
        clearance of a break).
    residual : RMS of points minus broken line.
    offset, slope : of its first piece, at position 0.

    Examples
    --------
    >>> x = np.linspace(0, 1, 21)
    >>> found = gs.measure.slope_changes(x, np.maximum(0, x - 0.4))
    >>> found.position.round(6), found.change.round(6)
    (array([0.4]), array([1.]))
    """

    position: Float
    sigma: Float
    change: Float
    change_sigma: Float
    p_value: Float
    x: Float
    fitted: Float
    residual: float
    offset: float
    slope: float
    __repr__ = field_summary

    def at(self, x: Float) -> Float:
        """The broken line at positions (N,)."""
        result: Float = self.offset + self.slope * x
        for position, change in zip(self.position, self.change, strict=True):
            result = result + change * np.maximum(x - position, 0.0)
        return result

    def write_csv(self, path: str | Path) -> None:
        """One row per break."""
        names = ("position", "sigma", "change", "change_sigma", "p_value")
        rows = np.column_stack([getattr(self, name) for name in names])
        np.savetxt(path, rows, "%.6g", ",", header=",".join(names), comments="")


@unmasked()
def difference_curve(
    position: npt.ArrayLike,
    deflection: npt.ArrayLike,
    reference_position: npt.ArrayLike,
    reference: npt.ArrayLike,
) -> Float:
    """Deflection minus the reference's (M,); NaN where one of them wasn't measured.

    A reference at other positions is interpolated linearly between its measured points, and not
    beyond them. Raises InputError for shapes that don't fit.

    Examples
    --------
    >>> gs.measure.difference_curve([0, 1, 2], [0, 1.5, 4], [0, 2], [0, 2])
    array([0. , 0.5, 2. ])
    """
    x, y = np.asarray(position, np.float64), np.asarray(deflection, np.float64)
    x0, y0 = np.asarray(reference_position, np.float64), np.asarray(reference, np.float64)
    fits = x.ndim == 1 and y.shape == x.shape and x0.ndim == 1 and y0.shape == x0.shape
    expected = "positions and deflections of one length each"
    require(fits, "difference_curve", f"{x.shape}, {y.shape} and {x0.shape}, {y0.shape}", expected)
    if x.shape == x0.shape and np.array_equal(x, x0):
        same: Float = y - y0
        return same
    good = np.isfinite(y0)
    if not good.any():
        raise InputError("difference_curve: nothing of the reference was measured")
    order = np.argsort(x0[good])
    result: Float = y - np.interp(x, x0[good][order], y0[good][order], left=np.nan, right=np.nan)
    return result


@unmasked()
def slope_changes(
    x: npt.ArrayLike,
    y: npt.ArrayLike,
    *,
    most: int = 6,
    significance: float = 1e-3,
    least_share: float = 0.1,
    least_gap: float | None = None,
    clearance: float = 0.0,
) -> SlopeChanges:
    """Find where the slope of a curve changes.

    Parameters
    ----------
    x, y : (M,) positions and values; rows with NaN are left out.
    most : breaks at most.
    significance : highest p-value of a break in the F-test (two parameters more, against what the
        fit leaves over: noise, and the local bending around a notch that is no broken line).
    least_share : a break whose change is smaller than this share of the largest one is left out.
    least_gap : smallest distance of two breaks, and of a break from an end; default three points.
    clearance : points nearer than this to a break don't count for where it is: give the beam's
        depth. It becomes smaller where less than three points would be left between two breaks, or
        between a break and an end.

    Raises
    ------
    InputError
        Fewer than eight points, equal positions, or limits out of range.

    Examples
    --------
    >>> x = np.linspace(0, 1, 21)
    >>> gs.measure.slope_changes(x, np.maximum(0, x - 0.4)).position.round(6)
    array([0.4])
    """
    a, b = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if a.ndim != 1 or b.shape != a.shape:
        raise InputError(f"slope_changes: got shapes {a.shape} and {b.shape}; expected (M,) twice")
    good = np.isfinite(a) & np.isfinite(b)
    order = np.argsort(a[good])
    a, b = a[good][order], b[good][order]
    # from the first point on: far from zero the columns of a fit would hardly differ
    start = float(a[0]) if len(a) else 0.0
    a = a - start
    fits = len(a) >= 8 and (np.diff(a) > 0).all()
    require(fits, "slope_changes", f"{len(a)} measured points", "8 or more, at distinct places")
    shares = 0 < significance < 1 and 0 <= least_share < 1
    if not (shares and 0 <= most <= 50 and 0 <= clearance < np.inf):
        raise InputError(
            f"slope_changes: got most {most}, significance {significance}, least_share "
            f"{least_share}, clearance {clearance}; expected 0 to 50, 0 to 1, 0 to 1, 0 or more"
        )
    gap = float(3 * np.median(np.diff(a))) if least_gap is None else float(least_gap)
    breaks = np.zeros(0)
    squares = _line(a, b, breaks)[1]
    floor = 1e-24 * float(b @ b)
    while squares > floor and len(breaks) < most and len(a) > 2 * len(breaks) + 5:
        best = _one_more(a, b, breaks, gap)
        if best is None:
            break
        tried, new_squares = best
        freedom = len(a) - 2 - 2 * len(tried)
        gain = (squares - new_squares) / 2 / max(new_squares / freedom, floor)
        if not _chance(gain, freedom) <= significance:
            break
        breaks, squares = tried, new_squares
    breaks = _without_small(a, b, breaks, gap, least_share)
    used = _far_enough(a, breaks, clearance)
    if not used.all():
        a, b = a[used], b[used]
        breaks, _ = _refined(a, b, breaks, _line(a, b, breaks)[1], gap)
    changes = _result(a, b, breaks)
    return replace(
        changes, position=changes.position + start, x=changes.x + start,
        offset=changes.offset - changes.slope * start,
    )  # fmt: skip


def _chance(gain: float, freedom: int) -> float:
    """Probability that noise alone gains as much by two more parameters (F test)."""
    return float(scipy.special.fdtrc(2, freedom, max(gain, 0.0)))


def _line(x: Float, y: Float, breaks: Float) -> tuple[Float, float]:
    """Offset, slope and slope changes for given breaks, and the sum of squares."""
    matrix = _columns(x, breaks)
    parameters = np.asarray(np.linalg.lstsq(matrix, y, rcond=None)[0], dtype=np.float64)
    gap = y - matrix @ parameters
    return parameters, float(gap @ gap)


def _columns(x: Float, breaks: Float) -> Float:
    bends = np.maximum(x[:, None] - breaks, 0.0)
    return np.column_stack([np.ones_like(x), x, bends])


def _slopes(x: Float, breaks: Float, parameters: Float) -> Float:
    """Derivatives of the line by its parameters and by the places of its breaks."""
    moved = -parameters[2:] * (x[:, None] > breaks)
    return np.column_stack([_columns(x, breaks), moved])


def _one_more(x: Float, y: Float, breaks: Float, gap: float) -> tuple[Float, float] | None:
    """The breaks with the best one added, all of them refined; None if there is no room."""
    step = np.median(np.diff(x)) / 4
    places = np.arange(x[0] + gap, x[-1] - gap + 0.5 * step, step)
    best: tuple[Float, float] | None = None
    for place in places:
        if len(breaks) and np.abs(breaks - place).min() < gap:
            continue
        tried = np.sort(np.append(breaks, place))
        squares = _line(x, y, tried)[1]
        if best is None or squares < best[1]:
            best = tried, squares
    return None if best is None else _refined(x, y, *best, gap)


def _refined(x: Float, y: Float, breaks: Float, squares: float, gap: float) -> tuple[Float, float]:
    """Breaks moved by Gauss-Newton as long as the squares fall."""
    count, length = len(breaks), float(x[-1] - x[0])
    for _ in range(ROUNDS):
        parameters, _ = _line(x, y, breaks)
        matrix = _slopes(x, breaks, parameters)
        residual = y - _columns(x, breaks) @ parameters
        move = np.linalg.lstsq(matrix, residual, rcond=None)[0][-count:]
        for _ in range(12):
            tried = np.sort(breaks + move)
            ends = np.concatenate([[x[0]], tried, [x[-1]]])
            if np.isfinite(tried).all() and (np.diff(ends) >= 0.999 * gap).all():
                new = _line(x, y, tried)[1]
                if new <= squares:
                    break
            move = 0.5 * move
        else:
            break
        settled = np.abs(tried - breaks).max() <= SETTLED * length
        breaks, squares = tried, new
        if settled:
            break
    return breaks, squares


def _without_small(x: Float, y: Float, breaks: Float, gap: float, least_share: float) -> Float:
    """Leave the smallest break out, and fit again, until none is small against the largest."""
    while len(breaks) > 1:
        change = np.abs(_line(x, y, breaks)[0][2:])
        weakest = int(np.argmin(change))
        if change[weakest] >= least_share * change.max():
            break
        rest = np.delete(breaks, weakest)
        breaks = _refined(x, y, rest, _line(x, y, rest)[1], gap)[0]
    return breaks


def _far_enough(x: Float, breaks: Float, clearance: float) -> Bool:
    """Which points (M,) are at least the clearance, or what room there is, from every break."""
    piece = np.searchsorted(breaks, x)
    used = np.ones(len(x), bool)
    for k in range(len(breaks) + 1):
        members = np.flatnonzero(piece == k)
        ends = breaks[max(k - 1, 0) : k + 1]
        distance = np.abs(x[members, None] - ends).min(axis=1, initial=np.inf)
        if len(members) > MIN_POINTS:
            limit = min(clearance, np.sort(distance)[-MIN_POINTS])
            used[members[distance < limit]] = False
    return used


def _result(x: Float, y: Float, breaks: Float) -> SlopeChanges:
    parameters, squares = _line(x, y, breaks)
    count = len(breaks)
    matrix = _slopes(x, breaks, parameters)
    freedom = max(len(x) - matrix.shape[1], 1)
    size = np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    inverse = np.linalg.pinv((matrix / size).T @ (matrix / size), hermitian=True)
    sigma = np.sqrt(np.maximum(np.diag(inverse), 0.0) * squares / freedom) / size
    floor = 1e-24 * float(y @ y)
    p_values = np.ones(count)
    for k in range(count):
        without = _line(x, y, np.delete(breaks, k))[1]
        gain = (without - squares) / 2 / max(squares / freedom, floor)
        p_values[k] = _chance(gain, freedom)
    return SlopeChanges(
        position=breaks,
        sigma=sigma[2 + count :],
        change=parameters[2:],
        change_sigma=sigma[2 : 2 + count],
        p_value=p_values,
        x=x,
        fitted=_columns(x, breaks) @ parameters,
        residual=float(np.sqrt(squares / len(x))),
        offset=float(parameters[0]),
        slope=float(parameters[1]),
    )
