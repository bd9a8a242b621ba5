"""Cells in a lamp's light space.

A box around all that the samples of an entry look from, and a *ground*: a plane at or below which
nothing hides the lamp from any of them. That is the cell's plane, below all of it, where all of the
lamp is above the highest.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Device, Recording, Uniform, compare, twin_check
from gpusim.optics.occlusion import TOLERANCE
from gpusim.optics.shadow.cells import cells_twin, record_cells
from gpusim.optics.shadow.light_space import ANGLE, UNLIMITED, LightSpace
from gpusim.optics.shadow.probe import probe_pieces, probe_pixels
from gpusim.optics.shadow.receivers import DeviceReceivers, PixelReceivers, Receivers

__all__ = ["groups_twin", "record_groups"]

Array = npt.NDArray[np.float64]


def record_groups(recording: Recording, receivers: DeviceReceivers, bound: Bound) -> None:
    """Find what cells are to a lamp."""
    bound.run(
        recording, "optics/shadow/groups", "main", receivers.constants, threads=(receivers.entries,)
    )


def groups_twin(receivers: Receivers | PixelReceivers, space: LightSpace) -> Array:
    """(E, 11): box, tolerance and ground of every entry, as the shader has them."""
    cells = cells_twin(receivers)
    low, high, plane, thick = cells[:, :3], cells[:, 4:7], cells[:, 8:], cells[:, 7]
    rays = None
    if isinstance(receivers, PixelReceivers):
        camera = receivers.camera
        rays = camera.camera_from_world[:3, :3].T @ camera.ray_matrix()
    ends = [np.where([k & 1, k & 2, k & 4], high, low) for k in range(8)]
    used = cells[:, 2] <= cells[:, 6]
    ends = [np.where(used[:, None], end, 1.0) for end in ends]
    x = np.stack(ends)
    if rays is not None:
        x = x[..., 2:] * (x[..., :2] @ rays[:, :2].T + rays[:, 2])
    least, most = _ends(space, x)
    ahead = np.stack([space.ahead(v) for v in x])
    if rays is not None:
        ray = np.stack([end[:, :2] @ rays[:, :2].T + rays[:, 2] for end in ends])
        rate = np.einsum("kea,ea->ke", ray, plane[:, :3])
        offset = plane[:, 3] + np.where(np.arange(8) >= 4, 1.0, 0.0)[:, None] * thick
        way = np.where(rate * offset > 0.0, offset / np.where(rate != 0.0, rate, 1.0), 1.0)
        sure = (rate * offset > 0.0).all(axis=0)
        if not space.lamp.far:
            before = np.stack([space.ahead(v) for v in way[..., None] * ray])
            sure &= (before > space.begin).all(axis=0)
        narrow, wide = _ends(space, way[..., None] * ray)
        least = np.where(sure[:, None], np.maximum(least, narrow), least)
        most = np.where(sure[:, None], np.minimum(most, wide), most)
    if not space.lamp.far:
        through = np.flatnonzero(ahead.min(axis=0) < space.begin)
        least[through], most[through] = _unlimited(space, x[:, through])
    lamp = space.planes(plane)
    extent, reach = space.extent(lamp), np.ones(len(cells))
    if not space.lamp.far:
        reach = np.linalg.norm(x - space.centre, axis=2).max(axis=0)
        used &= ahead.max(axis=0) > 0.0
    lean = (cells[:, 3] + space.terminator) * (reach + sum(space.half))
    used &= lamp[:, 2] + extent + lean > 0.0
    least = np.where(used[:, None], least, UNLIMITED)
    most = np.where(used[:, None], most, -UNLIMITED)
    slack = np.full(len(cells), ANGLE) if space.lamp.far else space.rounding + thick
    ground = np.where((lamp[:, 2] - extent > slack)[:, None], plane, 0.0)
    box = np.stack([least, most], axis=2).reshape(-1, 6)
    return np.column_stack([box, TOLERANCE * np.linalg.norm(x, axis=2).max(axis=0), ground])


def _ends(space: LightSpace, x: Array) -> tuple[Array, Array]:
    """Low and high ends (E, 3) of boxes around places (8, E, 3)."""
    place = np.stack([space.place(v) for v in x])
    slack = np.stack([space.rounding_at(v) for v in place])
    return (place - slack).min(axis=0), (place + slack).max(axis=0)


def _unlimited(space: LightSpace, x: Array) -> tuple[Array, Array]:
    """Ends of what of cells with corners (8, E, 3) is before the lamp's plane, which passes
    through these."""
    y = x - space.centre
    beside = np.stack([y @ space.across, y @ space.along], axis=-1)
    low, high = beside.min(axis=0) - space.rounding, beside.max(axis=0) + space.rounding
    most = np.maximum((y @ space.axis).max(axis=0) + space.rounding, 1e-300)[:, None]
    low, high = (
        np.where(low < 0.0, -UNLIMITED, low / most),
        np.where(high > 0.0, UNLIMITED, high / most),
    )
    return np.column_stack([low, 1.0 / most]), np.column_stack([high, 0.0 * most + UNLIMITED])


@twin_check("optics/shadow/groups")
def _check(device: Device) -> None:
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        own = DeviceReceivers.of(device, receivers, occluders)
        for space in spaces:
            light = Uniform(device, space.uniform(), "shadow.light")
            groups_of = device.empty(48 * own.entries, "shadow.groups")
            bound = Bound(device, {"light": light, "groups_of": groups_of, **own.bindings(1)})
            with device.recording("optics.shadow.groups") as recording:
                record_cells(recording, own, bound)
                record_groups(recording, own, bound)
            got = groups_of.read(np.float32, (own.entries, 12))
            want = groups_twin(receivers, space)
            empty = want[:, 0] > want[:, 1]
            compare("optics/shadow/groups", got[empty, 0] > got[empty, 1], empty[empty], "exact")
            got, want = np.delete(got, 6, axis=1)[~empty], want[~empty]
            compare("optics/shadow/groups", got, want, atol=1e-5, rtol=2e-5)
