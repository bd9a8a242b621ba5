"""The share of a lamp that receivers in penumbra see, on the mask of
`gpusim.optics.shadow.sample_mask`.

Ends of what hides the lamp as a whole are wound round its samples: as often as layers hide them,
modulo 64. Those behind occluders that stand alone are taken off besides.
"""

from __future__ import annotations

import numpy as np

from gpusim.gpu import Bound, Device, Recording, compare, twin_check
from gpusim.optics.probes.occluders import probe_pieces, probe_pixels, probe_points
from gpusim.optics.shadow.brute_force import shares_twin
from gpusim.optics.shadow.occluder_search import Search
from gpusim.optics.shadow.receiver_groups import entries_of
from gpusim.optics.shadow.receivers import DeviceReceivers

__all__ = ["record_masks"]


def record_masks(
    recording: Recording, receivers: DeviceReceivers, search: Search, bound: Bound
) -> None:
    """Find the shares of receivers of entries in penumbra; of a list also those of all others."""
    name = "optics/shadow/penumbra_mask"
    search.run_counted(recording, bound, name, "penumbra")
    search.run_counted(recording, bound, name, "mixed", "mixed")
    if receivers.listed:
        bound.run(recording, name, "plain", receivers.constants, threads=(receivers.groups,))


@twin_check("optics/shadow/penumbra_mask")
def _check(device: Device) -> None:
    from gpusim.optics.shadow.lamp_visibility import VisibleShares

    points = probe_points()
    for occluders, spaces, receivers in (probe_pieces(), probe_pixels()):
        got = VisibleShares(device, occluders, receivers).find(points, spaces)
        number, own, _, _ = entries_of(receivers)
        want = shares_twin(occluders, points[:, :3].astype(np.float64), spaces, own)
        # one or two samples of 512 may fall to the other side of an outline
        compare("optics/shadow/penumbra_mask", got[number], want, atol=2.5 / 512.0)
