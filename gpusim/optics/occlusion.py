"""Which share of a lamp a point sees: exact outlines of the faces between, on a mask of samples.

Seen from a receiver at the origin, a face with corners D_k hides the direction L if L lies on the
same side of all planes through the receiver and its edges: sign((D_k x D_k+1) . L) is that of the
face's own side. Along a row of samples on the lamp this is linear, so that each face covers an
interval of 32 bits (Eisemann and Decoret, "Visibility sampling on GPU and applications", 2007,
with exact outlines in place of a table). Nothing is biased: of closed bodies only faces whose
outside looks at the receiver can begin a shadow, so that no surface shadows itself, and contacts
are exact: a receiver in a face's plane is hidden by it if the two look at each other, as a floor is
under a box (samples of a pixel beside the box reach there).

The 512 samples are a lattice: 512 distinct places along either side of the lamp. Each of the 16
rows looks from another place in the pixel, so that a shadow sharper than a pixel is filtered as
its edges are; a lamp without size uses the whole lattice for that. Where the plane of an open
surface's face passes through the pixel or the halves of those around it, at no more than 60 degrees
to the receiver's, all rows look from its middle: what the receiver's plane goes on to beyond an
edge may lie behind the next faces. Twin of
``shaders/common/occlusion.wgsl``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.emitters import Lamp
from gpusim.optics.ragged import expand

__all__ = ["COLUMNS", "ROWS", "TOLERANCE", "Chained", "lamp_masks", "lattice", "visible_share"]

Array = npt.NDArray[np.float64]
ROWS, COLUMNS = 16, 32
TOLERANCE = 2e-6
"""A face begins no shadow nearer to its plane than this times the distance from the eye."""

AGAINST = -0.5
"""Cosine between the normals of face and receiver below which they may lie against each other."""

BESIDE = 0.5
"""Cosine between the normals of face and receiver, up to their signs, above which the receiver may
be part of a sheet that goes on with the face. What stands on it or cuts it is steeper."""

ENOUGH_EDGES = 3
"""Edges of a face at which all of its corners lie: the last corner of a quad lies between two."""

CHUNK = 1 << 9
"""Pairs of receivers and faces at a time, so that they stay in the processor's cache."""

SURE = 1.0 + 1e-9
"""Of the most that a lamp's function changes over its samples, beyond which it keeps its sign."""

STEP_A, STEP_B = 2.0 / COLUMNS, 2.0 / (ROWS * COLUMNS)


SHIFT = (14, 8, 2, 12, 6, 0, 10, 4, 11, 5, 15, 9, 3, 13, 7, 1)
OFFSET = (13, 8, 1, 15, 4, 6, 14, 2, 3, 9, 12, 7, 0, 10, 5, 11)
STRIP = (0, 2, 4, 6, 8, 10, 12, 14, 1, 3, 5, 7, 9, 11, 13, 15)
"""Places of the rows of samples, from a search for the least errors over lamp and pixel: of edges
in all directions, of penumbrae of all widths, of those along the lamp's sides above all."""


def lattice() -> Array:
    """(16, 4): -a or a and b (-1 to 1) of the first sample of each row, the pixel offset in x that
    the row looks from, and the direction (1 or -1) that a takes along it (of a lamp with a size).

    Sample c of a row lies ``STEP_A`` c further along a and ``STEP_B`` c in b. On its way the offset
    in y goes once through the pixel, so that no strip of the lamp is looked at from one side.
    """
    row = np.arange(ROWS)
    return np.stack(
        [
            STEP_A * (np.array(SHIFT) + 0.5) / ROWS - 1.0,
            2.0 * (np.array(STRIP) + 0.5 / COLUMNS) / ROWS - 1.0,
            (np.array(OFFSET) + 0.5) / ROWS - 0.5,
            np.where(row < ROWS // 2, 1.0, -1.0),
        ],
        axis=1,
    )


def lamp_masks(lamp: Lamp) -> npt.NDArray[np.uint32]:
    """(16,) words: the samples of the lattice that lie on the lamp's face."""
    if not lamp.round or not lamp.extended:
        return np.full(ROWS, 0xFFFFFFFF, np.uint32)
    column = np.arange(COLUMNS)
    a = lattice()[:, :1] + STEP_A * column
    b = lattice()[:, 1:2] + STEP_B * column
    bits = ((a * a + b * b <= 1.0) * (1 << column.astype(np.uint64))).sum(axis=1)
    result: npt.NDArray[np.uint32] = bits.astype(np.uint32)
    return result


@dataclass(frozen=True, eq=False)
class Chained:
    """Pairs of receivers and edges of outlines: ``receiver`` (n,) sorted; ``ends`` (n, 2, 3) of the
    edge; ``cut`` (n, 4): normal and offset of a plane beyond which the outline hides the lamp;
    ``last`` (n,): whether the edge is the outline's last one; ``scan`` (3,): the direction in which
    edges before a sample are counted."""

    receiver: npt.NDArray[np.int64]
    ends: Array
    cut: Array
    last: npt.NDArray[np.bool_]
    scan: Array


def visible_share(
    lamp: Lamp,
    at: Array,
    normal: Array,
    across: Array,
    down: Array,
    receiver: npt.NDArray[np.int64],
    corners: Array,
    both_sides: npt.NDArray[np.bool_],
    tolerance: Array,
    edges: npt.NDArray[np.uint8],
    chained: Chained | None = None,
) -> Array:
    """Share (N,) of a lamp that receivers at (N, 3) see, 0 to 1.

    Parameters
    ----------
    lamp : its centre in the frame of ``at``.
    normal : (N, 3) unit normals of the receivers.
    across, down : (N, 3) how the receiver's place changes per pixel column and row.
    receiver : (P,) sorted: the receiver of each pair; ``corners`` (P, 4, 3) the face that may hide
        the lamp from it, counter-clockwise seen from outside, and ``both_sides`` (P,) whether
        its inside hides as well.
    tolerance : (N,) distance to a face's plane within which it hides nothing.
    edges : (P,) bit k for the k-th edge of the face; all of the lamp lies inside of the others.
    chained : edges of outlines that may hide the lamp, too.
    """
    masks = lamp_masks(lamp)
    total = int(np.bitwise_count(masks).sum())
    covered = np.zeros((len(at), ROWS), np.uint32)
    for start in range(0, len(receiver), 8 * CHUNK):
        part = slice(start, start + 8 * CHUNK)
        own = receiver[part]
        bits = _covered(
            lamp, at[own], normal[own], across[own], down[own], corners[part], both_sides[part],
            tolerance[own], edges[part],
        )  # fmt: skip
        np.bitwise_or.at(covered, own, bits)
    if chained is not None and len(chained.receiver):
        own, bits = _wound(lamp, at, across, down, chained)
        np.bitwise_or.at(covered, own, bits)
    free = np.bitwise_count(masks & ~covered).sum(axis=1)
    result: Array = free / total
    return result


def _covered(
    lamp: Lamp,
    at: Array,
    looks: Array,
    across: Array,
    down: Array,
    corners: Array,
    both_sides: npt.NDArray[np.bool_],
    tolerance: Array,
    edges: npt.NDArray[np.uint8],
) -> npt.NDArray[np.uint32]:
    """(P, 16) words: the samples that each face hides from its receiver."""
    near = 0.0 if lamp.far else 1.0
    to = lamp.centre - near * at
    D = corners - at[:, None]
    following = np.roll(D, -1, axis=1)
    planes = np.cross(D, following)
    normal = planes.sum(axis=1)
    height = np.sum(normal * D.mean(axis=1), axis=1)
    size = np.linalg.norm(normal, axis=1)
    against = ~both_sides & (np.abs(height) <= tolerance * size)
    against &= np.sum(normal * looks, axis=1) < AGAINST * size
    counts = (np.where(both_sides, np.abs(height), -height) > tolerance * size) | against
    sign = np.where((height > 0.0) & ~against, 1.0, -1.0)[:, None]
    # a plane that has the receiver and the whole lamp on one side comes between for neither
    apart = sign[:, 0] * (np.sum(normal * to, axis=1) - near * height)
    counts &= apart + np.abs(normal @ lamp.u) + np.abs(normal @ lamp.v) > 0.0
    value = sign * np.einsum("pka,pa->pk", planes, to)
    turned = np.cross(to[:, None], following - D) - near * planes
    # seen from beyond its plane, a face would seem to hide what lies behind the receiver
    spread = np.abs(np.sum(normal * across, axis=1)) + np.abs(np.sum(normal * down, axis=1))
    passes = np.abs(height) < spread
    crossed = both_sides & passes
    crossed &= np.abs(np.sum(normal * looks, axis=1)) > BESIDE * size
    moves = np.where(crossed, 0.0, sign[:, 0])[:, None]
    gx = moves * np.einsum("pka,pa->pk", turned, across)
    gy = moves * np.einsum("pka,pa->pk", turned, down)
    if lamp.extended:
        a, b = sign * (planes @ lamp.u), sign * (planes @ lamp.v)
    else:
        a, b, gx, gy = 0.5 * gx, 0.5 * gy, 0.0 * gx, 0.0 * gy
    asked = (edges[:, None] >> np.arange(4, dtype=np.uint8) & 1).astype(bool)
    value[~asked] = 1.0
    a, b, gx, gy = (np.where(asked, v, 0.0) for v in (a, b, gx, gy))
    # seen edge-on, as its plane passes through the pixel, a face would seem to hide what lies on
    # its other side from the samples beyond the plane: it can't where no corner is towards the
    # lamp, or over the receiver's plane, as all of the lamp is
    over = np.cross(across, down)
    over *= np.sign(np.sum(over * looks, axis=1))[:, None]
    whole = np.sum(over * to, axis=1) > np.abs(over @ lamp.u) + np.abs(over @ lamp.v)
    level = np.where(whole, tolerance * np.linalg.norm(over, axis=1), -np.inf)
    rises = np.einsum("pka,pa->pk", D, over) > level[:, None]
    ahead = np.einsum("pka,pa->pk", D, to) > 0.0
    hides = (np.any(ahead, axis=1) & np.any(rises, axis=1)) | (
        np.bitwise_count(edges) < ENOUGH_EDGES
    )
    counts &= ~passes | against | hides
    # a face beside all of the lamp and the pixel hides nothing
    most = value + np.abs(a) + np.abs(b) + 0.5 * (np.abs(gx) + np.abs(gy))
    counts &= (most[:, 0] >= 0.0) & (most[:, 1] >= 0.0) & (most[:, 2] >= 0.0) & (most[:, 3] >= 0.0)
    some = np.flatnonzero(counts)
    result = np.zeros((len(at), ROWS), np.uint32)
    for start in range(0, len(some), CHUNK):
        part = some[start : start + CHUNK]
        result[part] = _bits(lamp, *(v[part].T[..., None] for v in (value, a, b, gx, gy)))
    return result


def _wound(
    lamp: Lamp, at: Array, across: Array, down: Array, chained: Chained
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint32]]:
    """Receivers (n,) and the samples (n, 16) that an outline hides from each: those that its edges
    wind round: as many lie before them one way round less the other, modulo 8."""
    cut, own = chained.cut, chained.receiver
    hides = cut[:, 0] * at[own, 0] + cut[:, 1] * at[own, 1] + cut[:, 2] * at[own, 2] > cut[:, 3]
    kept = np.flatnonzero(hides)
    chained = Chained(own[kept], chained.ends[kept], cut[kept], chained.last[kept], chained.scan)
    stop = np.flatnonzero(chained.last)
    begin = np.concatenate([[0], stop[:-1] + 1])
    outline, turn = expand(stop + 1 - begin)
    ones, twos, fours = np.zeros((3, len(stop), ROWS), np.uint32)
    edges: list[npt.NDArray[np.int64]] = []
    bits: list[npt.NDArray[np.uint32]] = []
    for start in range(0, len(outline), 8 * CHUNK):
        part = slice(start, start + 8 * CHUNK)
        rows, before, ends = _before(
            lamp, at, across, down, chained.receiver[part], chained.ends[part], chained.scan
        )
        edges.append(start + rows)
        bits.append(np.stack([before, ends]))
    edge = np.concatenate([np.zeros(0, np.int64), *edges])
    every = np.concatenate([np.zeros((2, 0, ROWS), np.uint32), *bits], axis=1)
    # one edge of each outline after the other
    order = np.argsort(turn[edge], kind="stable")
    for own_order in np.split(order, np.flatnonzero(np.diff(turn[edge[order]])) + 1):
        own, (before, ends) = outline[edge[own_order]], every[:, own_order]
        carried = before & (ones[own] ^ ends)
        fours[own] ^= carried & (twos[own] ^ ends)
        twos[own] ^= carried
        ones[own] ^= before
    return chained.receiver[begin], ones | twos | fours


def _before(
    lamp: Lamp, at: Array, across: Array, down: Array, own: npt.NDArray[np.int64], ends: Array,
    scan: Array,
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint32], npt.NDArray[np.uint32]]:  # fmt: skip
    """Rows (n,) of edges with ``ends`` (P, 2, 3) that some samples of receivers ``own`` (P,) may
    lie before, these samples (n, 16), and those on the positive side of the second end."""
    near = 0.0 if lamp.far else 1.0

    def side(rows: npt.NDArray[np.int64], first: Array, way: Array) -> Array:
        """(5, n): the function of the lamp that a plane through receivers is, from it to
        ``first`` and about ``way``."""
        normal, to = np.cross(first, way), lamp.centre - near * at[own[rows]]
        turned = np.cross(to, way) - near * normal
        gx, gy = (np.sum(turned * change[own[rows]], axis=1) for change in (across, down))
        value = np.sum(normal * to, axis=1)
        if lamp.extended:
            return np.stack([value, normal @ lamp.u, normal @ lamp.v, gx, gy])
        return np.stack([value, 0.5 * gx, 0.5 * gy, 0.0 * gx, 0.0 * gy])

    def samples(of: Array) -> npt.NDArray[np.uint32]:
        return _bits(lamp, *(v[None, :, None] for v in of))

    every = np.arange(len(own))
    first, last = ends[:, 0] - at[own], ends[:, 1] - at[own]
    scans = np.broadcast_to(scan, first.shape)
    one, other = side(every, first, scans), side(every, last, scans)
    # both ends on one side of all samples: none lies between
    sure = [np.abs(v[0]) > SURE * (np.abs(v[1:3]).sum(axis=0) + np.abs(v[3:]).sum(axis=0))
            for v in (one, other)]  # fmt: skip
    rows = np.flatnonzero(~(sure[0] & sure[1] & (one[0] * other[0] > 0.0)))
    low, high = samples(one[:, rows]), samples(other[:, rows])
    between = np.flatnonzero((low != high).any(axis=1))
    rows, low, high = rows[between], low[between], high[between]
    edge = samples(side(rows, first[rows], last[rows] - first[rows]))
    return rows, (low ^ high) & ~(low ^ edge), high


def _bits(
    lamp: Lamp, value: Array, a: Array, b: Array, gx: Array, gy: Array
) -> npt.NDArray[np.uint32]:
    """(P, 16) words: the samples inside of edges, by their functions (k, P, 1) of the lamp."""
    rows = lattice().T
    count = value.shape[1]
    low, high = np.zeros((count, ROWS)), np.full((count, ROWS), float(COLUMNS))
    # edge by edge: passes along an axis of four take several times as long
    for edge in range(len(value)):
        along = (rows[3] if lamp.extended else 1.0) * a[edge] + 0.5 * gy[edge]
        first = value[edge] + rows[0] * along + rows[1] * b[edge] + rows[2] * gx[edge]
        slope = STEP_A * along + STEP_B * b[edge]
        cut = -first / np.where(slope != 0.0, slope, 1.0)
        np.maximum(low, np.where(slope > 0.0, cut, 0.0), out=low)
        np.minimum(high, np.where(slope < 0.0, cut, float(COLUMNS)), out=high)
        high[(slope == 0.0) & (first < 0.0)] = -1.0
    begin = np.ceil(np.clip(low, 0.0, COLUMNS)).astype(np.uint64)
    end = np.ceil(np.clip(high, 0.0, COLUMNS)).astype(np.uint64)
    one = np.uint64(1)
    bits = ((one << end) - one) & ~((one << begin) - one)
    return np.where(low < high, bits, 0).astype(np.uint32)
