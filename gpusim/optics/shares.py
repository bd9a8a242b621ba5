"""What single receivers see of lamps, found on the device: pieces of pixels that the host resolves.

A fine mesh's outline has tens of pieces in a pixel, each of which looks at the lamps by itself.
The twin is `gpusim.optics.shadow_tiles.ShadowTiles.shares`, which serves a few as well.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Device, compare, twin_check
from gpusim.optics.dealing import dealt
from gpusim.optics.occlusion import lamp_masks
from gpusim.optics.pattern import LOOP_TURNS
from gpusim.optics.setup import Setup
from gpusim.optics.shadow_probe import probe_outlines, probe_shadows
from gpusim.optics.shadow_tables import ShadowTables
from gpusim.optics.shadow_tiles import ShadowTiles

__all__ = ["Shares"]

Array = npt.NDArray[np.float64]

WORTH = 20_000
"""Edges that receivers look past, which are worth the way to the device."""


class Shares:
    """`ShadowTiles.shares` of ``tiles`` that are on the ``device`` as ``tables``."""

    def __init__(self, device: Device, tables: ShadowTables, tiles: ShadowTiles) -> None:
        self._device, self._tables, self._tiles = device, tables, tiles

    def __call__(
        self,
        x: Array,
        y: Array,
        at: Array,
        normal: Array,
        across: Array,
        down: Array,
        triangle: npt.NDArray[np.int64] | None = None,
    ) -> Array:
        """As `ShadowTiles.shares`."""
        tiles = self._tiles
        bits, entry = tiles.tile_of(x, y)
        turns = np.append(tiles.edge_counts, 0)[entry]
        # what would be too long for the device's loops is the host's
        own = np.flatnonzero((turns > 0) & (turns <= LOOP_TURNS))
        if turns[own].sum() < WORTH:
            own = own[:0]
        result = np.empty((len(x), len(tiles.lamps)))
        places = at, normal, across, down
        left = np.ones(len(x), bool)
        left[own] = False
        rest = np.flatnonzero(left)
        result[rest] = tiles.shares(
            x[rest], y[rest], at[rest], normal[rest], across[rest], down[rest]
        )
        if len(own):
            lit = bits[own, None] >> np.arange(len(tiles.lamps), dtype=np.uint32) & np.uint32(1)
            found = self._found(entry[own], turns[own], *(v[own] for v in places))
            result[own] = np.where(tiles.listed[entry[own]], found, lit)
        return result

    def _found(
        self,
        entry: npt.NDArray[np.int64],
        turns: npt.NDArray[np.int64],
        at: Array,
        normal: Array,
        across: Array,
        down: Array,
    ) -> npt.NDArray[np.float32]:
        """(n, L) what receivers in tiles in half shadow see of the lamps that are listed there."""
        # those of a tile side by side: software rasterisers work on several in step
        order = dealt(np.lexsort((entry, turns)))
        receivers = np.zeros((len(entry), 4, 4), np.float32)
        for k, values in enumerate((at, normal, across, down)):
            receivers[:, k, :3] = values[order]
        receivers[:, 0, 3] = entry[order].astype(np.uint32).view(np.float32)
        lamps = len(self._tiles.lamps)
        found = self._device.empty(4 * len(entry) * lamps, "shares.found")
        constants = {"shadowed": 1.0, "chained": float(len(self._tiles.chains.ends) > 0)}
        kernel = self._device.kernel("optics/shares", constants=constants)
        bindings = kernel.bind_used(
            params={"count": len(entry)},
            receivers=self._device.buffer(receivers, "shares.receivers"),
            shares=found,
            **self._tables.bindings(),
        )
        with self._device.recording("optics.shares") as recording:
            recording.dispatch(kernel, bindings, threads=(len(entry),))
        result = np.empty((len(entry), lamps), np.float32)
        result[order] = found.read(np.float32, result.shape)
        return result


@twin_check("optics/shares")
def _check(device: Device) -> None:
    for setup in (probe_shadows(), probe_outlines()):
        tiles = setup.lighting.shadows
        assert isinstance(tiles, ShadowTiles)
        x, y, at, normal, across, down = _receivers(setup)
        shares = Shares(device, ShadowTables(device, setup.lighting), tiles)
        samples = [np.bitwise_count(lamp_masks(lamp)).sum() for lamp in tiles.lamps]
        got, want = (
            found(x, y, at, normal, across, down) * samples for found in (shares, tiles.shares)
        )
        compare("optics/shares", got, np.rint(got), atol=1e-3)
        # one or two samples may fall to the other side of an outline
        compare("optics/shares", got, want, atol=2.5)


def _receivers(setup: Setup) -> tuple[Array, ...]:
    """Places on the probe's table, as `ShadowTiles.shares` asks for them."""
    camera, rays = setup.view.camera, setup.rays()
    random = np.random.default_rng(5)
    x, y = random.uniform(-0.5, np.array([camera.width, camera.height]) - 0.5, (4000, 2)).T

    def at(dx: float, dy: float) -> Array:
        way = np.stack([x + dx, y + dy, np.ones_like(x)], axis=1) @ rays.T
        return np.asarray(way * (-camera.eye[2] / way[:, 2:]))

    normal = np.broadcast_to([0.0, 0.0, 1.0], (len(x), 3))
    return x, y, at(0.0, 0.0), normal, at(0.5, 0.0) - at(-0.5, 0.0), at(0.0, 0.5) - at(0.0, -0.5)
