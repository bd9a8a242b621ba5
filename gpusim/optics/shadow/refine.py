"""Drops occluders listed alone that hide nothing from any receiver of the entry.

An entry's box in light space is larger than what its receivers look from, and nearly all of an open
sheet that they lie on is listed: tested one by one, most of it is beside the way.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Device, Recording, compare, twin_check
from gpusim.optics.shadow.cells import asking
from gpusim.optics.shadow.probe import probe_pixels, probe_points
from gpusim.optics.shadow.receivers import DeviceReceivers
from gpusim.optics.shadow.refit import planes_of
from gpusim.optics.shadow.search import Search
from gpusim.optics.shadow.twin import aspects, looked_from

__all__ = ["listed_alone", "record_refinement"]

LENGTH = 31
"""Words of a chunk but for the number of the next."""


def record_refinement(
    recording: Recording, receivers: DeviceReceivers, search: Search, bound: Bound
) -> None:
    """Refine the entries that the search has said."""
    name, constants = "optics/shadow/refine", receivers.constants
    bound.run(recording, name, "main", constants, counted=search.refine_groups)


def listed_alone(search: Search) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Entry (n,) and occluder (n,) of what is listed alone; waits for the device."""
    heads = search.heads.read(np.uint32).reshape(-1, 4).astype(np.int64)
    pool = search.pool.read(np.uint32).reshape(-1, LENGTH + 1)
    entries: list[int] = []
    faces: list[int] = []
    for entry in np.flatnonzero(heads[:, 1]):
        chunk, left = heads[entry, 0], heads[entry, 1]
        while left > 0:
            own = pool[chunk, : min(left, LENGTH)]
            faces += own.tolist()
            entries += [int(entry)] * len(own)
            chunk, left = pool[chunk, LENGTH], left - LENGTH
    return np.array(entries, np.int64), np.array(faces, np.int64)


@twin_check("optics/shadow/refine")
def _check(device: Device) -> None:
    from gpusim.optics.shadow.visible import VisibleShares

    occluders, spaces, receivers = probe_pixels()
    points = probe_points()
    corners = points[:, :3].astype(np.float64)[occluders.triangles]
    planes = planes_of(corners)
    for space in spaces:
        shares = VisibleShares(device, occluders, receivers)
        shares.find(points, [space], until="search")
        entry, face = listed_alone(shares.search)
        shares.find(points, [space])
        kept = np.stack(listed_alone(shares.search), axis=1) @ [occluders.count, 1]
        got = np.isin(entry * occluders.count + face, kept)
        _, own, entry_of = asking(receivers, space)
        order = np.argsort(entry_of, kind="stable")
        first = np.searchsorted(entry_of[order], entry)
        last = np.searchsorted(entry_of[order], entry, side="right")
        pair = np.repeat(np.arange(len(entry)), last - first)
        offset = np.arange(len(pair)) - np.repeat(
            np.cumsum(last - first) - (last - first), last - first
        )
        row, own_face = order[first[pair] + offset], face[pair]
        seen = aspects(
            space.lamp, own[row], corners[own_face], planes[own_face], occluders.open[own_face],
            looked_from(space.lamp, occluders, corners, own[row], own_face),
        )  # fmt: skip
        want = np.zeros(len(entry), bool)
        hides = np.flatnonzero(seen.may_hide)
        np.logical_or.at(want, pair[hides], True)
        # what hides no sample may stay where float32 can't tell
        bits = np.zeros(len(entry), bool)
        np.logical_or.at(bits, pair[hides], seen.hidden(space.lamp, hides).any(axis=1))
        want = np.where(bits == want, want, got)
        compare("optics/shadow/refine", got.astype(np.int32), want.astype(np.int32), "exact")
