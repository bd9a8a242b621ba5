"""What hides nothing of itself: what a lamp lights of it is a single layer, from all of the lamp.

Where all triangles of an oriented sheet turn the same side to a lamp, a ray from the lamp meets the
sheet as often as its border winds round the ray. An outer border that runs once up and once down
along some direction winds once at most, and holes that are starlike only take away from that: such
a sheet hides nothing of itself. Of a closed body that holds for the part turned to the lamp, behind
which the rest is dark. What is asked is linear in the lamp's point: what holds for the corners of
its face holds for all of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.optics.geometry.feature_edges import border_of
from gpusim.optics.geometry.vertex_attributes import SurfaceNormals, surface_normals
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.light_space import LightSpace, light_spaces
from gpusim.optics.shadow.occluders import SHEETS
from gpusim.surface.surface import Surface

SURE = 1e-14
"""Of the numbers that go into it, beyond which a difference isn't rounding."""

DIRECTIONS = np.pi * (np.arange(36) + 0.5) / 36.0
"""Along which a border is looked at."""


def without_shadows(
    surfaces: Sequence[Surface], lights: Sequence[Light], eye: Float
) -> list[Light]:
    """The same ``lights``, without shadows those that surely hide nothing that the ``eye`` sees:
    of a single surface."""
    found = list(lights)
    lamps = {id(lamp.light): lamp for lamp in lamps_of(lights) if lamp.light.shadows}
    if not lamps or len(surfaces) > 1 or not surfaces[0].topology.oriented:
        return found
    shape = surface_normals(surfaces)[0]
    points = shape.points - eye
    for number, light in enumerate(lights):
        spaces = light_spaces([lamps[id(light)]], points, eye) if id(light) in lamps else []
        if len(spaces) == 1 and (spaces[0].ahead(points) > spaces[0].begin).all():
            if _single_layer(spaces[0], surfaces[0], shape, points):
                found[number] = replace(lamps[id(light)].light, shadows=False)
    return found


def wound_once(space: LightSpace, surfaces: Sequence[Surface], eye: Float) -> int:
    """Bits of the open ones of the first `SHEETS` surfaces whose border winds once at most round
    any ray to a lamp. They hide nothing of themselves if all of their triangles turn the same side
    to it, which is found where these are looked at."""
    result = 0
    for number, surface in enumerate(surfaces[:SHEETS]):
        topology = surface.topology
        if topology.oriented and not topology.closed:
            starts, ends = border_of(topology, None)
            at = surface.points[starts] - eye
            ahead = bool((space.ahead(at) > space.begin).all())
            result |= (ahead and _winds_once(space, at, starts, ends)) << number
    return result


def _single_layer(
    space: LightSpace, surface: Surface, shape: SurfaceNormals, points: Float
) -> bool:
    """Whether a lamp lights all of a surface that is turned to it, and nothing else that the eye
    sees; ``points`` (P, 3): its vertices, from there."""
    topology, area, lamp = surface.topology, shape.area, space.lamp
    start = np.stack([np.take(v, topology.triangles[:, 0]) for v in points.T])
    before = np.einsum("at,at->t", area, start)
    height = lamp.centre @ area - (0.0 if lamp.far else before)
    sweep = np.abs(lamp.u @ area) + np.abs(lamp.v @ area)
    sweep += SURE * space.scale * np.abs(area).sum(axis=0)
    lit, dark = height > sweep, height < -sweep
    if topology.closed:
        outward = float(np.sum(area * (start - points.mean(axis=0)[:, None]))) > 0.0
        if not (outward and lit.any() and (lit | dark).all()):
            return False
    elif not (lit.all() or dark.all()):
        return False
    starts, ends = border_of(topology, lit if topology.closed else None)
    if not _winds_once(space, points[starts], starts, ends):
        return False
    # the side turned away, where the eye sees that: normals for shading may lean towards the lamp
    away = np.flatnonzero((before < 0.0) & dark if topology.closed else (before < 0.0) != lit)
    if not len(away):
        return True
    rough = any(getattr(paint, "bump", None) is not None for paint in surface.paints.values())
    reach = 1.0 if lamp.far else np.linalg.norm(points - space.centre, axis=1).max()
    reach += np.linalg.norm(lamp.u) + np.linalg.norm(lamp.v)
    lean = np.sin(min(surface.smooth_angle, 0.5 * np.pi)) * np.linalg.norm(area[:, away], axis=0)
    return not rough and bool(((np.abs(height) - sweep)[away] > lean * reach).all())


def _place(space: LightSpace, points: Float) -> Float:
    """`LightSpace.place`, to the last digits of how points differ."""
    middle, frame = points.mean(axis=0), np.stack([space.across, space.along, space.axis], axis=1)
    result: Float = (points - middle) @ frame + (middle - space.centre) @ frame
    if space.lamp.far:
        result[:, 2] *= -1.0
    else:
        result[:, 2] = 1.0 / result[:, 2]
        result[:, :2] *= result[:, 2:]
    return result


def _winds_once(space: LightSpace, at: Float, starts: Long, ends: Long) -> bool:
    """Whether a border between vertices (n,) each, the first at (n, 3), winds once at most round
    every ray."""
    order = np.argsort(starts)
    starts, ends = starts[order], ends[order]
    after = np.searchsorted(starts, ends)
    if (np.diff(starts) == 0).any() or not np.array_equal(starts, np.sort(ends)):
        return False
    graph = csr_matrix((np.ones(len(after)), (np.arange(len(after)), after)))
    loop = connected_components(graph, directed=False)[1].astype(np.int64)
    at = _place(space, at[order])
    change = at[after] - at
    x, y = (at[:, :2] - at[0, :2]).T
    area = np.bincount(loop, x * change[:, 1] - y * change[:, 0])
    turn = np.sign(area)
    outer = np.flatnonzero(turn == np.sign(area.sum()))
    if len(outer) != 1:
        return False
    own, half = loop == outer[0], np.array(space.half)
    slack = SURE * float(np.abs(at[:, :2]).max() + half.sum() * np.abs(at[:, 2]).max())
    return _monotone(half, change[own], (np.cumsum(own) - 1)[after[own]], slack) and bool(
        np.delete(_starlike(half, at, change, loop, turn, slack), outer).all()
    )


def _starlike(half: Float, at: Float, change: Float, loop: Long, turn: Float, slack: float) -> Bool:
    """Which loops, that turn one way (1) or the other (-1), all run that way round their middle;
    ``at``, ``change`` (n, 3) of edges, ``loop`` (n,) that each is part of."""
    middle = np.stack([np.bincount(loop, v) for v in at.T], axis=1) / np.bincount(loop)[:, None]
    result = np.ones(len(turn), bool)
    for corner in np.array([[-1.0, -1.0], [-1.0, 1.0], [1.0, -1.0], [1.0, 1.0]]):
        first = at - middle[loop]
        one, other = (v[:, :2] - corner * half * v[:, 2:] for v in (first, first + change))
        cross = (one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]) * turn[loop]
        angle = np.arctan2(cross, np.sum(one * other, axis=1))
        sure = cross > 4.0 * slack * np.abs(np.stack([one, other])).max()
        result &= (np.bincount(loop, ~sure) == 0) & (np.bincount(loop, angle) < 3.0 * np.pi)
    return result


def _monotone(half: Float, change: Float, after: Long, slack: float) -> bool:
    """Whether a loop of edges that ``change`` (n, 3) runs up once and down once along some
    direction; ``after`` (n,): the next edge."""
    for way in np.stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)], axis=1):
        rise = change[:, :2] @ way
        least = float(np.abs(way) @ half) * np.abs(change[:, 2]) + slack
        up = rise > 0.0
        if (np.abs(rise) > least).all() and np.count_nonzero(up != up[after]) == 2:
            return True
    return False
