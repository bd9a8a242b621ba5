"""Sheets, boxes and bodies of revolution, of which the gallery's scenes are made."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import gpusim as gs

Array = npt.NDArray[np.float64]
SQUARE = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
FACE = np.array([[0, 1, 2, 3]])


def turned(points: Array, angle: float) -> Array:
    """Turned about z."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def sheet(
    centre: tuple[float, ...], half: tuple[float, ...], paint: gs.paint.Paint, turn: float = 0.0
) -> gs.Surface:
    """A level rectangle, or upright and turned by ``turn`` if it has a third half size."""
    points = SQUARE * [half[0], half[1], 0.0]
    if len(half) > 2:
        points = turned(points[:, [0, 2, 1]], turn)
    return gs.Surface(points + centre, FACE, paint=paint)


def box(
    centre: tuple[float, ...], half: tuple[float, ...], paint: gs.paint.Paint, turn: float = 0.0
) -> gs.Surface:
    """A closed box, turned about z."""
    signs = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
    faces = np.array(
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    )
    return gs.Surface(turned(signs * half, turn) + centre, faces, paint=paint)


def turned_body(
    profile: Array, centre: tuple[float, ...], paint: gs.paint.Paint, count: int = 64
) -> gs.Surface:
    """A closed body of revolution about z: ``profile`` (K, 2) radius and height, from below."""
    angle = np.arange(count) * 2.0 * np.pi / count
    inner = profile[1:-1]
    rings = np.stack(
        [np.outer(inner[:, 0], np.cos(angle)), np.outer(inner[:, 0], np.sin(angle)),
         np.repeat(inner[:, 1:], count, axis=1)], axis=2,
    )  # fmt: skip
    ends = [[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]]
    points = np.concatenate([rings.reshape(-1, 3), ends])
    i, rows = np.arange(count), len(inner)
    j, last = (i + 1) % count, len(points) - 1
    faces = [np.stack([i + k, j + k, j + k + count, i + k + count], axis=1)
             for k in range(0, count * (rows - 1), count)]  # fmt: skip
    top = count * (rows - 1)
    bottom = np.full(count, last - 1)
    none = np.full(count, -1)
    faces.append(np.stack([j, i, bottom, none], axis=1))
    faces.append(np.stack([top + i, top + j, bottom + 1, none], axis=1))
    return gs.Surface(points + centre, np.concatenate(faces), paint=paint)


def ball(centre: tuple[float, ...], radius: float, paint: gs.paint.Paint) -> gs.Surface:
    """A sphere."""
    angle = np.linspace(0.0, np.pi, 25)
    profile = radius * np.stack([np.sin(angle), -np.cos(angle)], axis=1)
    return turned_body(profile, centre, paint, 48)
