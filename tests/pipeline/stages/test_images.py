"""Pictures in time: lamps that flicker, and cameras that are triggered late."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import gpusim as gs
from gpusim.export.images import read_image
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from tests.support.small_scene import DOCUMENT, small_scene

CAMERA = DOCUMENT["camera"][0]
LAMP = {"name": "lamp", "type": "point", "position_mm": [100.0, -800.0, 300.0], "power_W": 20.0}


def lit(flicker: dict[str, float] | None, **camera: Any) -> Scene:
    """Three frames of a bar at rest."""
    light = [LAMP if flicker is None else {**LAMP, "flicker": flicker}]
    return small_scene(
        analysis={"type": "static", "load_factors": [0.0, 0.0, 0.0], "frame_rate_Hz": 240.0},
        camera=[{**CAMERA, **camera}], light=light, measure=[],
        output={"fields": False, "truth": []}, sensor={"bits": 16, "exposure": 0.8},
    )  # fmt: skip


def pictures(folder: Path, camera: str = "side") -> list[Any]:
    paths = sorted((folder / "images" / camera).glob("*.png"))
    return [read_image(path).astype(np.float64) for path in paths]


def test_rows_and_frames_in_flickering_light(tmp_path: Path) -> None:
    """Each row by the light of its own exposure, the middle one of a frame at the frame's time."""
    rolling = {"exposure_ms": 2.0, "line_time_us": 200.0}
    gs.run(lit(None), tmp_path / "steady", backend="numpy")
    flicker = {"mains_Hz": 50.0, "modulation": 0.3, "phase_deg": 40.0}
    gs.run(lit(flicker, shutter=rolling), tmp_path / "lit", backend="numpy")
    steady = pictures(tmp_path / "steady")[0]
    assert steady.max() > 20_000
    for number, seen in enumerate(pictures(tmp_path / "lit")):
        time = number / 240.0 + 200e-6 * (np.arange(120) - 59.5)
        factor = 1.0 + 0.3 * np.sinc(0.2) * np.cos(200.0 * np.pi * time + np.radians(40.0))
        assert np.abs(seen - factor[:, None] * steady).max() <= 1.5  # grey values of 16 bits


def test_a_plan_says_what_is_drawn_again() -> None:
    """At rest in steady light once; in flickering light each frame is another picture."""
    for flicker, drawn in ((None, 1), ({"pwm_Hz": 700.0, "duty": 0.4}, 3)):
        stages = [str(one) for one in make_plan(lit(flicker), backend="numpy").stages]
        frames = [text for text in stages if "render/" in text]
        assert len(frames) == 3 and sum("exposed again" in text for text in frames) == 3 - drawn
        assert any("flickering" in text for text in frames) == (flicker is not None)


def test_a_camera_that_is_late(tmp_path: Path) -> None:
    """Late by a frame it sees the next one; of a bar that is carried along, delay times velocity is
    the error of the disparity. Times of its film are the nominal ones, truth.h5 is what it saw."""
    (tmp_path / "ground.csv").write_text("t,a\n0,0\n0.0005,1000\n0.001,0\n1,0\n")
    speed, delay = 0.5, 130e-6
    triggers = {"on-time": None, "late": {"delay_us": 130.0}, "next": {"delay_us": 1000.0}}
    cameras = [
        {**CAMERA, "name": name} | ({} if trigger is None else {"trigger": trigger})
        for name, trigger in triggers.items()
    ]
    ground = {"file": "ground.csv", "direction": [1.0, 0.0, 0.0]}
    scene = small_scene(
        tmp_path, camera=cameras, body=[{**DOCUMENT["body"][0], "load": []}], measure=[],
        analysis={"type": "transient", "duration_s": 0.003, "frame_rate_Hz": 1000.0, "count": 4,
                  "base_motion": ground},
        output={"fields": False, "truth": ["displacement"]}, sensor={"bits": 16},
        video={"cameras": ["late"], "format": "png"},
    )  # fmt: skip
    out = tmp_path / "out"
    gs.run(scene, out, backend="numpy")
    on_time, late, following = (pictures(out, name) for name in triggers)
    assert np.array_equal(following[1], on_time[2]) and np.array_equal(following[2], on_time[3])
    assert not np.array_equal(on_time[2], on_time[3])

    def column(image: Any) -> float:
        return float((image.sum(axis=0) @ np.arange(450)) / image.sum())

    # the picture's scale: 450 px of 15 mm by 50 mm, in front of a face 900 mm away
    disparity = (column(late[3]) - column(on_time[3])) / (450 / 15.0 * 50.0 / 0.9)
    assert disparity == pytest.approx(speed * delay, rel=0.02)
    with h5py.File(out / "truth.h5") as truth:
        frames = {name: truth[f"camera/{name}/frame/0003"] for name in triggers}
        assert "late_s" not in frames["on-time"].attrs
        assert frames["late"].attrs["late_s"] == pytest.approx(delay, rel=1e-12)
        moved = {name: np.nanmean(one["displacement"][..., 0]) for name, one in frames.items()}
    assert moved["late"] - moved["on-time"] == pytest.approx(speed * delay, rel=0.01)
    assert moved["next"] - moved["on-time"] == pytest.approx(speed * 1e-3, rel=0.01)
    times = np.loadtxt(out / "video/late/times.csv", delimiter=",", skiprows=1)[:, 1]
    assert np.abs(times - np.arange(4) / 1000.0).max() <= 1e-12


def test_jitter_is_drawn_once_and_for_all() -> None:
    """Of 4,000 frames: its RMS within 3 standard errors, none of it shared by two cameras."""
    trigger = {"delay_us": -40.0, "jitter_us": 3.0, "seed": 5}
    scene = small_scene(
        camera=[{**CAMERA, "name": name, "trigger": trigger} for name in ("left", "right")],
        measure=[],
        analysis={"type": "transient", "duration_s": 0.003, "frame_rate_Hz": 1000.0, "count": 4},
    )  # fmt: skip
    left, right = (np.array([one.late(k) for k in range(4000)]) for one in scene.cameras)
    for late in (left, right):
        assert abs(late.mean() + 40e-6) <= 3 * 3e-6 / np.sqrt(4000)
        assert abs(late.std() / 3e-6 - 1.0) <= 3 / np.sqrt(8000)
        assert np.abs(late).max() <= scene.cameras[0].trigger.latest
    assert abs(np.corrcoef(left, right)[0, 1]) <= 3 / np.sqrt(4000)
    assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) <= 3 / np.sqrt(4000)
    assert left[17] == pytest.approx(-4.012552876490758e-05, rel=1e-9), "whatever the machine"
