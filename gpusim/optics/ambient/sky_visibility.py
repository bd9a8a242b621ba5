"""How open surfaces lie to their surroundings: shares of light at nodes spread over a view.

Every triangle of the view is cut into pieces of at most a few dozen px, and where the share isn't
linear over a piece, that into a lattice of 2, 4 or 8 cells a side (a few px at least); between the
nodes of a lattice it is linear. `gpusim.optics.ambient.hemisphere_mask` tells what a node sees.
Nodes lie a little inside the smooth surface around them, so that those in a corner see its other
side; those that a body stands on, or that lie inside one, take the value that their neighbours lead
to, so that the line along which bodies touch stays sharp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.arrays.unique import distinct
from gpusim.gpu import Device
from gpusim.gpu.texture_array import Texels
from gpusim.optics.ambient.hemisphere_mask import (
    HemisphereMasks,
    hemisphere_masks,
    hemisphere_masks_twin,
)
from gpusim.optics.ambient.silhouette_bvh import SamplePoints
from gpusim.optics.ambient.silhouette_search import SilhouetteBuffers, in_groups
from gpusim.optics.ambient.sky_occluders import JoinedFaces
from gpusim.optics.geometry.interpenetration import Discontinuities
from gpusim.optics.geometry.triangle_corners import NORMAL, POSITION
from gpusim.optics.geometry.view import View
from gpusim.surface.surface import Surface

Value = Callable[[HemisphereMasks, Float], Float]
"""Shares (N,) of the light of points, from what they see and their normals (N, 3)."""

PIECE, PIECES = 32.0, 64.0
"""The longest edge of a piece: px, or if that is more, this part of the image's diagonal."""

STEP = 8.0
"""Part of a piece that is the shortest edge of a cell."""

MOST_PIECES = 128
"""Of a triangle's edge."""

GAP = 4
"""Cells of a piece's edge whose nodes tell that nothing of it shows."""

FINEST = 8
"""Cells of a piece's edge."""

EVEN, TOLERANCE = 0.04, 0.004
"""A piece whose corners differ by less is even; a lattice is fine enough where that of half its
cells is off by less: it is itself off by about a quarter of that."""

INSIDE = 0.01
"""Share of the way to the middle of the pieces around it that a node is moved by."""


@dataclass(frozen=True, eq=False)
class SkyVisibility:
    """Shares over a view's triangles.

    ``pieces`` (T,): cells that a triangle's edges are cut into, n; ``first`` (T,): the first of
    its 2 n^2 pieces: 2 (j n + i) is the one at (i, j) / n of the way along its first and its last
    edge, the one after it the other half of that parallelogram. ``cells`` (P,): cells m of a
    piece's edges, 0 beyond the triangle; ``start`` (P,): the first of its (m + 1)^2 ``values``, in
    rows along its first edge. The other half runs backwards. ``planes`` (T, 2, 4): the place along
    both edges, affine in the position relative to the eye. ``nodes``: how many were looked from.
    """

    planes: Float
    pieces: Long
    first: Long
    cells: Long
    start: Long
    values: Float
    nodes: int

    @staticmethod
    def build(
        view: View, surfaces: Sequence[Surface], value: Value, device: Device | None
    ) -> SkyVisibility:
        """Look from as many nodes as it takes; in NumPy without ``device``."""
        T = view.camera.camera_from_world
        corners = view.corners[:, :, POSITION] @ T[:3, :3]
        normals = view.corners[:, :, NORMAL]
        longest = _longest(view.screen)
        piece = max(PIECE, float(np.hypot(view.camera.width, view.camera.height)) / PIECES)
        power = np.clip(np.ceil(np.log2(np.maximum(longest / piece, 1.0))), 0, 7)
        pieces = np.minimum(2**power, MOST_PIECES).astype(np.int64)
        slots = 2 * pieces**2
        first = np.cumsum(slots) - slots
        triangle, slot, place = _pieces(pieces, first)
        small = longest[triangle] / pieces[triangle]
        finest = np.minimum(2 ** np.ceil(np.log2(np.maximum(STEP * small / piece, 1.0))), FINEST)
        nodes = _Nodes(JoinedFaces.of(view, surfaces), value, device)
        cut_off = Discontinuities.of(view, surfaces, corners)
        cells = np.zeros(int(slots.sum()), np.int64)
        due, m = np.flatnonzero(_in_image(view, triangle, place)), 1
        cells[slot] = 1  # pieces outside the image share three values that nobody reads
        leaves: list[tuple[Long, Float]] = []
        before = np.zeros(0)
        while len(due):
            triangles = triangle[due]
            at, normal = _on_lattice(place[due], corners[triangles], normals[triangles], m)
            shares, even, buried = nodes.look(at, normal)
            if cut_off is not None:
                buried |= cut_off.behind(triangles, at)
            # a gap may show between nodes that all lie under bodies
            under = buried.all(axis=1)
            rough = np.where(under, m < GAP, buried.any(axis=1))
            if m == 1:
                rough |= ~under & (np.ptp(even, axis=1) > EVEN)
            else:
                off = np.where(buried, 0.0, np.abs(even - before))
                rough |= off.max(axis=1) > TOLERANCE
            further = rough & (finest[due] > m)
            grid = _grids(shares, buried, m)
            done = due[~further]
            cells[slot[done]] = m
            leaves.append((slot[done], grid[~further].reshape(-1)))
            due = due[further]
            before = _finer(_grids(even, buried & False, m)[further], m)
            m *= 2
        nodes.release()
        start = np.zeros(len(cells), np.int64)
        values, filled = [np.ones(4)], 4
        for number, shares in leaves:
            size = len(shares) // max(len(number), 1)
            start[number] = filled + size * np.arange(len(number))
            values.append(shares)
            filled += len(shares)
        return SkyVisibility(
            _places(corners), pieces, first, cells, start, np.concatenate(values), nodes.count
        )

    def at(self, triangle: Long, x: Float) -> Float:
        """Shares (n,) at positions (n, 3) relative to the eye, on triangles (n,)."""
        planes = self.planes[triangle]
        uv = np.einsum("nka,na->nk", planes[:, :, :3], x) + planes[:, :, 3]
        n = self.pieces[triangle]
        cell, part = _cell(uv, n)
        upper = part.sum(axis=1) > 1.0
        piece = self.first[triangle] + 2 * (cell[:, 1] * n + cell[:, 0]) + upper
        m = self.cells[piece]
        cell, part = _cell(np.where(upper[:, None], 1.0 - part, part), m)
        i = self.start[piece] + cell[:, 1] * (m + 1) + cell[:, 0]
        p, q = part.T
        corner = [self.values[i + k] for k in (0, 1)] + [self.values[i + m + 1 + k] for k in (0, 1)]
        low = corner[0] + p * (corner[1] - corner[0]) + q * (corner[2] - corner[0])
        high = corner[3] + (1.0 - p) * (corner[2] - corner[3]) + (1.0 - q) * (corner[1] - corner[3])
        result: Float = np.where(p + q > 1.0, high, low)
        return result


def lattice(m: int) -> tuple[Float, Float]:
    """Places (N,) and (N,) along two edges of a triangle's nodes, row by row, m cells an edge."""
    j, i = np.nonzero(np.add.outer(np.arange(m + 1), np.arange(m + 1)) <= m)
    return i / m, j / m


def _on_lattice(place: Float, corners: Float, normals: Float, m: int) -> tuple[Float, Float]:
    """Positions and normals (P, N, 3) of the nodes of pieces, which lie at ``place`` (P, 3, 2) in
    triangles of these corners and normals (P, 3, 3)."""
    u, v = lattice(m)
    uv = place[:, None, 0] + u[:, None] * (place[:, 1] - place[:, 0])[:, None]
    uv = uv + v[:, None] * (place[:, 2] - place[:, 0])[:, None]
    s, t = uv[..., :1], uv[..., 1:]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    at = corners[:, None, 0] + s * a[:, None] + t * b[:, None]
    return at, (1.0 - s - t) * normals[:, None, 0] + s * normals[:, None, 1] + t * normals[
        :, None, 2
    ]


def _cell(uv: Float, n: Long) -> tuple[Long, Float]:
    """Of places (k, 2) in a triangle of n (k,) cells an edge: the cell, and the place in it."""
    uv = np.maximum(uv, 0.0)
    most = 1.0 - 1e-5
    uv = uv * (n * most / np.maximum(uv.sum(axis=1), most))[:, None]
    cell = np.floor(uv)
    return cell.astype(np.int64), uv - cell


def _longest(screen: Float) -> Float:
    """px, (T,)."""
    edges = screen - np.roll(screen, -1, axis=1)
    result: Float = np.sqrt((edges * edges).sum(axis=2)).max(axis=1, initial=0.0)
    return result


def _places(corners: Float) -> Float:
    """(T, 2, 4): how far along the edges a and b from the first of ``corners`` (T, 3, 3) a position
    is, affine in it."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    aa, ab, bb = (np.sum(x * y, axis=1)[:, None] for x, y in ((a, a), (a, b), (b, b)))
    area = np.maximum(aa * bb - ab * ab, 1e-300)
    result = np.zeros((len(a), 2, 4))
    result[:, 0, :3], result[:, 1, :3] = (bb * a - ab * b) / area, (aa * b - ab * a) / area
    result[:, :, 3] = -np.einsum("nka,na->nk", result[:, :, :3], corners[:, 0])
    return result


def _pieces(count: Long, first: Long) -> tuple[Long, Long, Float]:
    """Of all pieces (P,): triangle, slot, and the places (P, 3, 2) of their corners in it."""
    triangles, slots, places = [], [], [np.zeros((0, 3, 2))]
    corner = np.array([[[0, 0], [1, 0], [0, 1]], [[1, 1], [0, 1], [1, 0]]], np.float64)
    for n in np.flatnonzero(np.bincount(count, minlength=1)):
        parents = np.flatnonzero(count == n)
        j, i, half = np.nonzero(
            np.add.outer(np.add.outer(np.arange(n), np.arange(n)), np.arange(2)) < n
        )
        at = (np.stack([i, j], axis=1)[:, None] + corner[half]) / n
        triangles.append(np.repeat(parents, len(i)))
        slots.append((first[parents][:, None] + 2 * (j * n + i) + half).reshape(-1))
        places.append(np.tile(at, (len(parents), 1, 1)))
    none = np.zeros(0, np.int64)
    return (
        np.concatenate([none, *triangles]), np.concatenate([none, *slots]), np.concatenate(places)
    )  # fmt: skip


def _in_image(view: View, triangle: Long, place: Float) -> Bool:
    """Which pieces (P,) with corners at places (P, 3, 2) in triangles may be in the image."""
    if view.camera.lens is not None:
        return np.ones(len(triangle), bool)
    corners = view.corners[triangle][:, :, POSITION]
    weight = np.concatenate([1.0 - place.sum(axis=2, keepdims=True), place], axis=2)
    x, y, w = np.moveaxis(np.einsum("pkc,pca->pka", weight, corners) @ view.camera.K.T, 2, 0)
    limits = ((x, view.camera.width), (y, view.camera.height))
    return np.asarray(
        np.all([(a > -w).any(axis=1) & (a < n * w).any(axis=1) for a, n in limits], axis=0)
    )


def _grids(shares: Float, buried: Bool, m: int) -> Float:
    """(P, m + 1, m + 1) of nodes (P, N): what is buried continues its neighbours."""
    u, v = lattice(m)
    i, j = np.rint(m * u).astype(np.int64), np.rint(m * v).astype(np.int64)
    grid = np.full((len(shares), m + 5, m + 5), np.nan)
    grid[:, j + 2, i + 2] = np.where(buried, np.nan, shares)
    inner = (slice(None), slice(2, m + 3), slice(2, m + 3))
    needed = np.zeros((m + 1, m + 1), bool)
    needed[j, i] = True
    for _ in range(2 * m):
        if not np.isnan(grid[:, j + 2, i + 2]).any():
            break
        total, count = np.zeros_like(grid[inner]), np.zeros_like(grid[inner])
        for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0), (1, -1), (-1, 1)):
            one = grid[:, 2 + dj : m + 3 + dj, 2 + di : m + 3 + di]
            two = grid[:, 2 + 2 * dj : m + 3 + 2 * dj, 2 + 2 * di : m + 3 + 2 * di]
            leads = np.where(np.isnan(two), one, np.clip(2.0 * one - two, 0.0, 1.0))
            total += np.where(np.isnan(leads), 0.0, leads)
            count += ~np.isnan(leads)
        fill = np.isnan(grid[inner]) & needed & (count > 0)
        grid[inner] = np.where(fill, total / np.maximum(count, 1), grid[inner])
    result: Float = np.nan_to_num(grid[inner], nan=0.0)
    return result


def _finer(grids: Float, m: int) -> Float:
    """What lattices (P, m + 1, m + 1) say at the nodes of those of twice the cells, (P, N)."""
    u, v = lattice(2 * m)
    i, j = np.rint(2 * m * u).astype(np.int64), np.rint(2 * m * v).astype(np.int64)
    # a node between two others lies on one of the three kinds of edges
    low = grids[:, j // 2, i // 2]
    both = (i % 2 == 1) & (j % 2 == 1)
    other = grids[:, (j + 1) // 2, (i + 1) // 2]
    across = 0.5 * (grids[:, j // 2, (i + 1) // 2] + grids[:, (j + 1) // 2, i // 2])
    result: Float = np.where(both, across, 0.5 * (low + other))
    return result


class _Nodes:
    """Shares at nodes; those of places that were looked from before are known."""

    def __init__(self, joined: JoinedFaces, value: Value, device: Device | None) -> None:
        self.joined, self.value = joined, value
        self._tables = None if device is None else SilhouetteBuffers(device, joined.contours)
        self._key = np.zeros(0, np.int64)
        self._share, self._even, self._buried = np.zeros(0), np.zeros(0), np.zeros(0, bool)

    def release(self) -> None:
        """Free what the device holds."""
        if self._tables is not None:
            self._tables.release()

    @property
    def count(self) -> int:
        """How many were looked from."""
        return len(self._key)

    def look(self, at: Float, normal: Float) -> tuple[Float, Float, Bool]:
        """Of nodes (P, N, 3), (P, N) each: shares, those of an even sky, and which are buried."""
        shape = at.shape[:2]
        middle = at.mean(axis=1, keepdims=True)
        size = np.linalg.norm(at - middle, axis=2).max(axis=1, keepdims=True)
        toward = (np.broadcast_to(middle, at.shape) - at).reshape(-1, 3)
        wide = np.broadcast_to(size, shape).reshape(-1)
        at, normal = at.reshape(-1, 3), normal.reshape(-1, 3)
        normal = normal / np.linalg.norm(normal, axis=1)[:, None]
        key = _keys(at, normal, self.joined.sag)
        keys, inverse = _inverse(key)
        place = np.searchsorted(self._key, keys)
        known = place < len(self._key)
        known[known] = self._key[place[known]] == keys[known]
        if not known.all():
            many = np.bincount(inverse, minlength=len(keys))
            pull: Float = np.stack([np.bincount(inverse, w) / many for w in toward.T], axis=1)
            rise = np.zeros(len(keys))
            np.maximum.at(rise, inverse, np.abs(np.sum(toward * normal, axis=1)))
            thick = np.zeros(len(keys))
            np.maximum.at(thick, inverse, wide)
            one = np.zeros(len(keys), np.int64)
            one[inverse] = np.arange(len(key))
            up = normal[one]
            pull -= np.sum(pull * up, axis=1)[:, None] * up
            moved = at[one] + INSIDE * (pull + 2.0 * rise[:, None] * up)
            flat = np.full(len(keys), 2.0 * self.joined.sag)
            new = ~known
            self._add(
                keys[new], SamplePoints(moved, up, flat, 0.3 * thick).part(np.flatnonzero(new))
            )
            place = np.searchsorted(self._key, keys)
        back = place[inverse].reshape(shape)
        return self._share[back], self._even[back], self._buried[back]

    def _add(self, key: Long, points: SamplePoints) -> None:
        order = in_groups(points)
        key, points = key[order], points.part(order)
        if self._tables is None:
            masks = hemisphere_masks_twin(points, self.joined.contours.facets)
        else:
            masks = hemisphere_masks(self._tables, points)
        share = self.value(masks, points.normal)
        buried = masks.inside
        keys = np.concatenate([self._key, key])
        order = np.argsort(keys, kind="stable")
        self._key = keys[order]
        self._share = np.concatenate([self._share, share])[order]
        self._even = np.concatenate([self._even, masks.open_share])[order]
        self._buried = np.concatenate([self._buried, buried])[order]


def _keys(at: Float, normal: Float, sag: float) -> Long:
    """Numbers (n,) that are one for the same places with the same normals."""
    whole = np.concatenate([np.rint(at / (0.2 * sag)), np.rint(normal * 1000.0)], axis=1)
    factors = np.array(
        [0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93,
         0xA0761D6478BD642F, 0xE7037ED1A0B428DB], np.uint64,
    ).view(np.int64)  # fmt: skip
    with np.errstate(over="ignore"):
        mixed = (whole.astype(np.int64) * factors).sum(axis=1)
    return np.asarray(mixed ^ (mixed >> 29))


def _inverse(key: Long) -> tuple[Long, Long]:
    """Distinct numbers, ascending, and which of them each one is."""
    keys = distinct(key)
    return keys, np.searchsorted(keys, key)


def sky_visibility_texels(device: Device, openness: SkyVisibility | None) -> Texels:
    """The shares on the device; empty where nothing hides surroundings."""
    if openness is None:
        return device.no_texels("rgba32uint")
    words = _words(openness)
    texels = device.texels(len(words), "rgba32uint", "shade.openness")
    texels.write(words)
    return texels


def _words(openness: SkyVisibility) -> npt.NDArray[np.uint32]:
    """(N, 4): three texels per triangle, one per piece, one per node with the cell it begins."""
    count, pieces = len(openness.pieces), len(openness.cells)
    head = np.zeros((count, 3, 4), np.uint32)
    head[:, :2] = openness.planes.astype(np.float32).view(np.uint32)
    head[:, 2, 0] = openness.pieces
    head[:, 2, 1] = 3 * count + openness.first
    piece = np.zeros((pieces, 4), np.uint32)
    piece[:, 0] = 3 * count + pieces + openness.start
    piece[:, 1] = openness.cells
    # a cell's other corners lie one, a row, and a row and one further
    first, which = np.unique(openness.start, return_index=True)
    row = np.repeat(openness.cells[which] + 1, np.diff(np.append(first, len(openness.values))))
    value = openness.values.astype(np.float32)
    value = np.concatenate([value, np.zeros(int(row.max(initial=0)) + 1, np.float32)])
    i = np.arange(len(openness.values))
    cells = np.stack([value[i], value[i + 1], value[i + row], value[i + row + 1]], axis=1)
    return np.concatenate([head.reshape(-1, 4), piece, cells.view(np.uint32)])
