"""What is true of modes and of steady vibrations that are filmed, in a camera's picture."""

from __future__ import annotations

from typing import Any

import numpy as np

from gpusim.measure import mac
from gpusim.pipeline.measurements.modes.true_modes import true_modes
from gpusim.scene import Scene
from tests.support.small_scene import DOCUMENT, small_scene

BODY = DOCUMENT["body"][0]
PIXELS = np.c_[np.linspace(60.0, 400.0, 9), np.full(9, 59.5)]


def filmed(analysis: dict[str, Any], load: list[Any]) -> Scene:
    video = {"frame_rate_Hz": 2000.0}
    return small_scene(analysis=analysis | {"duration_s": 0.05}, body=[{**BODY, "load": load}],
                       video=video, measure=[], output={"fields": False})  # fmt: skip


def test_modes_that_are_shown() -> None:
    """At rest in the first frame, each its own frequency and shape; nothing dies away."""
    scene = filmed({"type": "modal", "count": 4, "modes": [1, 3]}, [])
    motion = scene.motion()
    points = motion.seen_at("side", PIXELS)
    true = true_modes(motion, "side", points)
    speed, turns = np.sqrt(70e9 / 2700.0), np.array([1.8751, 4.6941]) / 0.24
    beam = turns**2 * 0.01 * speed / np.sqrt(12.0) / (2.0 * np.pi)
    assert np.allclose(true.frequency_Hz, beam, rtol=0.02)
    assert np.isnan(true.damping).all()
    # bending, as a cantilever's, without and with a node
    across = true.shapes[..., 1] * np.sign(true.shapes[:, -1:, 1])
    assert (np.diff(across[0]) > 0.0).all() and across[1].min() < -0.5 * across[1].max()
    assert np.abs(true.shapes[..., 0]).max() < 0.05 * np.abs(across).max()


def test_a_steady_vibration_where_it_is_farthest() -> None:
    """At resonance a quarter of a period after its load, in the shape of the mode."""
    modal = filmed({"type": "modal", "count": 1}, []).motion()
    mode = true_modes(modal, "side", modal.seen_at("side", PIXELS))
    rate = float(mode.frequency_Hz[0])
    analysis = {"type": "harmonic", "frequencies_Hz": [rate], "damping": {"ratio": 0.005}}
    motion = filmed(analysis, BODY["load"]).motion()
    points = motion.seen_at("side", PIXELS)
    steady = true_modes(motion, "side", points)
    assert steady.frequency_Hz.tolist() == [rate]
    assert mac(steady.shapes, mode.shapes) > 0.9999
