"""Block Davidson iteration: the greatest mu of B x = mu A x, A positive definite.

Vibration has A = K + s M and B = M, mu = 1 / (lambda + s); buckling A = K and B = -K_g, mu = 1 over
the load factor. A may be solved with exactly, and the basis is that of block shift-invert Lanczos,
or nearly, and the whole history of a preconditioned iteration serves (Davidson, J. Comput. Phys. 17
(1975) 87; Stathopoulos & McCombs, SIAM J. Sci. Comput. 29 (2007) 2162).

The basis is orthonormal in A: rounding in motions of high energy, 1e14 times that of the lowest
mode of a slender beam, then doesn't reach the low ones. The residual r = B x - mu A x and the
correction t = A^-1 r tell the error for nothing: with eta^2 = r.t / mu^2 an eigenvalue lies within
eta mu, and within about eta^2 / gap, where gap is the relative distance of the next ones. An inner
solve that isn't definite, r.t <= 0, tells nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.errors import NotConverged

Apply = Callable[[Float], Float]

# vectors a step, or an eighth of those wanted: steps cost the cube of the basis, too
_BLOCK = 8
# sought beside what is wanted, to a tenth: gaps are those to converged values then
_GUARDS, _GUARD_ERROR = 2, 0.1
# relative distance below which values are one cluster, whose vectors may be any of their span
_CLUSTER = 1e-2
# eta^2 / gap has been 0.7 of the true error once, among a hundred runs
_SAFETY = 3.0
# what the last correction, which isn't in eta, takes off vectors' angles at least
_CORRECTED = 2.0
# a second start of so many random vectors, and steps of inverse iteration of these
_FRESH, _LOOKS = 2, 6
# rows whose share that isn't in the others' span is less, squared
_DEPENDENT = 1e-12
# share of a row's energy outside of the basis up to which that is rounding: exact corrections have
# none in it
_NOTHING_NEW = 1e-8
# passes at most; least eigenvalue of unit rows' products from which on they are made orthonormal
# without loss, and shares of the basis' rows that may stay in them
_PASSES, _WELL, _APART = 4, 1e-3, 1e-11
# steps after which it won't get there
_STEPS, _STEPS_OF_EACH = 60, 8
# of values: less is no motion of them
_ROUNDING = 1e-9
# of the energy that a motion and its forces could have: less than none is no rounding
_INDEFINITE = -1e-8


@dataclass(frozen=True, eq=False)
class Pencil:
    """B x = mu A x on rows x (L,n), zero where nothing is ``unknown`` (n,).

    ``energy``: A x; ``inertia``: B x; ``solve``: nearly A^-1 x, symmetric, ``weakest`` the least
    eigenvalue of what it makes of A. ``known`` (k,n): A-orthonormal eigenvectors that are left out.
    Values of no more than ``negligible`` times the greatest size of any aren't looked for.
    """

    energy: Apply
    inertia: Apply
    solve: Apply
    unknown: Bool
    known: Float
    weakest: float = 1.0
    negligible: float = 0.0

    @property
    def size(self) -> int:
        """Dimensions of what is solved for."""
        return int(np.count_nonzero(self.unknown))

    def random(self, count: int, seed: int) -> Float:
        """Rows in which low modes prevail."""
        rows = np.random.default_rng(seed).standard_normal((count, len(self.unknown)))
        return self.solve(np.where(self.unknown, rows, 0.0))


@dataclass(frozen=True, eq=False)
class Eigenpairs:
    """``values`` mu (k,), the greatest first, of A-orthonormal ``vectors`` (k,n); ``error`` (k,) of
    mu, relative, estimated; ``least``: the least mu that was seen, at least the least there is."""

    values: Float
    vectors: Float
    error: Float
    converged: bool
    steps: int
    least: float


class _Basis:
    """Rows orthonormal in A, the known ones first, and A times them."""

    def __init__(self, pencil: Pencil, most: int) -> None:
        self._pencil, self._known = pencil, len(pencil.known)
        shape = self._known + most, len(pencil.unknown)
        self._rows, self._energy = np.empty(shape), np.empty(shape)
        self._products = np.zeros((most, most))
        self._size = self._known
        if self._known:
            self._rows[: self._known] = pencil.known
            self._energy[: self._known] = pencil.energy(pencil.known)

    def fits(self, count: int) -> bool:
        return self._size + count <= len(self._rows)

    def ritz(self) -> tuple[Float, Float]:
        """Values (m,), the greatest first, and the shares of the rows in their vectors (m,m)."""
        size = self._size - self._known
        products = self._products[:size, :size]
        values, vectors = np.linalg.eigh(0.5 * (products + products.T))
        return values[::-1], vectors[:, ::-1].T

    def combined(self, shares: Float) -> tuple[Float, Float]:
        """Vectors of ``shares`` (k,m), and A times them."""
        own = slice(self._known, self._size)
        return shares @ self._rows[own], shares @ self._energy[own]

    def last(self, count: int) -> Float:
        """The rows that came last."""
        return self._rows[self._size - count : self._size]

    def restart(self, values: Float, shares: Float) -> None:
        """Keep these Ritz vectors alone."""
        rows, energy = self.combined(shares)
        self._size = self._known + len(values)
        self._rows[self._known : self._size] = rows
        self._energy[self._known : self._size] = energy
        self._products[: len(values), : len(values)] = np.diag(values)

    def extend(self, new: Float) -> int:
        """Add what is new in rows ``new``; how many that were."""
        new, image = self._orthonormal(new)
        before, self._size = self._size, self._size + len(new)
        self._rows[before : self._size], self._energy[before : self._size] = new, image
        across = self._rows[self._known : self._size] @ self._pencil.inertia(new).T
        own = slice(before - self._known, len(across))
        self._products[: len(across), own] = across
        self._products[own, : len(across)] = across.T
        return len(new)

    def _orthonormal(self, new: Float) -> tuple[Float, Float]:
        """Rows made orthonormal to the basis and to one another, and A times them."""
        rows, energy = self._rows[: self._size], self._energy[: self._size]
        image, well = new, False
        for number in range(_PASSES):
            shares = new @ energy.T
            if not len(new) or (well and np.abs(shares).max(initial=0.0) < _APART):
                break
            new = new - shares @ rows
            # what is taken off unit rows is rounding: it needs no product
            image = image - shares @ energy if well else self._pencil.energy(new)
            if not number:
                taken = np.einsum("ij,ij->i", shares, shares)
                stale = np.abs(np.einsum("ij,ij->i", new, image)) <= _NOTHING_NEW * taken
                new, image = new[~stale], image[~stale]
            gram = new @ image.T
            _require_definite(new, image, gram.diagonal())
            size = 1.0 / np.sqrt(np.maximum(gram.diagonal(), 1e-300))
            values, vectors = np.linalg.eigh(gram * size[:, None] * size)
            good = values > _DEPENDENT
            # beyond the last dimension there is but rounding
            good[: max(len(good) - self._pencil.size + len(rows), 0)] = False
            turn = (vectors[:, good] / np.sqrt(values[good])).T * size
            new, image = turn @ new, turn @ image
            well = bool((values > _WELL).all())
        return new, image


def _require_definite(rows: Float, image: Float, energy: Float) -> None:
    if not np.isfinite(energy).all():
        raise NotConverged("modes: got values that aren't finite; expected finite numbers")
    most = np.linalg.norm(rows, axis=1) * np.linalg.norm(image, axis=1)
    if not (energy >= _INDEFINITE * most).all():
        raise NotConverged(
            "modes: got a motion whose energy isn't positive; expected a stable body (is it loaded "
            "beyond buckling? do elements lack stiffness, as single rows of 'reduced' ones do?)"
        )


class _Errors:
    """Of the values looked for, ``eta`` (k,), inf where nothing is known: ``count`` of them are
    wanted to a ``tolerance``, their vectors to its root, the others are guards."""

    def __init__(self, count: int, guards: int, tolerance: float) -> None:
        self._count, self._tolerance = count, tolerance
        self.eta, self._values = np.full(count + guards, np.inf), np.zeros(count + guards)
        self._settled = np.zeros(count + guards, dtype=bool)

    def open(self, values: Float, negligible: float) -> Long:
        """Those of the Ritz ``values`` (m,) that aren't good enough yet."""
        ritz = values[: len(self.eta)]
        here = slice(len(ritz))
        # a value that moves by more than its error is another one
        moved = np.abs(ritz - self._values[here])
        same = moved <= np.maximum(self.eta[here], _ROUNDING) * np.abs(ritz)
        self.eta[here][~same] = np.inf
        self._settled[here] &= same
        gap = gaps(values, len(ritz))
        aims = np.sqrt(self._tolerance * np.minimum((_CORRECTED * gap) ** 2, gap / _SAFETY))
        wanted = np.arange(len(ritz)) < self._count
        good = self.eta[here] <= np.where(wanted, aims, _GUARD_ERROR)
        good |= self._settled[here]
        return np.flatnonzero(~good & (ritz > negligible * np.abs(values).max()))

    def settle(self, which: Long) -> bool:
        """Rounding hides what is left of the error of ``which`` values; False where it is known of
        none."""
        self._settled[which] = np.isfinite(self.eta[which])
        return bool(self._settled[which].any())

    def tell(self, which: Long, values: Float, squares: Float) -> None:
        """Residual times correction of ``which`` values (m,)."""
        self.eta[which] = np.sqrt(np.where(squares >= 0.0, squares, np.inf)) / np.abs(values)
        self._values[which] = values


def davidson(
    pencil: Pencil,
    count: int,
    tolerance: float,
    start: Float,
    progress: Callable[[int, float], None] | None = None,
) -> Eigenpairs:
    """The ``count`` greatest mu, from the rows of ``start``, each to ``tolerance``, and their
    vectors to its root (as angles, those of a cluster as angles of their span).

    When all are good a second start, from other random rows, looks for what the first one may have
    missed. ``progress`` is called with (steps, worst error).
    """
    wanted = min(count + _GUARDS, pencil.size - len(pencil.known))
    block = max(_BLOCK, wanted // _BLOCK)
    basis = _Basis(pencil, 2 * wanted + 24 + max(block, len(start)))
    errors = _Errors(count, wanted - count, tolerance)
    added, looks, limit = basis.extend(start), 0, _STEPS + _STEPS_OF_EACH * wanted
    for step in range(limit):
        values, shares = basis.ritz()
        if len(values) + len(pencil.known) == pencil.size:
            errors.tell(np.arange(wanted), values[:wanted], np.zeros(wanted))
            break
        todo = errors.open(values, pencil.negligible)[:block]
        if len(todo):
            vectors, energy = basis.combined(shares[todo])
            residual = pencil.inertia(vectors) - values[todo, None] * energy
            new = pencil.solve(residual)
            squares = np.einsum("ij,ij->i", residual, new) / pencil.weakest
            errors.tell(todo, values[todo], squares)
        elif len(values) < wanted:
            new = pencil.random(block, step + 1)
        elif looks < _LOOKS:
            # what was missed isn't in the basis: inverse iteration beside it brings it up
            forces = pencil.inertia(basis.last(added))
            new = pencil.solve(forces) if looks else pencil.random(_FRESH, step + 1)
            looks += 1
        else:
            break
        if progress is not None:
            progress(step + 1, float(errors.eta[:count].max()))
        if not basis.fits(len(new)):
            # and the least value, which tells of the other end
            keep = np.append(np.arange(wanted + block), len(values) - 1)
            basis.restart(values[keep], shares[keep])
        if len(new):
            added = basis.extend(new)
            if not added and not errors.settle(todo):
                # nothing is left to be found, or nothing is known of what is
                break
    values, shares = basis.ritz()
    found, eta = slice(min(count, len(values))), errors.eta[:count]
    missing = errors.open(values, pencil.negligible)
    return Eigenpairs(
        values[found],
        basis.combined(shares[found])[0],
        np.minimum(eta, _SAFETY * eta**2 / gaps(values, count))[found],
        len(values) >= wanted and not (missing < count).any(),
        step + 1,
        float(values[-1]),
    )


def gaps(values: Float, count: int) -> Float:
    """(count,) relative distances of the first of ``values`` (m,), less than 1, to the next one
    outside of its cluster."""
    first = values[:count, None]
    away = np.abs(1.0 - values / np.where(first == 0.0, 1.0, first))
    return np.asarray(np.where(away > _CLUSTER, away, 1.0).min(axis=1, initial=1.0))
