"""Markers that are measured in pictures made for the eye: what is told is what a run shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from gpusim.pipeline import run
from gpusim.pipeline.checks.warnings import scene_warnings
from gpusim.scene import load_scene


@pytest.mark.parametrize(
    ("sensor", "moved"),
    [
        ({"gamma": "srgb"}, {"gamma 'srgb'": 0.02}),
        ({"bayer": "RGGB", "demosaic": "malvar"}, {"'malvar'": 0.04}),
        ({"bayer": "RGGB", "demosaic": "bilinear", "gamma": "srgb"},
         {"'bilinear'": 0.1, "gamma 'srgb'": 0.02}),
    ],
)  # fmt: skip
def test_pictures_for_the_eye_move_markers(
    sensor: dict[str, Any], moved: dict[str, float], checkout: Path, tmp_path: Path
) -> None:
    """Of 15 px, in a run, by what is told."""
    scene = load_scene(checkout / "examples" / "cantilever.toml")
    for key, value in (
        ("camera.side.resolution_px", [900, 360]), ("body.bar.paint.side.size_mm", 5.0),
        ("prop.wall.paint.static.size_mm", 5.0), ("output", {}),
    ):  # fmt: skip
        scene = scene.replace(key, value)
    assert not any("centres" in text for text in scene_warnings(scene))
    if "bayer" in sensor:
        scene = scene.replace("camera.side.channels", "rgb")
    scene = scene.replace("sensor", {"bits": 8, **sensor})
    (text,) = (text for text in scene_warnings(scene) if "centres" in text)
    assert text.startswith("measure 'deflection': camera 'side'")
    for word, pixels in moved.items():
        assert f"{word} by about {pixels} px" in text.replace(")", "")
    report = run(scene, tmp_path / "out")
    assert text in report.warnings
    (error,) = (one.error for one in report.measurements if "RMS error" in one.name)
    assert 0.5 * sum(moved.values()) < 3.0 * error < 1.5 * sum(moved.values())  # 3 px per mm
