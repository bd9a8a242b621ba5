"""What is said of how far bodies turn by linear statics."""

from __future__ import annotations

import numpy as np

from gpusim.motion import Superposed
from gpusim.pipeline.checks.linear_theory import LinearMotion, linear_motion
from gpusim.pipeline.scene_objects.moving_bodies import MovingBodies
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.scene.frames import frame_table
from tests.support.small_scene import DOCUMENT, small_scene


def test_what_is_said_of_a_crane_that_bends_far() -> None:
    text = LinearMotion("crane", 1, 0.42, reach=0.08, size=0.9).warning
    assert "'crane': it turns by up to 24.1 degrees in frame 1" in text and "units" not in text
    assert '[analysis] geometry = "auto"' in text
    far = LinearMotion("crane", 1, 0.42, reach=1.8, size=0.9)
    assert "differ by 1.8e+03 mm in frame 1, 200 % of its size" in far.warning
    assert far.doubtful.endswith('Then say [analysis] geometry = "nonlinear"')
    stiff = LinearMotion("bar", 1, 0.01, reach=2e-3, size=0.25)
    assert stiff.warning == "" == stiff.doubtful
    assert stiff.fact == "turns by up to 0.573 degrees in frame 1 (buckling isn't looked for)"


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
    found = linear_motion(MovingBodies(scene, shown, [parts], [motion]), 0)
    # the middle of the last of 40 cells or so turns by almost half of what the end does
    assert found.frame == 2 and 0.04 <= found.turn <= 0.05
