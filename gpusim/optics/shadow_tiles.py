"""Tiles of the image in which a lamp is half hidden, each with the faces that may hide it.

Visibility changes only across the outline of what a lamp lights. A tile whose receivers have no
face at such an outline between them and the lamp is lit or dark as a whole, which one ray tells;
only the rest is resolved pixel by pixel. Tiles are divided from 128 px down to 8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.distinct import distinct
from gpusim.optics.aside import Aside
from gpusim.optics.corners import products
from gpusim.optics.emitters import MOST_LAMPS, Lamp, check_number
from gpusim.optics.half_shadow import HalfShadow
from gpusim.optics.lamp_layer import Alone
from gpusim.optics.lamp_pairs import LampPairs
from gpusim.optics.lamp_shadow import CastersOf, LampShadow, lamp_shadow, outlined
from gpusim.optics.occlusion import TOLERANCE, Chained, visible_share
from gpusim.optics.patches import Small
from gpusim.optics.ragged import expand
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_edges import TileEdges
from gpusim.optics.tile_pairs import TILE
from gpusim.optics.view import View

__all__ = ["TILE", "ShadowTiles", "flatness"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bits = npt.NDArray[np.uint8]
ALL = (1 << MOST_LAMPS) - 1


FLATNESS = 1e-3
"""px of the picture by which joining casters' faces may move a shadow."""


def flatness(view: View, lamps: list[Lamp]) -> Callable[[Array], Array]:
    """How far joined faces may pass from casters' points (N, 3), as `Casters.of` asks.

    A caster's error is seen at the nearest receiver, as much larger as that is farther from the
    lamp. It stays below what the exact test of a face's plane lets through (`TOLERANCE`).
    """
    T = view.camera.camera_from_world
    receivers = view.table.position.T - T[:3, 3:]
    world = np.stack([products(T[:3, axis], receivers) for axis in range(3)])
    depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
    share = min(FLATNESS / float(np.abs(np.diag(view.camera.K)[:2]).max()), 0.1 * TOLERANCE)

    near = [lamp for lamp in lamps if not lamp.far and world.size]
    farthest = [float(_away(world, lamp).max()) for lamp in near]

    def allowed(points: Array) -> Array:
        result = np.full(len(points), share * depth)
        at = np.ascontiguousarray(points.T)
        for lamp, most in zip(near, farthest, strict=True):
            result = np.minimum(result, share * depth * _away(at, lamp) / most)
        return result

    return allowed


def _away(points: Array, lamp: Lamp) -> Array:
    """(n,): distance of points (3, n) from a lamp's centre."""
    way = points - lamp.centre[:, None]
    return np.asarray(np.sqrt(products(way, way)))


@dataclass(frozen=True, eq=False)
class Chains:
    """Edges of outlines that hide lamps: ``start`` and ``count`` (E, L) as in `ShadowTiles`;
    ``ends`` (n, 2, 3) relative to the eye, ``cut`` (n, 4) a plane beyond which they hide the lamp,
    ``last`` (n,) of an outline; ``scans`` (L, 3): the direction across each lamp's axis in which
    they are counted."""

    start: Numbers
    count: Numbers
    ends: Array
    cut: Array
    last: npt.NDArray[np.bool_]
    scans: Array

    def before(self, entry: Numbers, lamp: int, at: Array) -> tuple[Numbers, Numbers]:
        """Pairs of receivers (n,) at (n, 3), in tiles of such ``entry`` (n,), and edges that may
        hide a ``lamp`` from them."""
        first, count = self.start[entry, lamp], self.count[entry, lamp]
        own = np.flatnonzero(count)
        # in most tiles one plane tells which receivers are beyond all
        cut = self.cut[first[own]]
        before = own[(cut[:, :3] * at[own]).sum(axis=1) <= cut[:, 3]]
        count[before[self._even[entry[before], lamp]]] = 0
        receiver, offset = expand(count)
        return receiver, first[receiver] + offset

    @cached_property
    def _even(self) -> npt.NDArray[np.bool_]:
        """(E, L) whether all edges there have the same plane."""
        differs = np.any(self.cut[1:] != self.cut[:-1], axis=1)
        changes = np.concatenate([[0], np.cumsum(differs), [0]])
        last = np.maximum(self.start + self.count - 1, self.start)
        return np.asarray((changes[last] == changes[self.start]) | (self.count == 0))

    @staticmethod
    def none(entries: int, lamps: int) -> Chains:
        """None in so many tiles of so many lamps."""
        number = np.zeros((entries, lamps), np.int64)
        return Chains(
            number, number, np.zeros((0, 2, 3)), np.zeros((0, 4)), np.zeros(0, bool),
            np.zeros((lamps, 3)),
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class ShadowTiles:
    """What the tiles of a view see of each lamp.

    ``lamps``: their centres are relative to the eye.
    ``lit`` (rows, columns): bit l is set where lamp l lights the tile (fully, or in part).
    ``entry`` (rows, columns): number of the tile among those in half shadow + 1, or 0.
    ``place`` (E, 2): row and column of these; ``start`` (E, L) and ``count`` (E, L): where the
    faces of lamp l lie in ``face`` (indices into ``corners``); a count of 0 where `lit` holds.
    ``edges`` (as ``face``): bit k for the k-th edge of a face, where some of the tile sees some of
    the lamp beyond it; of the others all is inside.
    ``corners`` (F, 4, 3) relative to the eye, ``both_sides`` (F,): see `Casters`. ``chains``: edges
    of outlines, besides.
    """

    lamps: tuple[Lamp, ...]
    lit: npt.NDArray[np.uint32]
    entry: npt.NDArray[np.uint32]
    place: Numbers
    start: Numbers
    count: Numbers
    face: Numbers
    edges: npt.NDArray[np.uint8]
    corners: Array
    both_sides: npt.NDArray[np.bool_]
    chains: Chains

    @staticmethod
    def build(
        view: View,
        lamps: list[Lamp],
        casters: CastersOf,
        alone: Sequence[Sequence[Alone]],
        closed: npt.NDArray[np.bool_],
    ) -> ShadowTiles:
        """Classify every tile of ``view`` for every lamp that casts shadows; ``alone``: for each
        lamp the surfaces that borders may tell of, which ``casters`` leave out on demand;
        ``closed``: which of all surfaces are."""
        check_number(lamps)
        shape = (-(-view.camera.height // TILE), -(-view.camera.width // TILE))
        lit = np.full(shape, ALL, np.uint32)
        used = [number for number, lamp in enumerate(lamps) if lamp.light.shadows and view.count]
        with Aside(view.count, len(used)) as aside:
            # what all lamps look for first, beside what they look from
            for bodies in {outlined(alone[number]) for number in used}:
                aside.begin(casters, bodies)
            receivers = Receivers(view)
            small = Small.of(receivers, closed)

            def found(number: int) -> LampShadow:
                return lamp_shadow(
                    receivers, small, lamps[number], casters, alone[number], shape
                )  # fmt: skip

            shadows = list(aside.map(found, used))
        for number, shadow in zip(used, shadows, strict=True):
            lit.reshape(-1)[shadow.dark] &= np.uint32(ALL ^ (1 << number))
        # each lamp has its own faces
        faces = HalfShadow.joined([HalfShadow.none(), *(shadow.faces for shadow in shadows)])
        tiles = [shadow.edges.tile for shadow in shadows]
        entries = distinct(np.concatenate([faces.tile, *tiles]))

        def filed(lists: list[Numbers]) -> tuple[Numbers, Numbers, Numbers]:
            """First and number (E, L) of what is listed tile by tile for each lamp, its order."""
            which = np.repeat(np.array(used, np.int64), [len(tile) for tile in lists])
            tile = np.concatenate([np.zeros(0, np.int64), *lists])
            row = np.searchsorted(entries, tile) * max(len(lamps), 1) + which
            count = np.bincount(row, minlength=len(entries) * max(len(lamps), 1))
            count = count.reshape(len(entries), len(lamps))
            start = (np.cumsum(count) - count.reshape(-1)).reshape(count.shape)
            return start, count, np.argsort(row, kind="stable")

        start, count, order = filed([shadow.faces.tile for shadow in shadows])
        chain_start, chain_count, chained = filed(tiles)
        entry = np.zeros(shape, np.uint32)
        entry.reshape(-1)[entries] = np.arange(1, len(entries) + 1)
        eye = view.camera.eye
        edges = TileEdges.joined([shadow.edges for shadow in shadows])[chained]
        cut = edges.cut
        offset = cut[:, 3] - cut[:, :3] @ eye
        return ShadowTiles(
            tuple(lamp.relative_to(eye) for lamp in lamps), lit, entry,
            np.stack([entries // shape[1], entries % shape[1]], axis=1), start, count,
            faces.face[order], faces.edges[order], faces.corners - eye, faces.both_sides,
            Chains(
                chain_start, chain_count, edges.ends - eye, np.column_stack([cut[:, :3], offset]),
                edges.last, _scans(lamps, alone),
            ),
        )  # fmt: skip

    def shares(
        self,
        x: Array,
        y: Array,
        at: Array,
        normal: Array,
        across: Array,
        down: Array,
        triangle: Numbers | None = None,
    ) -> Array:
        """What receivers see of each lamp, (n, L), 0 to 1.

        ``x``, ``y`` (n,) px; ``at`` (n, 3) their places relative to the eye, ``normal`` (n, 3)
        unit; ``across``, ``down`` (n, 3) how the places change per column and row;
        ``triangle`` is nothing to it.
        """
        bits, entry = self.tile_of(x, y)
        tolerance = TOLERANCE * np.linalg.norm(at, axis=1)
        result = np.zeros((len(x), len(self.lamps)))
        for number, lamp in enumerate(self.lamps):
            result[:, number] = (bits >> np.uint32(number)) & np.uint32(1)
            half = np.flatnonzero(entry >= 0)
            half = half[self.listed[entry[half], number]]
            own = entry[half]
            receiver, offset = expand(self.count[own, number])
            listed = self.start[own, number][receiver] + offset
            face = self.face[listed]
            places = at[half], across[half], down[half]
            kept = np.flatnonzero(self._pairs[number].may_hide(*places, receiver, face))
            receiver, listed, face = receiver[kept], listed[kept], face[kept]
            chained, edge = self.chains.before(own, number, at[half])
            result[half, number] = visible_share(
                lamp, at[half], normal[half], across[half], down[half], receiver,
                self.corners[face], self.both_sides[face], tolerance[half], self.edges[listed],
                Chained(
                    chained, self.chains.ends[edge], self.chains.cut[edge], self.chains.last[edge],
                    self.chains.scans[number],
                ),
            )  # fmt: skip
        return result

    def tile_of(
        self, x: Array | Numbers, y: Array | Numbers
    ) -> tuple[npt.NDArray[np.uint32], Numbers]:
        """`lit` of the tiles of positions (n,), and number among those in half shadow, or -1."""
        limit = np.array(self.lit.shape) - 1
        row = np.clip(np.floor((y + 0.5) / TILE).astype(np.int64), 0, limit[0])
        column = np.clip(np.floor((x + 0.5) / TILE).astype(np.int64), 0, limit[1])
        return self.lit[row, column], self.entry[row, column].astype(np.int64) - 1

    @cached_property
    def _pairs(self) -> list[LampPairs]:
        """The faces as each lamp sees them."""
        return [LampPairs(lamp, self.corners) for lamp in self.lamps]

    @cached_property
    def edge_counts(self) -> Numbers:
        """(E,) turns that the shaders' loops over edges may take for a receiver in each tile in
        half shadow: those of its longest list for each lamp that has one, as those that are worked
        on in step wait for the longest list of any of them, lamp by lamp."""
        sums = np.concatenate([[0], np.cumsum(np.bitwise_count(self.edges), dtype=np.int64)])
        faces = sums[self.start + self.count] - sums[self.start]
        # an edge of an outline takes as long as three of faces
        turns = faces + 3 * self.chains.count
        result: Numbers = self.listed.sum(axis=1) * turns.max(axis=1, initial=0)
        return result

    @property
    def listed(self) -> npt.NDArray[np.bool_]:
        """(E, L): which lamps a tile sees in part."""
        return np.asarray((self.count > 0) | (self.chains.count > 0))

    @property
    def dark(self) -> npt.NDArray[np.bool_]:
        """(rows, columns): tiles that some lamp doesn't light at all."""
        return np.asarray(self.lit != ALL)

    @property
    def any(self) -> bool:
        """Whether there is any shadow in the picture."""
        return bool(len(self.place) or self.dark.any())


def _scans(lamps: list[Lamp], alone: Sequence[Sequence[Alone]]) -> Array:
    """See `Chains`; 0 for lamps without a size that no outline hides."""
    result = np.zeros((len(lamps), 3))
    for number, (lamp, own) in enumerate(zip(lamps, alone, strict=True)):
        if lamp.extended:
            result[number] = lamp.u
        elif own:
            result[number] = own[0].view.across
    return result
