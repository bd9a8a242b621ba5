"""Casters' faces joined as one lamp sees them, for receivers with wide penumbrae.

A shadow ends at outlines. What is bent towards a lamp, as a loaded beam is, still has straight
ones in its view, and where half of the lamp's size is seen over many pixels, outlines may be off by
a share of that. Faces that turn away from the lamp are joined in its view: p and q (where a
point's shadow falls) and s (how near the lamp is), this in units of the lamp's size. A change of s
by a share of what lies between caster and receiver moves outlines by less than that share of the
penumbra.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters, LampFaces
from gpusim.optics.lamp_grid import LampView
from gpusim.optics.merging import Merged, merge_flat

__all__ = ["SHARE", "joined_for"]

Array = npt.NDArray[np.float64]

SHARE = 1e-3
"""Of a lamp, by which a face's outline may change what is seen of it; half the lattice's step."""

CLOSE = 0.2
"""Receivers this much as far behind the casters as the farthest ones take joined faces."""

FEWEST, WORTH = 100, 0.7
"""Faces turned away from a lamp, and the share left of them, which are worth a second set."""


def joined_for(view: LampView, casters: Casters, faces: LampFaces, lowest: float) -> Casters | None:
    """``casters`` with those of ``faces`` joined that the lamp of ``view`` sees from behind.

    ``lowest``: the least s of any receiver. None where too few faces are left out for it to be
    worth while. `Casters.sag` is then how far their outlines are off in p, q and s in those units.
    """
    away = np.zeros(len(casters.faces), bool)
    away[faces.face[faces.side < 0]] = True
    count = int(np.count_nonzero(away))
    if not view.lamp.extended or count < FEWEST or not np.isfinite(lowest):
        return None
    p, q, s = view.place(*casters.points.T)
    size = 2.0 * min(view.half)
    nearest = np.unique(casters.faces[away])
    rise = float(np.nanmedian(s[nearest])) - lowest
    if not rise > 0.0:  # false for NaN: all of them behind the lamp
        return None
    points = np.stack([p, q, size * s], axis=1)
    allowed = np.full(len(points), CLOSE * SHARE * size * rise)
    merged = merge_flat(points, casters.faces, allowed, away)
    if len(casters.faces) - len(merged.faces) < (1.0 - WORTH) * count:
        return None
    return casters.joined_as(merged, _off(points, casters.faces, merged))


def _off(points: Array, faces: npt.NDArray[np.int64], merged: Merged) -> Array:
    """How far the sides of joined faces (M,) pass from the corners (N, 3) along them."""
    result = np.zeros(len(merged.faces))
    parts = np.bincount(merged.owner, minlength=len(result))
    face, place = np.nonzero(~merged.inner & (parts[merged.owner] > 1)[:, None])
    owner = merged.owner[face]
    first = points[merged.faces[owner, place]]
    along = points[merged.faces[owner, (place + 1) % 4]] - first
    length = np.linalg.norm(along, axis=1)
    for corner in (faces[face, place], faces[face, (place + 1) % 4]):
        across = np.linalg.norm(np.cross(points[corner] - first, along), axis=1)
        np.maximum.at(result, owner, across / np.where(length > 0.0, length, 1.0))
    return result
