"""The share of a lamp that receivers in penumbra see, on the mask of
`gpusim.optics.shadow.sample_mask`.

Ends of what hides the lamp as a whole are wound round its samples: as often as layers hide them,
modulo 64. Those behind occluders that stand alone are taken off besides.
"""

from __future__ import annotations

from gpusim.gpu import Bound, Recording
from gpusim.optics.shadow.occluder_search import OccluderSearch
from gpusim.optics.shadow.receivers import DeviceReceivers

__all__ = ["record_masks"]


def record_masks(
    recording: Recording, receivers: DeviceReceivers, search: OccluderSearch, bound: Bound
) -> None:
    """Find the shares of receivers of entries in penumbra; of a list also those of all others."""
    name = "optics/shadow/penumbra_mask"
    search.run_counted(recording, bound, name, "penumbra")
    search.run_counted(recording, bound, name, "mixed", "mixed")
    if receivers.listed:
        bound.run(recording, name, "plain", receivers.constants, threads=(receivers.groups,))
