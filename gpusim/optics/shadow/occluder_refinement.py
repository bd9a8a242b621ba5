"""Drops occluders listed alone that hide nothing from any receiver of the entry.

An entry's box in light space is larger than what its receivers look from, and nearly all of an open
sheet that they lie on is listed. Most of it is below the planes that they see, or beside the way;
what is left is tested receiver by receiver.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.gpu import Bound, Device, Recording, compare, twin_check
from gpusim.optics.light.quadrature import Lamp
from gpusim.optics.probes.occluders import probe_pixels, probe_points
from gpusim.optics.shadow.brute_force import Aspects, aspects, looked_from
from gpusim.optics.shadow.bvh_refit import planes_of
from gpusim.optics.shadow.occluder_search import Search
from gpusim.optics.shadow.receiver_groups import asking

__all__ = ["listed_alone", "record_refinement"]

Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.int64]

NAME = "optics/shadow/occluder_refinement"

LENGTH = 31
"""Words of a chunk but for the number of the next."""


def record_refinement(recording: Recording, search: Search, bound: Bound) -> None:
    """Refine the entries that the search has said."""
    search.run_counted(recording, bound, NAME, "sifted", "sift")
    search.run_counted(recording, bound, NAME, "refined")


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


@twin_check(NAME)
def _check(device: Device) -> None:
    from gpusim.optics.shadow.lamp_visibility import VisibleShares

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
        looks = looked_from(space.lamp, occluders, corners, planes, own[row], own_face)
        hides, may = (
            _any_of(len(entry), pair, space.lamp, seen)
            for seen in (
                aspects(
                    space.lamp, own[row], corners[own_face], planes[own_face],
                    occluders.open[own_face], some,
                )
                for some in (looks, np.where(looks < 0.0, 1.0, looks))
            )
        )  # fmt: skip
        # what hides no sample may stay where float32 can't tell, or if it would hide what the
        # receivers' planes go on to beyond their triangles
        want = hides[1] | (got & may[0])
        compare(NAME, got.astype(np.int32), want.astype(np.int32), "exact")


def _any_of(count: int, pair: Numbers, lamp: Lamp, seen: Aspects) -> Flags:
    """(2, n): whether of each of so many pairs of entries and occluders some receiver may be
    hidden, and whether some sample is."""
    result = np.zeros((2, count), bool)
    hides = np.flatnonzero(seen.may_hide)
    np.logical_or.at(result[0], pair[hides], True)
    np.logical_or.at(result[1], pair[hides], seen.hidden(lamp, hides).any(axis=1))
    return result
