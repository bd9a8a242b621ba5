"""Whether a subset is torn: a line across it on whose two sides it moved differently.

An affine or quadratic warp hides a small jump well: the ninths of the subset (see
``subset_consistency``) move by as little as nothing from a line put through a step. So the step is
looked for itself. What the match leaves, e, is explained to first order by a motion field d of the
subset, e = J d, in two ways: a polynomial of second degree plus a jump across a line, the best of
lines in all directions and places; and a polynomial of fourth degree. Beside either, an even and a
tilted change of brightness and one of contrast are fitted. A subset is torn if the jump explains
about as much as the terms of third and fourth degree do: of a step they explain 0.64 on average,
more near the rim. Lines must be tried densely, or the best of them explains no more of a jump than
they do.

Sums over pixels are taken once per cell of the subset; within a cell the field counts as constant.
That is enough to see whether something is left (`COARSE`); to tell what it is, cells and lines are
made `FINE`: of jumps of 0.25 to 1.4 px the terms of higher degree then explain 0.6 to 0.9 of what
the line does, of waves 1.2 times to three times that, where it was 0.8 to 1.4 and 1.0 to 2.5.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from gpusim.arrays.array_types import Float, Long, Single

DEGREES = (3, 4)  # of the polynomials that a jump is compared with
SAMPLES = 5  # along each side of a cell, for its share on one side of a line
SECTORS = 6  # of half a turn, by which subsets are sorted before fine lines are tried
# rad: from a sector's first coarse direction: to those beside both of it, and between
STEPS = np.arange(-2, 5) * np.pi / 24
RIDGE = 1e-5  # of the diagonal: what no pixel tells stays 0
KNOWN = 1e-2  # share of a jump's own sum of squares that the rest must not explain


@dataclass(frozen=True)
class Search:
    """How densely lines are tried.

    cells : along each side of a subset.      directions : across a line, in half a turn, rad.
    offsets : of a line from the centre, half widths.
    """

    cells: int
    directions: tuple[float, ...]
    offsets: tuple[float, ...]


COARSE = Search(
    7,
    tuple(np.linspace(0.0, np.pi, 12, endpoint=False).tolist()),
    (-0.7, -0.55, -0.4, -0.25, -0.1, 0.1, 0.25, 0.4, 0.55, 0.7),
)
# for each sector of half a turn: coarse lines there tell where to try fine ones
FINE = tuple(
    Search(15, tuple((first + STEPS).tolist()), tuple(np.linspace(-0.75, 0.75, 24).tolist()))
    for first in np.linspace(0.0, np.pi, SECTORS, endpoint=False)
)


@dataclass(frozen=True)
class Discontinuities:
    """The jump that explains most of what is left in each of B subsets.

    length : (B,) float32, px.      sector : (B,) int64, of its coarse line's direction.
    sure : (B,) float32, what it explains over the variance that then is left: the square of its
        distance from 0 in standard deviations. For noise alone 7 on average, 25 once in 1000.
    """

    length: Single
    sector: Long
    sure: Single
    _noise: Single
    _moments: tuple[Single, ...]
    _polynomials: Single
    _cross: Single
    _by_rest: Single

    def smooth(self, which: Long) -> Single:
        """What terms of third and fourth degree explain of subsets ``which``, likewise, less what
        they do of noise: (len(which),) float32."""
        moments = tuple(moment[which] for moment in self._moments)
        explained = _smooth(moments, self._polynomials, self._cross[which], self._by_rest[which])
        return explained / self._noise[which] - 2 * len(self._polynomials)


@dataclass(frozen=True)
class _Fields:
    """Motions of a subset's cells, (., cells^2): what is fitted, what is asked for beside it."""

    known: Single
    smooth: Single
    sides: Single


def fit_discontinuities(
    weight: Float,
    slopes: tuple[Float, Float],
    grey: Float,
    rest: Float,
    search: Search = COARSE,
) -> Discontinuities:
    """Look for a jump in each of B subsets of n = size^2 pixels, row by row.

    weight : (B, n), 0 where a pixel isn't used.      slopes : by x and by y, (B, n).
    grey : (B, n), reference values less their mean.  rest : (B, n), what the match leaves of them.
    """
    number = min(search.cells, round(np.sqrt(weight.shape[1])))
    fields = _fields(replace(search, cells=number))
    # single precision: what is compared differs by factors
    w, x, y, f, e = (v.astype(np.float32) for v in (weight, *slopes, grey, rest))
    cells = _cell_sums(w, number)
    # columns: known motions by x, by y, brightness even and tilted, contrast
    both = np.concatenate([fields.known, fields.smooth, fields.sides])
    count, terms, tests = len(weight), len(fields.known), len(both) - len(fields.known)
    linear = fields.known[:3]
    light = slice(2 * terms, 2 * terms + len(linear))
    unknowns = light.stop + 1
    normal = np.empty((count, unknowns, unknowns), dtype=np.float32)
    cross = np.empty((count, unknowns, 2, tests), dtype=np.float32)
    right = np.empty((count, unknowns), dtype=np.float32)
    moments = cells(x * x), cells(x * y), cells(y * y)
    blocks = [_sums(fields.known, moment, both) for moment in moments]
    for i, slope in enumerate((x, y)):
        rows = slice(i * terms, (i + 1) * terms)
        for j in range(2):
            normal[:, rows, j * terms : (j + 1) * terms] = blocks[i + j][:, :, :terms]
            cross[:, rows, j] = blocks[i + j][:, :, terms:]
        block = _sums(linear, cells(slope), both)
        normal[:, light, rows] = block[:, :, :terms]
        normal[:, rows, light] = block[:, :, :terms].transpose(0, 2, 1)
        cross[:, light, i] = block[:, :, terms:]
        along = cells(slope * f) @ both.T
        normal[:, -1, rows] = normal[:, rows, -1] = along[:, :terms]
        cross[:, -1, i] = along[:, terms:]
    normal[:, light, light] = _sums(linear, cells(np.ones_like(f)), linear)
    normal[:, -1, light] = normal[:, light, -1] = cells(f) @ linear.T
    normal[:, -1, -1] = (w * f * f).sum(axis=1)
    sums = np.stack([cells(slope * e) @ both.T for slope in (x, y)], axis=1)
    right[:, : light.start] = sums[:, :, :terms].reshape(count, -1)
    right[:, light] = cells(e) @ linear.T
    right[:, -1] = (w * f * e).sum(axis=1)

    # what the known part explains is taken out of everything
    whiten = _whitening(normal)
    flat = whiten @ cross.reshape(count, unknowns, -1)
    scaled = whiten @ right[:, :, None]
    by_rest = sums[:, :, terms:] - (flat.transpose(0, 2, 1) @ scaled).reshape(count, 2, tests)
    unexplained = (w * e * e).sum(axis=1) - (scaled[:, :, 0] ** 2).sum(axis=1)

    flat = flat.reshape(count, unknowns, 2, tests)
    sides = [m @ (fields.sides**2).T for m in moments]
    place = slice(len(fields.smooth), tests)
    length, explained, line = _best_side(sides, flat[:, :, :, place], by_rest[:, :, place])
    pixels = (w > 0).sum(axis=1)
    noise = np.maximum(unexplained - explained, 1e-30) / np.maximum(pixels - unknowns - 2, 1)
    return Discontinuities(
        length, line * SECTORS // len(fields.sides), explained / noise,
        noise, moments, fields.smooth, flat[:, :, :, : place.start], by_rest[:, :, : place.start],
    )  # fmt: skip


def _cell_sums(weight: Single, number: int) -> Callable[[Single], Single]:
    """Weighted sums (B, number^2), over the cells of subsets, of values (B, n)."""
    size = round(np.sqrt(weight.shape[1]))
    # cells begin at k size / number
    cell = (np.arange(size) * number + number - 1) // size
    member = (cell[:, None] == np.arange(number)).astype(np.float32)

    def sums(values: Single) -> Single:
        lines = ((weight * values).reshape(-1, size) @ member).reshape(-1, size, number)
        return np.asarray((member.T @ lines).reshape(len(weight), -1))

    return sums


def _whitening(normal: Single) -> Single:
    """L^-1 (B, Q, Q), where N = L L': sums of squares that the known part explains are those of
    L^-1 c."""
    diagonal = np.einsum("bii->bi", normal).astype(np.float64)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = normal * scale[:, :, None] * scale[:, None, :]
    np.einsum("bii->bi", scaled)[:] += RIDGE
    whiten = np.linalg.inv(np.linalg.cholesky(scaled)) * scale[:, None, :]
    return whiten.astype(np.float32)


def _best_side(tests: list[Single], cross: Single, by_rest: Single) -> tuple[Single, Single, Long]:
    """Length of the jump that explains most, how much, and which, (B,); ``cross`` is whitened."""
    xx, xy, yy = (
        tests[i + j] - np.einsum("bus,bus->bs", cross[:, :, i], cross[:, :, j])
        for i, j in ((0, 0), (0, 1), (1, 1))
    )
    determinant = xx * yy - xy * xy
    usable = (xx > KNOWN * tests[0]) & (yy > KNOWN * tests[2]) & (determinant > KNOWN * xx * yy)
    divisor = np.where(usable, determinant, 1.0)
    ex, ey = by_rest[:, 0], by_rest[:, 1]
    dx, dy = (yy * ex - xy * ey) / divisor, (xx * ey - xy * ex) / divisor
    explained = np.where(usable, dx * ex + dy * ey, 0.0)
    best = np.arange(len(ex)), np.argmax(explained, axis=1)
    length = np.where(usable[best], np.hypot(dx[best], dy[best]), 0.0)
    return length, np.asarray(explained[best]), best[1]


def _smooth(
    moments: tuple[Single, ...],
    smooth: Single,
    cross: Single,
    by_rest: Single,
) -> Single:
    """What the terms of third and fourth degree explain, (B,); ``cross`` is whitened."""
    count, terms = len(cross), len(smooth)
    square = np.empty((count, 2, terms, 2, terms), dtype=np.float32)
    for i, j in ((0, 0), (0, 1), (1, 1)):
        square[:, i, :, j] = square[:, j, :, i] = _sums(smooth, moments[i + j], smooth)
    matrix = square.reshape(count, 2 * terms, 2 * terms)
    diagonal = np.einsum("bii->bi", matrix).copy()
    taken = cross.reshape(count, cross.shape[1], 2 * terms)
    matrix = matrix - taken.transpose(0, 2, 1) @ taken
    matrix[:, np.arange(2 * terms), np.arange(2 * terms)] += RIDGE * diagonal + 1e-30
    right = by_rest.reshape(count, 2 * terms)
    return np.asarray((right * np.linalg.solve(matrix, right[:, :, None])[:, :, 0]).sum(axis=1))


def _sums(first: Single, moments: Single, second: Single) -> Single:
    """Sums over cells of first_i moment second_j: (B, len(first), len(second))."""
    # one product of two matrices: a stack of them would be one call of BLAS each
    rows = (moments[:, None, :] * first).reshape(-1, first.shape[1])
    return np.asarray((rows @ second.T).reshape(len(moments), len(first), len(second)))


@lru_cache(maxsize=32)
def _fields(search: Search) -> _Fields:
    """Polynomials at the cells' centres, and -1/2..1/2 for the two sides of each line."""
    cells = search.cells
    middle = (np.arange(cells) + 0.5) * 2.0 / cells - 1.0
    b, a = (axis.ravel() for axis in np.meshgrid(middle, middle, indexing="ij"))
    known = np.stack([a**0, a, b, a * a, a * b, b * b])
    smooth = np.stack([a**i * b ** (n - i) for n in DEGREES for i in range(n + 1)])
    fine = (np.arange(cells * SAMPLES) + 0.5) * 2.0 / (cells * SAMPLES) - 1.0
    y, x = np.meshgrid(fine, fine, indexing="ij")
    sides = []
    for turn in search.directions:
        across = x * np.cos(turn) + y * np.sin(turn)
        for offset in search.offsets:
            side = (across > offset).reshape(cells, SAMPLES, cells, SAMPLES).mean(axis=(1, 3))
            sides.append(side.ravel() - 0.5)
    return _Fields(*(v.astype(np.float32) for v in (known, smooth, np.stack(sides))))
