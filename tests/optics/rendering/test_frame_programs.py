"""What a frame has compiled in advance is what it asks for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device

LAMP = gs.AreaLight((-0.4, -1.2, 0.7), (0.0, 0.0, 0.0), (0.2, 0.1), 20.0)
SUN = gs.SunLight((0.3, 1.0, -0.6), 2.0)
BULB = gs.PointLight((-2.4, -3.2, 3.7), 60.0, shadows=False)

STEEL = gs.paint.Plain(0.5, roughness=0.3, metallic=0.6)
SPECKLE = gs.paint.Speckle(0.03, 0.4, 0.008, seed=3)
BOARD = gs.paint.Checker(0.037, dark=0.2, light=0.8)

FIRST = ("optics/shading/", "optics/raster/", "optics/edge_pixels/scatter")
"""Asked for before anything could be compiled in advance, or compiled in no time."""


def scene(paint: gs.paint.Paint) -> list[gs.Surface]:
    """A plate before a wall."""
    corners = np.array(
        [[-0.3, 0.0, -0.15], [0.3, 0.0, -0.15], [0.3, 0.02, 0.15], [-0.3, 0.0, 0.15]]
    )
    return [
        gs.Surface(corners, [[0, 1, 2, 3]], paint),
        gs.Surface(3.0 * corners + [0.0, 0.2, 0.0], [[0, 1, 2, 3]]),
    ]


@pytest.mark.parametrize(
    ("paint", "lights", "distortion"),
    [
        (BOARD, None, None),
        (SPECKLE, [BULB], None),
        (SPECKLE, [LAMP], None),
        (STEEL, [LAMP, gs.AmbientLight(0.2)], None),
        (BOARD, [SUN, LAMP], [-0.1, 0.03, 1e-3, -2e-3]),
    ],
    ids=["unlit", "no shadows", "lamp", "gloss", "distorted"],
)
def test_what_is_compiled_in_advance_is_what_is_asked_for(
    paint: gs.paint.Paint, lights: list[Any] | None, distortion: list[float] | None,
    device: Device, monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (120, 80), (0.12, -1.0, 0.28), (0.02, 0.0, 0.0), distortion=distortion
    )
    begun: set[Any] = set()
    monkeypatch.setattr(device.programs, "begin", begun.update)
    device.programs.asked.clear()
    gs.render(scene(paint), camera, lights, device=device)
    asked = set(device.programs.asked)
    assert begun <= asked
    late = {key for key in asked if not str(key[0]).startswith(FIRST)}
    assert late <= begun
    relit = {key for key in begun if key[0] == "optics/shading/relighting"}
    assert bool(relit) == bool(lights and lights != [BULB])
