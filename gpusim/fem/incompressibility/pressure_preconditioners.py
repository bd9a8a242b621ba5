"""Preconditioners for the pressures of trilinear bricks, on lattices and on any mesh.

Pressures that alternate from cell to cell along two axes hardly push any node, and the less the
more slowly their amplitude varies: S = B A^-1 B^T has eigenvalues as low as (h/L)^2 there (Boland &
Nicolaides, SIAM J. Numer. Anal. 22 (1985) 474; Silvester & Kechkar, Comput. Methods Appl. Mech.
Eng. 79 (1990) 71), while anywhere else it is about volume over shear modulus. Their forces
alternate, too, so that A is as good as its diagonal D for them.

On a lattice (``PressureScaling``), what S does to their amplitudes is like a Laplacian, so these
get what a Laplacian gets: hat functions of 2, 4, 8, ... cells, each divided by its own energy and
summed up (Bramble, Pasciak & Xu, Math. Comput. 55 (1990) 1).

On any mesh (``PressureChebyshev``), S + C is about

    T = R^T W R + B D^-1 B^T + C,

where R averages the pressures around each node and W is volume over modulus there: smooth pressures
feel the first part, as they feel the mass in S, and alternating ones have no averages. T has a row
of 27 numbers per cell: a Chebyshev iteration of some twenty steps costs less than a product with K.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix, diags

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.fem.incompressibility.volume_split import VolumeSplit
from gpusim.fem.multigrid.smoothers import chebyshev

# axes along which a pressure alternates
_FAMILIES = ((True, True, False), (False, True, True), (True, False, True), (True, True, True))
# weight of all hat functions together: as many of them overlap
_SHARE = 0.3
# of the mass: B A^-1 B^T is at most volume over modulus, and less where something can give way
_MASS = 0.7
# steps, and the ratio of eigenvalues over which they are even
_STEPS, _RANGE = 20, 300.0


class PressureScaling:
    """r -> Q^-1 r for pressures (M,), with Q about B A^-1 B^T + C.

    ``diagonal`` (N,3) is that of A, zero where fixed; all in the units of ``split``.
    """

    def __init__(self, split: VolumeSplit, diagonal: Float) -> None:
        lattice = split.lattice
        assert lattice is not None
        shape = lattice.cell.shape
        self._shape = shape
        self._at = np.ravel_multi_index(tuple(split.place.T), shape)
        self._inverse = np.where(
            split.split, 1.0 / (_MASS * split.volume / split.shear + split.compliance), 0.0
        )
        self._split = split.split
        has_pressure = np.zeros(shape, dtype=bool)
        has_pressure.ravel()[self._at] = split.split
        compliance = np.zeros(shape)
        compliance.ravel()[self._at] = np.where(split.split, split.compliance, 0.0)
        grid = np.zeros((*lattice.node.shape, 3))
        softness = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
        grid[tuple(lattice.place.T)] = softness
        whole = _touched(has_pressure) == _touched(np.ones(shape, dtype=bool))
        size = [np.diff(planes) for planes in lattice.planes]
        self._hats: list[tuple[list[Float | None], Float]] = []
        for family in _FAMILIES:
            step = 2
            while step <= max(n for n, along in zip(shape, family, strict=True) if along):
                hats = [_hats(n, step) if along else None
                        for n, along in zip(shape, family, strict=True)]  # fmt: skip
                energy = _energy(hats, size, grid, whole, compliance)
                inverse = np.divide(_SHARE, energy, out=np.zeros_like(energy), where=energy > 0.0)
                signed = [None if one is None else _alternating(one) for one in hats]
                self._hats.append((signed, inverse))
                step *= 2

    def apply(self, r: Float) -> Float:
        """Q^-1 r, (M,)."""
        grid = np.zeros(self._shape)
        grid.ravel()[self._at] = r
        total = np.zeros(self._shape)
        for hats, inverse in self._hats:
            total += _along(_along(grid, hats, True) * inverse, hats, False)
        return np.asarray(self._inverse * r + np.where(self._split, total.ravel()[self._at], 0.0))


def _hats(cells: int, step: int) -> Float:
    """(cells, knots): values at the middles of the cells of hat functions ``step`` cells wide."""
    knots = np.linspace(0.0, cells, max(1, round(cells / step)) + 1)
    middle = np.arange(cells) + 0.5
    return np.asarray(np.maximum(0.0, 1.0 - np.abs(middle[:, None] - knots) / knots[1]))


def _alternating(hats: Float) -> Float:
    return hats * (1.0 - 2.0 * (np.arange(len(hats)) % 2))[:, None]


def _along(values: Float, factors: list[Float | None], transposed: bool) -> Float:
    """(X,Y,Z) multiplied along each axis by a matrix, or its transpose."""
    for axis, factor in enumerate(factors):
        if factor is None:
            continue
        matrix = factor.T if transposed else factor
        if axis == 0:
            values = (matrix @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])
        elif axis == 1:
            values = np.matmul(matrix, values)
        else:
            values = values @ matrix.T
    return np.asarray(values)


def _touched(cells: Bool) -> Long:
    """(X+1,Y+1,Z+1): how many of the cells around each node are set."""
    padded = np.pad(cells.astype(np.int64), 1)
    for axis in range(3):
        values = np.moveaxis(padded, axis, 0)
        padded = np.moveaxis(values[1:] + values[:-1], 0, axis)
    return padded


def _energy(
    hats: list[Float | None], size: list[Float], softness: Float, whole: Bool, compliance: Float
) -> Float:
    """t . (B D^-1 B^T + C) t of every product t of hats, without forming any.

    Differences and means of products are products of differences and means. Beside cells which are
    missing (``whole`` is False) nothing is taken to cancel, which gives an upper bound.
    """
    signed = [None if one is None else _alternating(one) for one in hats]
    total = _along(compliance, [None if one is None else one**2 for one in hats], True)
    for component in range(3):
        of_component = softness[..., component]
        for part, absolute in (
            (np.where(whole, of_component, 0.0), False),
            (np.where(whole, 0.0, of_component), True),
        ):
            if not part.any():
                continue
            factors: list[Float | None] = []
            for axis, hat in enumerate(hats if absolute else signed):
                cells = len(size[axis])
                hat = np.eye(cells) if hat is None else hat
                below, above = np.eye(cells + 1, cells), np.eye(cells + 1, cells, -1)
                if axis == component:
                    spread = above + below if absolute else above - below
                else:
                    spread = 0.5 * (above + below) * size[axis]
                factors.append((spread @ hat) ** 2)
            total = total + _along(part, factors, True)
    return total


class PressureChebyshev:
    """r -> Q^-1 r for pressures (M,), with Q about B A^-1 B^T + C; as ``PressureScaling``."""

    def __init__(self, split: VolumeSplit, diagonal: Float) -> None:
        softness = np.divide(1.0, diagonal, out=np.zeros_like(diagonal), where=diagonal > 0.0)
        b = split.divergence
        averages, weight = _averages(split, len(diagonal))
        t = b @ diags(softness.ravel()) @ b.T + averages.T @ diags(weight) @ averages
        t = csr_matrix(t + diags(split.compliance))
        self._inverse = 1.0 / t.diagonal()
        self._t = t
        # Gershgorin's bound: a quarter above the greatest eigenvalue, and never below
        largest = float((np.asarray(abs(t).sum(axis=1)).ravel() * self._inverse).max())
        self._steps = chebyshev(largest / _RANGE, largest, _STEPS)

    def apply(self, r: Float) -> Float:
        """Q^-1 r, (M,)."""
        x = np.zeros_like(r)
        d = np.zeros_like(r)
        residual = r
        for number, step in enumerate(self._steps):
            if number:
                residual = residual - self._t @ d
            d = step.keep * d + step.gain * (self._inverse * residual)
            x += d
        return x


def _averages(split: VolumeSplit, nodes: int) -> tuple[csr_matrix, Float]:
    """Averages of pressures around nodes, by volume, (N,M), and volume over modulus there (N,)."""
    count = len(split.volume)
    volume = np.where(split.split, split.volume, 0.0)
    cell = np.repeat(np.arange(count), split.nodes.shape[1])
    node = split.nodes.ravel()
    total = np.bincount(node, weights=volume[cell], minlength=nodes)
    share = volume[cell] / np.where(total > 0.0, total, 1.0)[node]
    weight = np.bincount(node, weights=(volume / split.shear)[cell], minlength=nodes)
    return csr_matrix((share, (node, cell)), shape=(nodes, count)), weight / split.nodes.shape[1]
