"""Drops occluders listed alone that hide nothing from any receiver of the entry.

An entry's box in light space is larger than what its receivers look from, and nearly all of an open
sheet that they lie on is listed. Most of it is below the planes that they see, or beside the way;
what is left is tested receiver by receiver.
"""

from __future__ import annotations

from gpusim.gpu import Bound, Recording
from gpusim.optics.shadow.occluder_search import OccluderSearch

__all__ = ["record_refinement"]

NAME = "optics/shadow/occluder_refinement"


def record_refinement(recording: Recording, search: OccluderSearch, bound: Bound) -> None:
    """Refine the entries that the search has said."""
    search.run_counted(recording, bound, NAME, "sifted", "sift")
    search.run_counted(recording, bound, NAME, "refined")
