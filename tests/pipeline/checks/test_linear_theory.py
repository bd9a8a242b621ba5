"""What is said of how far linear statics is off."""

from __future__ import annotations

import numpy as np

from gpusim.motion import Superposed
from gpusim.pipeline.checks.linear_theory import LinearError, linear_error
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.scene.frames import frame_table
from tests.support.small_scene import DOCUMENT, small_scene


def test_what_is_said_of_a_crane_that_bends_far() -> None:
    crane = LinearError("crane", 1, 0.42, 0.169, 1 / 1.07, longer=0.02, reach=0.08, size=0.9)
    text = crane.warning
    assert "about 11 mm (7 %) too large, of 169 mm" in text
    assert "turns by up to 24.1 degrees in frame 1" in text
    assert "it gets about 18 mm too long" in text
    stiff = LinearError("bar", 1, 0.01, 2e-3, 1.0, longer=0.0, reach=2e-3, size=0.25)
    assert stiff.warning == ""
    told = "0.57 degrees in frame 1: displacements are less than 0.1 % off unless it buckles"
    assert stiff.fact.endswith(told)


def test_the_frame_in_which_a_body_turns_most_decides() -> None:
    """One load moves it far without turning, the other turns it and moves it little."""
    body = {**DOCUMENT["body"][0]}
    load = body["load"][0]
    body["load"] = [
        {**load, "amplitude": [0.0, 1.0, 0.0]},
        {**load, "name": "turn", "force_N": [0.0, 1.0, 0.0], "amplitude": [0.0, 0.0, 1.0]},
    ]
    scene = small_scene(body=[body], analysis={"load_factors": [0.0, 0.5, 1.0]}, measure=[])
    parts = build_body(scene.bodies[0])
    x = parts.mesh.points[:, 0] / 0.24
    # lengthened by 40 mm, and bent to a tip's deflection of 12 mm
    u = np.zeros((2, len(x), 3))
    u[0, :, 0], u[1, :, 1] = 0.04 * x, 0.012 * x**2
    shown = [one.shown for one in frame_table(scene)]
    motion = Superposed(u, np.zeros((2, 1, 3)))
    found = linear_error(MovingBodies(scene, shown, [parts], [motion]), 0)
    assert found.frame == 2 and abs(found.moved - 0.012) <= 1e-12 and found.off > 0.002
