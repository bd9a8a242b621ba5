"""Match subsets of one image in another: inverse-compositional Gauss-Newton, ZNSSD.

Driver of ``shaders/measure/correlation/icgn.wgsl`` and its NumPy twin. For each subset the
reference grey values f(s), the warped deformed ones g(W(s)) and the steepest-descent images J(s)
give the step::

    e   = (f - mean f) - scale (g - offset)              scale, offset from the last iteration
    J'  = J - mean J - fc (fc . J) / (fc . fc)           fc = f - mean f: offset and gain taken out
    step = -(sum w J' J'^T)^-1  sum w J' e               W <- W o step^-1

Means and dots are weighted with the window w. Because J' is orthogonal to a change of offset and
of gain, the fixed point is the minimum of the ZNSSD (Baker and Matthews 2004; Pan, Li, Tong 2013).
Working with the small difference e instead of g keeps float32 sums good on the device.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.gpu import Device
from gpusim.gpu.adapter import is_processor
from gpusim.measure.correlation.image_pair import (
    Limits,
    Pair,
    Sampled,
    Subsets,
    Tile,
    plan_tiles,
    subset_pixels,
)
from gpusim.measure.correlation.matching import Correlation, Settings, Status
from gpusim.measure.correlation.warp import (
    COEFFICIENTS,
    SHAPES,
    UNKNOWNS,
    Shape,
    basis,
    compose_inverse,
    steepest_descent,
    step_coefficients,
)
from gpusim.measure.images import PAD

MIN_PIVOT = 1e-5  # of a Cholesky pivot over its diagonal: below, a motion can't be told
MIN_CONTRAST = 5e-4  # standard deviation of a subset over the grey range of the image
MIN_WEIGHT = 0.3  # share of the window that the mask must leave
FASTEST = 0.03  # ratio of two steps that is trusted to go on
MAX_NOISE = 0.75  # share of noise in the squared slopes that is reckoned with
PATIENCE = 20  # iterations after which a subset counts as lost that has no more than …
HOPELESS = 0.5  # … this share of the correlation that it needs
CHUNK = 1 << 17  # pixels handled at once by the twin
# threads of a workgroup; on a CPU, one vector of eight: what a subset does once isn't repeated
THREADS, THREADS_CPU = 32, 8
DISPATCH = 1 << 20  # subsets in one dispatch: their rows fit into a binding
# status in the kernel's output: needs coefficients that aren't loaded, or more turns of loops
UNFINISHED = 100
# that llvmpipe gives a thread; then loops end, wherever they are, and sums lack what is left
TURNS = 65535
SPREAD = 1.5  # half widths that the pixels of a subset are expected to lie from its point


def correlate_numpy(subsets: Subsets, settings: Settings) -> Correlation:
    """Match every subset in float64 on the host."""
    count = len(subsets.points)
    chunk = max(1, CHUNK // settings.window.size)
    result = Correlation.unmatched(count)
    for start in range(0, count, chunk):
        part = slice(start, start + chunk)
        result.put(part, _correlate_chunk(subsets, settings, part))
    return result


@dataclass(frozen=True)
class References:
    """B subsets of the reference, n pixels each, and what stays the same in all iterations.

    column, row : (B, n) int64, pixels of the whole image.    weight : (B, n), window and mask.
    total : (B,), sum of the weights.    f : (B, n), grey values less their mean.
    energy : (B,), weighted squares of f.    terms : (K, B, n), the warp's terms.
    weighted : (U, B, n), weighted steepest-descent images.    factor : (B, U, U), Cholesky.
    status : (B,) int8, `NOT_CONVERGED` for those that can be matched.
    """

    column: Long
    row: Long
    weight: Float
    total: Float
    f: Float
    energy: Float
    terms: Float
    weighted: Float
    factor: Float
    status: npt.NDArray[np.int8]


def references(pair: Pair, points: Float, settings: Settings) -> References:
    half, shape = settings.half, settings.shape
    status = np.full(len(points), Status.NOT_CONVERGED, dtype=np.int8)
    column, row = subset_pixels(points, half)
    spline = pair.reference
    in_crop: Bool = np.all(spline.inside(column.astype(np.float64), row.astype(np.float64)), axis=1)
    status[~in_crop] = Status.OUTSIDE
    first_x = np.where(in_crop, column[:, 0] - spline.origin[0], 0)
    first_y = np.where(in_crop, row[:, 0] - spline.origin[1], 0)
    planes = pair.planes_at(first_x, first_y, 2 * half + 1)
    weight = settings.window.ravel() * planes[..., 3]
    total = weight.sum(axis=1)
    masked = in_crop & ~(total >= MIN_WEIGHT * settings.window.sum())
    masked |= in_crop & ~(total > UNKNOWNS[shape] + 2)
    status[masked] = Status.OUTSIDE
    total = np.where(total > 0, total, 1.0)
    f = planes[..., 0]
    f = f - ((weight * f).sum(axis=1) / total)[:, None]
    energy = (weight * f * f).sum(axis=1)
    flat = ~(energy > MIN_CONTRAST**2 * total)
    safe_energy = np.where(flat, 1.0, energy)

    a = (column - points[:, :1]) / half
    b = (row - points[:, 1:]) / half
    descent = steepest_descent(shape, planes[..., 1], planes[..., 2], a, b)
    descent -= ((weight * descent).sum(axis=2) / total)[:, :, None]
    descent -= ((weight * f * descent).sum(axis=2) / safe_energy)[:, :, None] * f
    weighted = weight * descent
    factor, solvable = cholesky(np.einsum("ibn,jbn->bij", weighted, descent))
    status[in_crop & ~masked & (flat | ~solvable)] = Status.NO_TEXTURE
    terms = basis(a, b, COEFFICIENTS[shape])
    return References(column, row, weight, total, f, energy, terms, weighted, factor, status)


def _correlate_chunk(subsets: Subsets, settings: Settings, part: slice) -> Correlation:
    pair, shape = subsets.pair, settings.shape
    start = subsets.start[part]
    ref = references(pair, subsets.points[part], settings)
    status = ref.status
    number = len(status)
    iterations = np.zeros(number, dtype=np.int32)
    zncc, sigma, residual = np.full((3, number), np.nan)
    low, scale = pair.deformed_range
    c = start.copy()
    contrast, level, before = np.ones(number), np.zeros(number), np.zeros(number)
    active = np.flatnonzero(status == Status.NOT_CONVERGED)
    for iteration in range(1, settings.max_iterations + 1):
        iterations[active] = iteration
        terms = ref.terms[:, active]
        motion = np.einsum("bik,kbn->ibn", c[active][:, :, : len(terms)], terms)
        x = ref.column[active] + motion[0]
        y = ref.row[active] + motion[1]
        inside = pair.deformed.inside(x, y).all(axis=1)
        status[active[~inside]] = Status.OUTSIDE
        active, x, y = active[inside], x[inside], y[inside]
        if active.size == 0:
            break
        g = (pair.deformed.values(x, y) - low) * scale
        w, fa, ta = ref.weight[active], ref.f[active], ref.total[active]
        if iteration == 1:
            level[active] = (w * g).sum(axis=1) / ta
        e = fa - contrast[active][:, None] * (g - level[active][:, None])
        mean = (w * e).sum(axis=1) / ta
        e -= mean[:, None]
        along = (w * fa * e).sum(axis=1)
        rest = (w * e * e).sum(axis=1)
        fe = ref.energy[active]
        ge = fe - 2.0 * along + rest
        live = ge > 1e-10 * fe
        ge = np.where(live, ge, 1.0)
        zncc[active] = np.where(live, (fe - along) / np.sqrt(fe * ge), 0.0)
        live &= (iteration < PATIENCE) | (zncc[active] >= HOPELESS * settings.min_zncc)
        level[active] -= mean / contrast[active]
        contrast[active] *= np.where(live, np.sqrt(fe / ge), 1.0)
        gradient = -np.einsum("ibn,bn->bi", ref.weighted[:, active], e)
        change = step_coefficients(shape, solve(ref.factor[active], gradient))
        c[active] = compose_inverse(shape, c[active], change, settings.half)
        size = np.abs(change).sum(axis=2).max(axis=1)
        done = remaining(size, before[active]) <= settings.tolerance
        before[active] = size
        move = np.abs(c[active][:, :, 0] - start[active][:, :, 0]).max(axis=1)
        lost = ~(live & (move <= settings.max_move))
        status[active[done & ~lost]] = Status.OK
        if done.any():
            variance = np.maximum(fe * rest - along**2, 0.0) / ge / (ta - UNKNOWNS[shape] - 2)
            residual[active] = variance
            noise = settings.slope_noise * (1.0 - zncc[active]) * fe
            spread = np.maximum(*displacement_variance(ref.factor[active], shape, noise))
            sigma[active] = np.sqrt(variance * spread)
        active = active[~(done | lost)]
    status[(status == Status.OK) & ~(zncc >= settings.min_zncc)] = Status.LOW_CORRELATION
    result = Correlation(c, zncc, sigma, residual, iterations, status)
    result.refuse(~result.ok, status[~result.ok])
    return result


def remaining(size: Float, before: Float) -> Float:
    """What is still to go after steps of ``size``, px, from the one ``before`` (0: none).

    Gauss-Newton steps shrink by a constant ratio near the solution, so what is left after a step is
    size (r + r^2 + ...) = size r / (1 - r). A ratio seen only once isn't trusted below 0.1, nor
    used above 0.5.
    """
    ratio = np.maximum(size / np.maximum(before, 1e-30), FASTEST)
    trusted = (before > 0) & (ratio < 0.5)
    ratio = np.where(trusted, ratio, 0.5)
    return np.asarray(size * ratio / (1.0 - ratio))


def displacement_variance(factor: Float, shape: Shape, noise: Float) -> tuple[Float, Float]:
    """Diagonal entries of the inverse normal matrix for the two displacement unknowns.

    ``noise`` (B,) is what noise adds to each sum of squared slopes. It tells nothing of a motion,
    so that a share r of it in a sum makes the displacement 1 / (1 - r) times as uncertain.
    """
    second = 1 if shape in ("translation", "rigid") else COEFFICIENTS[shape]
    entries = []
    for index in (0, second):
        unit = np.zeros(factor.shape[:2])
        unit[:, index] = 1.0
        share = noise / (factor[:, index] ** 2).sum(axis=1)
        widening = 1.0 / (1.0 - np.clip(share, 0.0, MAX_NOISE))
        entries.append(widening**2 * solve(factor, unit)[:, index])
    return entries[0], entries[1]


def correlate(
    subsets: Subsets,
    settings: Settings,
    device: Device | None = None,
    limits: Limits = Limits(),  # noqa: B008 - immutable
) -> Correlation:
    """Match every subset on ``device``, or with the NumPy twin if there is none.

    The images may be of any size: they are taken to the device in parts (see ``image_tiles``). A
    subset that wanders out of its part, though not out of the image, is matched by the twin, and so
    are large ones that take many iterations on a processor (see `TURNS`).
    """
    if device is None:
        return correlate_numpy(subsets, settings)
    pair, half = subsets.pair, settings.half
    centre = np.rint(subsets.points)
    corner = np.array([[-half, -half], [half, half]])
    corners = centre[:, None] + corner
    within: Bool = np.all(pair.reference.inside(corners[..., 0], corners[..., 1]), axis=1)
    target = np.rint(subsets.start[:, :, 0])
    which = np.flatnonzero(within)
    values = np.full((within.size, 17), np.nan)
    values[:, 13] = 0.0
    values[:, 14] = Status.OUTSIDE
    if which.size:
        pixel = (centre[which] - pair.reference.origin).astype(np.int64)
        limit = 2**24  # a start further away than float32 counts pixels is outside any image
        there = centre[which] + target[which] - pair.deformed.origin + PAD
        begin = np.clip(there, -limit, limit).astype(np.int64)
        reach = ceil(SPREAD * half + min(settings.max_move, 4 * half)) + PAD
        for tile in plan_tiles(pair.reference, pair.deformed, pixel, begin, half, reach, limits):
            for first in range(0, tile.which.size, DISPATCH):
                part = replace(tile, which=tile.which[first : first + DISPATCH])
                values[which[part.which]] = _dispatch(
                    device, subsets, settings, limits, part, which, pixel, begin
                )
        values[which, 0] += target[which, 0]
        values[which, 6] += target[which, 1]
    status = values[:, 14].astype(np.int8)
    zncc = np.where(values[:, 12] >= -1.0 - 1e-5, values[:, 12], np.nan)
    status[(status == Status.OK) & ~(zncc >= settings.min_zncc)] = Status.LOW_CORRELATION
    good = status == Status.OK
    result = Correlation(
        np.where(good[:, None, None], values[:, :12].reshape(-1, 2, 6), np.nan),
        zncc,
        np.where(good, values[:, 15], np.nan),
        np.where(good, values[:, 16], np.nan),
        values[:, 13].astype(np.int32),
        status,
    )
    stray = np.flatnonzero(status == UNFINISHED)
    if stray.size:
        again = Subsets(pair, subsets.points[stray], subsets.start[stray])
        result.put(stray, correlate_numpy(again, settings))
    return result


def _affordable(settings: Settings) -> int:
    """Iterations of a subset that a thread is sure to have turns of loops for.

    Threads of a vector take turns together: each counts those of pixels by the nine, too.
    """
    width, unknowns = 2 * settings.half + 1, UNKNOWNS[settings.shape]
    thirds = ceil(width / 3)
    line_by_line, by_nine = (thirds + 1) * width, (thirds + 1) * thirds
    once, solving = 2 * line_by_line + 2 * unknowns**3, 2 * unknowns**2
    return max(0, (TURNS - once) // (line_by_line + by_nine + solving))


def _dispatch(
    device: Device,
    subsets: Subsets,
    settings: Settings,
    limits: Limits,
    tile: Tile,
    which: Long,
    pixel: Long,
    begin: Long,
) -> Float:
    """Run the kernel over the subsets of a tile; (K, 17) raw rows as the shader writes them.

    ``which`` are the rows of ``subsets`` that ``pixel`` and ``begin`` (see ``plan_tiles``) and the
    tile count from.
    """
    pair = subsets.pair
    rows = which[tile.which]
    (left, top, _, _), (x0, y0, x1, y1) = tile.reference, tile.deformed
    places = np.concatenate([pixel[tile.which] - (left, top), begin[tile.which] - (x0, y0)], axis=1)
    start = subsets.start[rows].copy()
    start[:, :, 0] -= np.rint(start[:, :, 0])
    fraction = subsets.points[rows] - np.rint(subsets.points[rows])
    starts = np.concatenate([fraction, start.reshape(-1, 12)], axis=1)
    origin = np.array(pair.deformed.origin * 2) - PAD + (x0, y0, x0, y0)
    image = np.array(pair.deformed.valid, dtype=np.int64) - origin
    # the taps of a pixel reach from 2 before it to 3 behind, and SLACK may take the one before
    low, high = np.array([3, 3]), np.array([x1 - x0 - 4, y1 - y0 - 4])
    box = np.concatenate([np.maximum(image[:2], low), np.minimum(image[2:], high)])
    threads = THREADS_CPU if is_processor(device.info) else THREADS
    kernel = device.kernel(
        "measure/correlation/icgn",
        entry="main",
        constants={
            "shape": SHAPES.index(settings.shape),
            "unknowns": UNKNOWNS[settings.shape],
            "threads": threads,
            "windowed": bool((settings.window != 1).any()),
        },
    )
    result = device.empty(rows.size * 68, label="measure.icgn.result")
    bindings = kernel.bind(
        params={
            "count": rows.size,
            "half": settings.half,
            "max_iterations": settings.max_iterations,
            "affordable": _affordable(settings) if is_processor(device.info) else 2**31,
            "tolerance": settings.tolerance,
            "max_move": settings.max_move,
            "least_zncc": HOPELESS * settings.min_zncc,
            "slope_noise": settings.slope_noise,
            "window_sum": float(settings.window.sum()),
            "beyond": Status.OUTSIDE if (box == image).all() else UNFINISHED,
            "box": box,
        },
        reference=pair.texture(device, "reference", tile.reference, limits),
        deformed=pair.texture(device, "deformed", tile.deformed, limits),
        window=Sampled(device, settings.window.astype(np.float32), "measure.icgn.window"),
        places=device.buffer(places.astype(np.int32), label="measure.icgn.places"),
        starts=device.buffer(starts.astype(np.float32), label="measure.icgn.starts"),
        result=result,
    )
    lines = -(-rows.size // (65535 * threads))
    with device.recording("measure.icgn") as recording:
        recording.dispatch(kernel, bindings, groups=(-(-rows.size // (lines * threads)), lines, 1))
    values: Float = result.read(np.float32, (rows.size, 17)).astype(np.float64)
    return values


def cholesky(matrix: Float) -> tuple[Float, Bool]:
    """Lower factors of (B, P, P) matrices and whether each is safely positive definite."""
    size = matrix.shape[1]
    factor = np.zeros_like(matrix)
    good = np.ones(matrix.shape[0], dtype=bool)
    largest = np.einsum("bii->bi", matrix).max(axis=1)
    for j in range(size):
        diagonal = matrix[:, j, j]
        pivot = diagonal - (factor[:, j, :j] ** 2).sum(axis=1)
        good &= (pivot > MIN_PIVOT * diagonal) & (diagonal > MIN_PIVOT**2 * largest)
        root = np.sqrt(np.where(good, pivot, 1.0))
        factor[:, j, j] = root
        for i in range(j + 1, size):
            dot = (factor[:, i, :j] * factor[:, j, :j]).sum(axis=1)
            factor[:, i, j] = (matrix[:, i, j] - dot) / root
    return factor, good


def solve(factor: Float, right: Float) -> Float:
    """Solve L L^T x = right for (B, P, P) factors and (B, P) right sides."""
    size = factor.shape[1]
    x = right.copy()
    for i in range(size):
        x[:, i] = (x[:, i] - (factor[:, i, :i] * x[:, :i]).sum(axis=1)) / factor[:, i, i]
    for i in reversed(range(size)):
        x[:, i] = (x[:, i] - (factor[:, i + 1 :, i] * x[:, i + 1 :]).sum(axis=1)) / factor[:, i, i]
    return x
