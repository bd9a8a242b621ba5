"""Pixels that don't see all of every lamp, lit again by what `gpusim.optics.shadow` finds.

`gpusim.optics.shading.shading_pass` lights all pixels by all lamps, and marks which triangle each
one sees; here the device finds each lamp's share and takes off what is hidden. Pieces of pixels on
edges, and what the host resolves, ask one by one.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.gpu import Bound, Device, Texture
from gpusim.optics.frame import Band
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.shading_pass import ShadingPass
from gpusim.optics.shadow.lamp_visibility import CAPACITY, VisibleShares
from gpusim.optics.shadow.light_space import lamp_numbers
from gpusim.optics.shadow.receivers import (
    TILE,
    DeviceList,
    DevicePixels,
    DeviceReceivers,
    group_starts,
)
from gpusim.optics.shadow.scene import Shadows

NEEDED = "shadow.capacity"
WORDS = {"r32uint": 1, "rg32uint": 2, "rgba32uint": 4}


def _shares_of(shadows: Shadows, receivers: DeviceReceivers) -> VisibleShares:
    """What ``receivers`` see; with as many chunks as were needed last."""
    trees = shadows.trees
    assert trees is not None
    known = trees.device.pool.notes.get(NEEDED)
    capacity = known if isinstance(known, int) else CAPACITY
    return VisibleShares(trees.device, trees, receivers, capacity)


def _listed(device: Device, shadows: Shadows, starts: Long) -> DeviceList:
    """Receivers that are listed in groups which begin at ``starts`` (G + 1,)."""
    return DeviceList(device, shadows.occluders, starts, shadows.view.camera)


def _enlarged(found: VisibleShares) -> bool:
    """`VisibleShares.enlarged`, of which the next ones know."""
    result = found.enlarged()
    if result:
        found.device.pool.notes[NEEDED] = found.search.capacity
    return result


class RelightingPass:
    """Draws a view's radiance band by band: ``shade`` lights all pixels by all lamps before."""

    def __init__(self, shade: ShadingPass) -> None:
        buffers, setup = shade.buffers, shade.buffers.setup
        shadows = setup.lighting.shadows
        assert shadows is not None and shade.marks is not None
        self.buffers, self.shade, self.stride = buffers, shade, shade.stride
        self._casting = shadows.casting
        # a relief may turn normals any way
        self._spaces = shadows.spaces if setup.traits.bumps is None else shadows.turned(1.0)
        self._receivers = self._pixels(shadows, shade.marks, shade.rows)
        self._found = _shares_of(shadows, self._receivers)
        self._band: Band | None = None
        self._tiles = buffers.device.empty(4 * self._receivers.most_groups, "relit.tiles_listed")
        self._counters = buffers.device.empty(16, "relit.counters")
        self._groups = buffers.device.empty(12, "relit.groups")

    def _pixels(self, shadows: Shadows, marks: Texture, rows: int) -> DevicePixels:
        """Those that marks are of."""
        camera, planes, device = shadows.view.camera, self.buffers.planes, self.buffers.device
        layout = marks.stride // 4, WORDS[marks.format]
        ids = device.empty(marks.stride * rows, "shadow.ids")
        return DevicePixels(device, shadows.occluders, camera, rows, planes, ids, *layout)

    def draw(self, band: Band) -> None:
        """Shade a band; `finish` is to follow the last one."""
        self.finish()
        self._draw(band)
        self._band = band

    def _draw(self, band: Band) -> None:
        self.shade.draw(band)
        self._receivers.aim(band.row0, band.rows)
        with self.buffers.device.recording("optics.shadow") as recording:
            assert self.shade.marks is not None
            recording.copy_texture(self.shade.marks, self._receivers.ids, band.rows)
        self._found.record(self._spaces)
        self._relight(band)

    def finish(self) -> None:
        """Do the last band again where the lists of what hides lamps were too short; waits for the
        device."""
        while self._band is not None and _enlarged(self._found):
            self._draw(self._band)
        self._band = None

    def _relight(self, band: Band) -> None:
        setup, width = self.buffers.setup, self.buffers.setup.view.camera.width
        glossy, bumpy = setup.programs.looks
        constants = setup.programs.light_constants(glossy, bumpy)
        constants["scaled"] = float(not glossy)
        params = {
            "rays": self.buffers.rays(), "width": width, "rows": band.rows,
            "stride": self.stride, "row0": band.row0, "casting": self._casting,
        }  # fmt: skip
        bound = Bound(
            self.buffers.device,
            {
                "params": params, "marks": self.shade.marks,
                **{f"plane{k}": plane for k, plane in enumerate(band.planes)},
                "lamp_shares": self._found.shares, "states": self._found.states,
                "halves": self._receivers.halves, "listed": self._tiles,
                "counters": self._counters, "groups_of": self._groups, **self.buffers.surface(),
            },
        )  # fmt: skip
        with self.buffers.device.recording("optics.relit") as recording:
            recording.clear(self._counters)
            count = -(-width // TILE) * -(-band.rows // TILE)
            name = setup.programs.name("optics/shading/relighting")
            bound.run(recording, name, "list_tiles", constants, threads=(count,))
            bound.run(recording, name, "count_tiles", constants, groups=(1,))
            bound.run(recording, name, "main", constants, counted=self._groups)


def no_pieces(device: Device) -> dict[str, Any]:
    """What a program is bound to that lists none."""
    return {
        "receivers": device.buffer(np.zeros(4, np.uint32), "shadow.no_receivers"),
        "lamp_shares": device.buffer(np.zeros(4, np.float32), "shadow.no_shares"),
        "owners": device.no_texels("rgba32uint"),
        "slot_of": device.buffer(np.zeros(4, np.uint32), "shadow.no_slots"),
        "painted": device.buffer(np.zeros(4, np.uint32), "shadow.no_paint"),
    }


class PieceShares:
    """What pieces of pixels see, which a program lists: there is a place for each in groups of
    neighbours that begin at ``starts`` (G + 1,)."""

    def __init__(self, buffers: SceneBuffers, shadows: Shadows, starts: Long) -> None:
        device = buffers.device
        self._spaces, self._planes = shadows.spaces, buffers.planes
        self._receivers, self._casting = _listed(device, shadows, starts), shadows.casting
        self._found = _shares_of(shadows, self._receivers)
        self._found.make_room(shadows.spaces)
        size = 16 if buffers.setup.palette is None else 32
        self._painted = device.empty(size * self._receivers.most, "shadow.painted")
        with device.recording("optics.shadow") as recording:
            recording.clear(self._receivers.pieces)
            recording.clear(self._painted)

    def range(self) -> dict[str, int]:
        """Members of the programs' uniform."""
        return {"slots": self._receivers.count, "casting": self._casting}

    def bindings(self) -> dict[str, Any]:
        """By their WGSL names, for the program that lists them, and for that which lights them once
        it is found what they see."""
        return {
            "receivers": self._receivers.pieces, "owners": self._planes, "painted": self._painted,
            "lamp_shares": self._found.shares,
        }  # fmt: skip

    def release(self) -> None:
        """Leave memory to others."""
        self._painted.release()

    def find(self) -> None:
        """Let the device find what those see that are listed."""
        self._found.record(self._spaces)

    def failed(self) -> bool:
        """Whether that has to be done again; waits for the device."""
        return _enlarged(self._found)


def listed_shares(
    shadows: Shadows, x: Float, y: Float, at: Float, normal: Float, across: Float, down: Float,
    triangle: Long,
) -> Float:  # fmt: skip
    """`Shadows.shares` by a device."""
    assert shadows.trees is not None
    result = np.ones((len(x), len(shadows.lamps)))
    if not len(x):
        return result
    # those of a tile look past the same
    tile = np.stack([np.floor((x + 0.5) / TILE), np.floor((y + 0.5) / TILE)])
    order = np.lexsort(tile)
    last = np.flatnonzero(np.any(np.diff(tile[:, order], append=-1.0) != 0.0, axis=0))
    receivers = replace(
        shadows.receivers(at, normal, across, down, triangle)[order],
        start=group_starts(np.diff(last + 1, prepend=0)),
    )
    listed = _listed(shadows.trees.device, shadows, receivers.starts)
    listed.fill(receivers)
    found = _shares_of(shadows, listed).found(shadows.spaces)
    result[order[:, None], lamp_numbers(shadows.spaces)] = found
    return result
