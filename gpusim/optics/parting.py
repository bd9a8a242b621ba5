"""Faces that run past a lamp on both sides, parted where its plane cuts them.

A face hides the part of a lamp that it covers as seen from a receiver, if it lies between. That is
sure of faces before the lamp, and of those whose plane has all of the lamp on its far side. Where a
lamp and a face run through each other's planes, as where a lamp leans at a column or is half sunk
into a ceiling, only what lies before the lamp hides any of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gpusim.optics.casters import Casters
from gpusim.optics.emitters import Lamp

__all__ = ["parted"]

Array = npt.NDArray[np.float64]
AT = 1e-9
"""Of a face's distance from a lamp: so near to its plane counts as in it."""


def parted(casters: Casters, lamps: Sequence[Lamp]) -> Casters:
    """``casters`` with the faces parted that run through the planes of ``lamps``, and these
    through theirs."""
    for lamp in lamps:
        if lamp.extended and not lamp.far:
            faces = _astride(casters, lamp)
            if len(faces):
                casters = _parted(casters, lamp, faces)
    return casters


def _astride(casters: Casters, lamp: Lamp) -> npt.NDArray[np.int64]:
    """Faces with corners on both sides of a lamp's plane whose own plane cuts the lamp."""
    to = casters.corners - lamp.centre
    ahead = to @ lamp.axis
    slack = AT * np.abs(to).max(axis=(1, 2), initial=0.0)
    both = np.flatnonzero((ahead.max(axis=1) > slack) & (ahead.min(axis=1) < -slack))
    normal = casters.normal[both]
    away = np.abs(np.sum(normal * to[both].mean(axis=1), axis=1))
    cut = away <= np.abs(normal @ lamp.u) + np.abs(normal @ lamp.v)
    return np.asarray(both[cut])


def _parted(casters: Casters, lamp: Lamp, faces: npt.NDArray[np.int64]) -> Casters:
    points, pieces, owner = [casters.points], [], []
    count = len(casters.points)
    for face in faces:
        corner = casters.faces[face]
        corner = corner[corner != np.roll(corner, 1)]
        place = casters.points[corner]
        height = (place - lamp.centre) @ lamp.axis
        for sign in (1.0, -1.0):
            side, new = _half(corner, place, sign * height, count)
            points.append(new)
            count += len(new)
            for first in range(1, len(side) - 1, 2):
                last = side[min(first + 2, len(side) - 1)]
                pieces.append([side[0], side[first], side[first + 1], last])
                owner.append(face)
    whose = np.array(owner)
    # the first piece of a face takes its number, the others follow behind all
    _, begin = np.unique(whose, return_index=True)
    more = np.setdiff1d(np.arange(len(whose)), begin)
    source = np.concatenate([np.arange(len(casters.faces)), whose[more]])
    shapes = casters.faces[source]
    shapes[whose[begin]] = np.array(pieces)[begin]
    shapes[len(casters.faces) :] = np.array(pieces)[more]
    every = np.concatenate(points)
    normal = casters.normal[source]
    number = np.concatenate([whose[begin], np.arange(len(casters.faces), len(source))])
    corners = every[shapes[number]]
    normal[number] = 0.5 * np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    # a shadow may end at each of their edges, as far as anybody can tell
    cut = np.zeros(len(casters.faces), bool)
    cut[faces] = True
    kept = ~cut[casters.edge[:, 0]]
    beside = np.where((casters.beside >= 0) & cut[casters.beside], -1, casters.beside)[kept]
    face, place = np.divmod(np.arange(4 * len(number)), 4)
    point = shapes[number]
    own = np.where(point == np.roll(point, -1, axis=1), -2, -1).reshape(-1)
    return replace(
        casters, points=every, faces=shapes, normal=normal,
        both_sides=casters.both_sides[source], body=casters.body[source],
        edge=np.concatenate([casters.edge[kept], np.stack([number[face], place], axis=1)]),
        beside=np.concatenate([beside, own]),
        ends=np.concatenate(
            [casters.ends[kept],
             np.stack([point.reshape(-1), np.roll(point, -1, axis=1).reshape(-1)], axis=1)]
        ),
        into=np.where(cut[casters.into] | (casters.into < 0), -1, casters.into),
    )  # fmt: skip


def _half(
    corner: npt.NDArray[np.int64], place: Array, height: Array, count: int
) -> tuple[list[int], Array]:
    """Numbers of the corners of what has ``height`` >= 0 of a face, the new ones from ``count`` on,
    and where these are (n, 3)."""
    side: list[int] = []
    new: list[Array] = []
    for k in range(len(corner)):
        a, b = k - 1, k
        if (height[a] < 0) != (height[b] < 0):
            share = height[a] / (height[a] - height[b])
            side.append(count + len(new))
            new.append(place[a] + share * (place[b] - place[a]))
        if height[b] >= 0:
            side.append(int(corner[b]))
    return side, np.array(new).reshape(-1, 3)
