"""The renderings that an exposure is put together from, and the lamps that light each of them.

Radiance is linear in lamps. Where all rows are exposed at once, lamps that flicker are dimmed to
their mean over each moment's part of the exposure; parts end where lamps are switched, so that a
stroboscope's picture is where its flashes are. Where rows follow each other, each kind of flicker
is a rendering of its own, multiplied by its mean over the exposure of each row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.lens.shutter import Shutter
from gpusim.optics.light.flicker import Flicker
from gpusim.optics.light.lights import Light, dimmed
from gpusim.surface.surface import Surface
from gpusim.validation import require

Look = Callable[[float], tuple[Sequence[Surface], Camera]]
"""Surfaces and camera when a share of the exposure has passed."""


class Part(NamedTuple):
    """A rendering and its weight; ``gains`` (H,) of the picture's rows, in which nothing but its
    lights shines."""

    weight: float
    surfaces: Sequence[Surface]
    camera: Camera
    lights: Sequence[Light] | None
    gains: Float | None = None


def lit_moments(
    moments: tuple[Float, Float], look: Look, lights: Sequence[Light] | None, shutter: Shutter,
    rows: Float, shines: bool,
) -> list[Part]:  # fmt: skip
    """The parts of an exposure, first those without gains.

    ``moments``: shares of it (K,) and weights (K,); ``rows`` (H,) s: when each of them opens;
    ``shines``: whether there is radiance without lamps.
    """
    kinds: dict[Flicker | None, list[Light]] = {None: []}
    for light in lights if isinstance(lights, Sequence) else ():
        flicker = getattr(light, "flicker", None)
        require(isinstance(flicker, Flicker | None), "light: flicker", repr(flicker), "a Flicker")
        kinds.setdefault(flicker, []).append(light)
    steady, rolls = kinds.pop(None), bool(shutter.line_time)
    if not kinds:
        pairs = zip(*(one.tolist() for one in moments), strict=True)
        return [Part(weight, *look(share), lights) for share, weight in pairs]
    (shares, weights), length = moments, shutter.exposure_time
    edges = np.append(0.0, np.cumsum(weights))
    if not rolls:
        rows, few = rows[:1], len(shares)
        slow = [kind for kind in kinds if kind and few > 1 and kind.frequency * length <= few]
        cuts = [kind.switches(rows[0], rows[0] + length) - rows[0] for kind in slow]
        if any(map(len, cuts)):
            edges = np.union1d(edges, np.concatenate(cuts) / length)
            shares, weights = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    ends = rows + length * edges[:, None]
    lit = [(of, kind.mean(ends[:-1], ends[1:])) for kind, of in kinds.items() if kind]
    parts: list[tuple[int, Sequence[Light], Float | None]] = []
    for k in range(len(weights)):
        now = [] if rolls else [(of, gains[k, 0]) for of, gains in lit if gains[k, 0]]
        parts.append((k, [*steady, *(dimmed(lamp, gain) for of, gain in now for lamp in of)], None))
    if rolls:
        parts += [(k, of, gains[k]) for k in range(len(weights)) for of, gains in lit]
    parts = [one for one in parts if one[1] or shines] or parts[:1]
    return [Part(float(weights[k]), *look(float(shares[k])), lamps, own) for k, lamps, own in parts]
