"""What surfaces hide of one lamp in a picture: by outlines where these tell, else by faces."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.optics.caster_sets import CasterSets
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import Lamp
from gpusim.optics.half_shadow import HalfShadow, half_shadow
from gpusim.optics.lamp_layer import Alone, Patch
from gpusim.optics.lamp_outline import Outline
from gpusim.optics.outline_shadow import outline_shadow
from gpusim.optics.patches import Small
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_edges import TileEdges

__all__ = ["CastersOf", "LampShadow", "lamp_shadow", "outlined"]

MANY = 4000
"""Casters of a body that may hide parts of itself, for whose border it is worth while to look."""

Numbers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

CastersOf = Callable[[frozenset[int]], Casters]
"""The faces of all surfaces but those of some numbers."""


@dataclass(frozen=True, eq=False)
class LampShadow:
    """``dark``: tiles (linear) that the lamp doesn't light; ``faces``: those before it, tile by
    tile; ``edges``: of borders before it."""

    dark: Numbers
    faces: HalfShadow
    edges: TileEdges


def lamp_shadow(
    receivers: Receivers, small: Small, lamp: Lamp, casters: CastersOf, alone: Sequence[Alone],
    shape: tuple[int, int],
) -> LampShadow:  # fmt: skip
    """What is hidden of a ``lamp`` in a picture of ``shape`` (rows, columns) tiles; ``small``: of
    the receivers; ``alone``: see `gpusim.optics.lamp_layer.surfaces_alone`."""
    others = casters(outlined(alone))
    told = _worth(alone, others)
    facing = ~receivers.turned_away(lamp) if told else np.zeros(receivers.view.count, bool)
    found = [outline_shadow(receivers, small, Outline(*one), facing, shape) for one in told]
    unsure = np.zeros(shape, bool)
    for one in found:
        unsure.reshape(-1)[one.unsure] = True
    own, doubt = _own(receivers, told)
    free = own & ~doubt
    bulging = own & ~np.isin(receivers.view.body, list(outlined(alone)))
    whole = [one.surface for one, patch in told if not patch.alone]
    among = _beside_borders(others, told)
    beside_borders = CasterSets(receivers, lamp, others, bulging, among, whole)
    parts = [half_shadow(receivers, small, beside_borders, ~unsure)]
    doubt &= facing
    beside = doubt.any() and not unsure.all()
    if unsure.any() or beside:
        every = CasterSets(receivers, lamp, casters(frozenset()), free)
    if unsure.any():
        parts.append(half_shadow(receivers, small, every, unsure))
    if beside:
        # others there are what outlines tell about
        parts.append(half_shadow(receivers, small, every, ~unsure, doubt))
    dark, flat = np.zeros(shape[0] * shape[1], bool), unsure.reshape(-1)
    for one in found:
        dark[one.dark[~flat[one.dark]]] = True
    for part in parts:
        dark[part.dark] = True
    faces = HalfShadow.joined(parts).without(dark)
    # where all is hidden nothing has to be told
    edges = [one.edges[np.flatnonzero(~(flat | dark)[one.edges.tile])] for one in found]
    return LampShadow(np.flatnonzero(dark), faces, TileEdges.joined([*edges, faces.contours]))


def outlined(alone: Sequence[Alone]) -> frozenset[int]:
    """The surfaces of which no face has to be looked at."""
    return frozenset(
        one.surface
        for one in alone
        if isinstance(one.patch, Patch) and one.patch.alone and not len(one.patch.band)
    )


def _worth(alone: Sequence[Alone], casters: Casters) -> list[tuple[Alone, Patch]]:
    """Those surfaces, with what hides the lamp of them, that borders tell about."""
    count = np.bincount(casters.body, minlength=1)
    result = []
    for one in alone:
        patch: Patch | None = None
        if isinstance(one.patch, Patch):
            patch = one.patch
        elif one.surface < len(count) and count[one.surface] >= MANY:
            patch = one.patch.patch
        if patch is not None:
            result.append((one, patch))
    return result


def _beside_borders(casters: Casters, told: Sequence[tuple[Alone, Patch]]) -> Flags:
    """(F,) which ``casters`` hide what the borders of surfaces ``told`` don't tell of: those of
    bands, and of all other surfaces."""
    among = ~np.isin(casters.body, [one.surface for one, _ in told])
    for one, patch in told:
        into = casters.into[one.source[patch.band]]
        among[into[into >= 0]] = True
    return among


def _own(receivers: Receivers, told: Sequence[tuple[Alone, Patch]]) -> tuple[Flags, Flags]:
    """(T,) receivers on surfaces that hide nothing of themselves, and those of them that may lie in
    the shadow of their own nevertheless."""
    view = receivers.view
    result = np.isin(view.body, [one.surface for one, patch in told if patch.alone])
    doubt = [one.source[patch.doubt].astype(np.int64) for one, patch in told]
    several = np.concatenate([np.zeros(0, np.int64), *doubt])
    faces = np.zeros(max(int(view.face.max(initial=0)), int(several.max(initial=0))) + 1, bool)
    faces[several] = True
    return result, result & faces[view.face]
