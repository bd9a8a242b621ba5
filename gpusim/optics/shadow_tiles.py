"""Tiles of the image in which a lamp is half hidden, each with the faces that may hide it.

Visibility changes only across the outline of what a lamp lights. A tile whose receivers have no
face at such an outline between them and the lamp is lit or dark as a whole, which one ray tells;
only the rest is resolved pixel by pixel. Tiles are divided from 128 px down to 8.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from gpusim.distinct import distinct
from gpusim.errors import InputError
from gpusim.optics.aside import Aside
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import Lamp
from gpusim.optics.half_shadow import HalfShadow, half_shadow
from gpusim.optics.occlusion import TOLERANCE, visible_share
from gpusim.optics.receivers import TILE, Receivers
from gpusim.optics.view import View

__all__ = ["MOST_LAMPS", "TILE", "ShadowTiles", "flatness"]

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]
Bits = npt.NDArray[np.uint8]
MOST_LAMPS = 16
ALL = (1 << MOST_LAMPS) - 1


FLATNESS = 1e-3
"""px of the picture by which joining casters' faces may move a shadow."""


def flatness(view: View, lamps: list[Lamp]) -> Callable[[Array], Array]:
    """How far joined faces may pass from casters' points (N, 3), as `Casters.of` asks.

    A caster's error is seen at the nearest receiver, as much larger as that is farther from the
    lamp. It stays below what the exact test of a face's plane lets through (`TOLERANCE`).
    """
    T = view.camera.camera_from_world
    receivers = ((view.corners[:, :, :3] - T[:3, 3]) @ T[:3, :3]).reshape(-1, 3)
    depth = 1.0 / max(float(view.inverse_depth().max(initial=0.0)), 1e-300)
    share = min(FLATNESS / float(np.abs(np.diag(view.camera.K)[:2]).max()), 0.1 * TOLERANCE)

    def allowed(points: Array) -> Array:
        result = np.full(len(points), share * depth)
        for lamp in lamps:
            if not lamp.far and len(receivers):
                farthest = float(np.linalg.norm(receivers - lamp.centre, axis=1).max())
                near = np.linalg.norm(points - lamp.centre, axis=1)
                result = np.minimum(result, share * depth * near / farthest)
        return result

    return allowed


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
    ``corners`` (F, 4, 3) relative to the eye, ``both_sides`` (F,): see `Casters`.
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

    @staticmethod
    def build(
        view: View, lamps: list[Lamp], casters: Casters, alone: Sequence[Numbers] | None = None
    ) -> ShadowTiles:
        """Classify every tile of ``view`` for every lamp that casts shadows; ``alone``: for each
        lamp the surfaces that hide nothing of themselves."""
        if len(lamps) > MOST_LAMPS:
            raise InputError(
                f"render lights; got {len(lamps)} lamps; expected at most {MOST_LAMPS}"
            )
        shape = (-(-view.camera.height // TILE), -(-view.camera.width // TILE))
        lit = np.full(shape, ALL, np.uint32)
        receivers = Receivers(view)
        used = [
            number
            for number, lamp in enumerate(lamps)
            if lamp.light.shadows and view.count and len(casters.corners)
        ]

        def found(number: int) -> HalfShadow:
            own = np.zeros(0, np.int64) if alone is None else alone[number]
            return half_shadow(receivers, lamps[number], casters, shape, own)

        with Aside(view.count, len(used)) as aside:
            halves = list(aside.map(found, used))
        none = HalfShadow.none()
        for number, half in zip(used, halves, strict=True):
            lit.reshape(-1)[half.dark] &= np.uint32(ALL ^ (1 << number))
        lamp_of = np.repeat(np.array(used, np.int64), [len(half.tile) for half in halves])
        tile, face, edges, corners, both_sides = (
            np.concatenate([getattr(half, name) for half in [none, *halves]])
            for name in ("tile", "face", "edges", "corners", "both_sides")
        )
        # each lamp has its own faces
        before = np.cumsum([0, *(len(half.corners) for half in halves)])[:-1]
        face += np.repeat(before, [len(half.tile) for half in halves])
        entries = distinct(tile)
        row = np.searchsorted(entries, tile) * max(len(lamps), 1) + lamp_of
        order = np.argsort(row, kind="stable")
        count = np.bincount(row, minlength=len(entries) * max(len(lamps), 1))
        entry = np.zeros(shape, np.uint32)
        entry.reshape(-1)[entries] = np.arange(1, len(entries) + 1)
        return ShadowTiles(
            tuple(_relative_to(lamp, view.camera.eye) for lamp in lamps), lit, entry,
            np.stack([entries // shape[1], entries % shape[1]], axis=1),
            (np.cumsum(count) - count).reshape(len(entries), len(lamps)),
            count.reshape(len(entries), len(lamps)),
            face[order],
            edges[order],
            corners - view.camera.eye,
            both_sides,
        )  # fmt: skip

    def shares(
        self, x: Array, y: Array, at: Array, normal: Array, across: Array, down: Array
    ) -> Array:
        """What receivers see of each lamp, (n, L), 0 to 1.

        ``x``, ``y`` (n,) px; ``at`` (n, 3) their places relative to the eye, ``normal`` (n, 3)
        unit; ``across``, ``down`` (n, 3) how the places change per column and row.
        """
        limit = np.array(self.lit.shape) - 1
        row = np.clip(np.floor((y + 0.5) / TILE).astype(np.int64), 0, limit[0])
        column = np.clip(np.floor((x + 0.5) / TILE).astype(np.int64), 0, limit[1])
        bits, entry = self.lit[row, column], self.entry[row, column].astype(np.int64) - 1
        tolerance = TOLERANCE * np.linalg.norm(at, axis=1)
        result = np.zeros((len(x), len(self.lamps)))
        for number, lamp in enumerate(self.lamps):
            result[:, number] = (bits >> np.uint32(number)) & np.uint32(1)
            half = np.flatnonzero(entry >= 0)
            half = half[self.count[entry[half], number] > 0]
            own = entry[half]
            count = self.count[own, number]
            receiver = np.repeat(np.arange(len(half)), count)
            offset = np.arange(len(receiver)) - np.repeat(np.cumsum(count) - count, count)
            listed = self.start[own, number][receiver] + offset
            face = self.face[listed]
            result[half, number] = visible_share(
                lamp, at[half], normal[half], across[half], down[half], receiver,
                self.corners[face], self.both_sides[face], tolerance[half], self.edges[listed],
            )  # fmt: skip
        return result

    @cached_property
    def edge_counts(self) -> Numbers:
        """(E,) edges that are looked at in each tile in half shadow, of all lamps."""
        sums = np.concatenate([[0], np.cumsum(np.bitwise_count(self.edges), dtype=np.int64)])
        result: Numbers = (sums[self.start + self.count] - sums[self.start]).sum(axis=1)
        return result

    @property
    def dark(self) -> npt.NDArray[np.bool_]:
        """(rows, columns): tiles that some lamp doesn't light at all."""
        return np.asarray(self.lit != ALL)

    @property
    def any(self) -> bool:
        """Whether there is any shadow in the picture."""
        return bool(len(self.place) or self.dark.any())


def _relative_to(lamp: Lamp, eye: Array) -> Lamp:
    """The lamp in a frame whose origin is the eye."""
    return lamp if lamp.far else replace(lamp, centre=lamp.centre - eye)
