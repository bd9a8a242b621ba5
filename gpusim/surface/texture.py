"""Pictures that lie on a surface by texture coordinates (u, v), as other programs unwrap them.

Paint coordinates are texels here: u times the picture's width, v times its height.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Long
from gpusim.surface.bitmap import WIDEST, Image
from gpusim.validation import require

ROUND = 1e-4
"""Of a picture's side, by which coordinates may miss its border."""

NARROW = 1e-3
"""Side, in texels, of what is seen by a triangle to which one point of the picture belongs."""

MOST_TEXELS = 1 << 26
"""Of a picture with its repeats, or of all that lie on a surface: some 2 GB are made of them."""

PERIODS = {"repeat": 1, "mirror": 2, "clamp": 0}
"""After how many pictures one that goes on beyond its sides begins anew; 0: never."""


def textured(
    picture: Image, uv: npt.ArrayLike, wrap: tuple[str, str] = ("repeat", "repeat")
) -> tuple[Image, Float]:
    """A picture and where on it the corners of triangles lie, from texture coordinates.

    ``picture`` has texels of side 1; ``uv`` (T, 3, 2) counts its widths and heights from its lower
    left corner. ``wrap``: how it goes on beyond 0 to 1, along u and v: "repeat", "mirror" (every
    other one is turned over) or "clamp" (by its outermost texels). Returns it, continued as far as
    asked for, and the paint coordinates (T, 3, 2) for `gpusim.surface.frames.Atlas`.

    Raises
    ------
    InputError
        Coordinates that aren't finite, or that continue it beyond the largest size of pictures.

    Examples
    --------
    >>> from gpusim.surface.texture import textured
    >>> picture = gs.paint.Image(np.eye(4), texel=1.0)
    >>> wide, st = textured(picture, [[[1.5, 0.0], [2.5, 0.0], [2.5, 1.0]]])
    >>> wide.pixels.shape, st[0].tolist()
    ((4, 8), [[2.0, 0.0], [6.0, 0.0], [6.0, 4.0]])
    """
    uv = np.array(uv, np.float64).reshape(-1, 3, 2)
    whole = np.isfinite(uv).all()
    require(whole, "texture coordinates", "faces without", "some for every corner")
    low = uv.min(axis=1, keepdims=True) + ROUND
    periods, first = [PERIODS[kind] for kind in wrap], np.floor(low.min(axis=(0, 1), initial=0.0))
    for axis, period in enumerate(periods):
        if period:
            uv[..., axis] -= period * np.floor(low[..., axis] / period)
            first[axis] = 0.0
    uv -= first
    rows, columns = picture.pixels.shape[:2]
    tiles = np.maximum(np.ceil(uv.max(axis=(0, 1), initial=1.0) - ROUND), 1.0)
    wanted = tiles * (columns, rows)
    fits = (wanted <= WIDEST).all() and wanted.prod() <= max(MOST_TEXELS, rows * columns)
    repeated = f"some that repeat a picture of {columns} x {rows} {tiles[0]:g} x {tiles[1]:g} times"
    expected = f"at most {WIDEST} pixels a side, {MOST_TEXELS:,} in all"
    require(fits, "texture coordinates", repeated, expected)
    if tiles.prod() > 1.0 or first.any():
        across, up = (
            _continued(int(count), size, period, int(start))
            for count, size, period, start in zip(
                wanted, (columns, rows), periods, first, strict=True
            )
        )
        pixels = picture.pixels[(rows - 1 - up)[::-1]][:, across]
        picture = replace(picture, pixels=pixels)
    st = np.clip(uv, 0.0, tiles) * (columns, rows)
    # exporters give some triangles one point of the picture, or a line: a tiny part of it
    a, b = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    empty = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) < NARROW**2
    st[empty] = st[empty].mean(axis=1, keepdims=True) + NARROW * np.array([[0, 0], [1, 0], [0, 1]])
    return picture, st


def _continued(count: int, size: int, period: int, first: int) -> Long:
    """Which of ``size`` texels is seen at each of ``count`` places, of which the leftmost lies in
    the picture of number ``first``."""
    place = np.arange(count) + first * size
    if not period:
        return np.clip(place, 0, size - 1)
    place %= period * size
    return np.minimum(place, 2 * size - 1 - place)
