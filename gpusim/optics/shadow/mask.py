"""The share of a lamp that receivers in penumbra see, on the mask of `gpusim.optics.occlusion`.

Ends of what hides the lamp as a whole are wound round its samples: as often as layers hide them,
modulo 64. Those behind occluders that stand alone are taken off besides.
"""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Bound, Device, Recording, compare, twin_check
from gpusim.optics.shadow.probe import probe_pieces, probe_pixels, probe_points
from gpusim.optics.shadow.receivers import DeviceReceivers, PixelReceivers
from gpusim.optics.shadow.search import Search
from gpusim.optics.shadow.twin import shares_twin

__all__ = ["record_masks", "record_plain"]


def record_masks(
    recording: Recording, receivers: DeviceReceivers, search: Search, bound: Bound
) -> None:
    """Find the shares of what is in penumbra."""
    name, constants = "optics/shadow/mask", receivers.constants
    bound.run(recording, name, receivers.entry(), constants, counted=search.mask_groups)


def record_plain(recording: Recording, receivers: DeviceReceivers, bound: Bound) -> None:
    """Find the shares of all that isn't, which `Search` knows by the entry."""
    entry = receivers.entry("plain_tiles", "plain_pieces")
    threads = (receivers.groups,) if receivers.listed else receivers.size
    bound.run(recording, "optics/shadow/mask", entry, receivers.constants, threads=threads)


@twin_check("optics/shadow/mask")
def _check(device: Device) -> None:
    from gpusim.optics.shadow.visible import VisibleShares

    points = probe_points()
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        got = VisibleShares(device, occluders, receivers).find(points, spaces)
        if isinstance(receivers, PixelReceivers):
            pixel, own = receivers.receivers()
            got = got[pixel]
        else:
            own = receivers
        want = shares_twin(occluders, points[:, :3].astype(np.float64), spaces, own)
        # one or two samples of 512 may fall to the other side of an outline
        compare("optics/shadow/mask", got, want, atol=2.5 / 512.0)
