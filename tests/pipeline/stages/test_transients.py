"""Scenes of motion in time, against the solver: frames, what is between them, the ground."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.pipeline.checks.resources import check_files, check_views
from gpusim.pipeline.scene_objects.modelling import build_model
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups, load_history
from tests.support.small_scene import DOCUMENT, small_scene

BODY = DOCUMENT["body"][0]
PUSH = BODY["load"][0]
TRANSIENT = {"type": "transient", "duration_s": 0.005, "frame_rate_Hz": 1000.0, "count": 6}
SHUTTER = {**DOCUMENT["camera"][0], "shutter": {"exposure_ms": 0.8}}


def scene_of(folder: Path | str = ".", load: Any = (PUSH,), **keys: Any) -> Scene:
    changes: dict[str, Any] = {"measure": [], "output": {"fields": False}}
    changes["camera"] = [SHUTTER] if keys.pop("shutter", False) else [DOCUMENT["camera"][0]]
    body = [{**BODY, "load": list(load)}]
    return small_scene(folder, analysis={**TRANSIENT, **keys}, body=body, **changes)


def model_of(scene: Scene) -> gs.Model:
    parts = build_body(scene.bodies[0], scene.input)
    return build_model(parts, load_groups(parts.body, (1.0,)), may_be_free=True).model


def test_frames_and_what_is_between_them() -> None:
    """By modes the motion at any instant that a shutter asks for is that of the modes."""
    scene = scene_of(shutter=True)
    history = gs.transient(model_of(scene), times=np.linspace(0.0, 0.006, 7), count=6)
    bar = scene.solution()["bar"]
    size = np.abs(history.at(0.003)[0]).max()
    for shift in (-4e-4, -1.234e-4, 0.0, 2.7e-4, 4e-4):
        u, v = history.at(0.003 + shift)
        assert np.abs(bar.displacement(3, shift) - u).max() <= 2e-7 * size
        assert np.abs(bar.velocity(3, shift) - v).max() <= 1e-4 * np.abs(v).max()
    # straight lines from frame to frame would be far off
    line = bar.displacement(3) + 2.7e-4 * bar.velocity(3)
    assert np.abs(line - history.at(0.00327)[0]).max() > 1e-2 * size
    assert np.array_equal(bar.displacement(0, -1e-4), bar.displacement(0))
    assert not bar.velocity(0, -1e-4).any(), "before the beginning it rests"
    still = small_scene(measure=[], output={"fields": False}).solution()["bar"]
    with pytest.raises(InputError, match=r"doesn't vibrate in frame 1 .* type 'static'"):
        still.velocity(1)


def test_a_blow_at_the_instant_of_a_frame() -> None:
    """What modes lack follows the load, corners included: they are instants of their own, or the
    exposure around them would be halved thousands of times."""
    times, blow = [0.0, 0.001, 0.0022, 0.003, 0.006], [0.0, 1.0, 0.3, 0.0, 0.0]
    load = {**PUSH, "amplitude": blow, "times_s": times}
    scene = scene_of(shutter=True, load=[load])
    record = gs.fem.Record(np.array(times), np.array(blow)[:, None])
    history = gs.transient(model_of(scene), times=np.linspace(0, 0.006, 7), loads=record, count=6)
    bar = scene.solution()["bar"]
    size = np.abs(history.at(0.002)[0]).max()
    for frame, shift in ((1, -2e-4), (1, 0.0), (1, 1e-5), (2, 1.99e-4), (2, 2.1e-4), (3, -3e-4)):
        u, v = history.at(1e-3 * frame + shift)
        assert np.abs(bar.displacement(frame, shift) - u).max() <= 2e-7 * size
        assert np.abs(bar.velocity(frame, shift) - v).max() <= 1e-4 * np.abs(v).max()
    (motion,) = bar._contents.motions
    assert len(motion.course.times) < 500


def test_steps_are_apart_from_frames() -> None:
    scene = scene_of(method="newmark", count=None, step_s=2e-5)
    times = np.arange(6) * 1e-3
    history = gs.transient(model_of(scene), times=times, method="newmark", step=2e-5)
    bar = scene.solution()["bar"]
    for frame in range(6):
        assert np.abs(bar.displacement(frame) - history.u[frame]).max() <= 1e-12
    (solve,) = (one for one in make_plan(scene).stages if one.name == "solve")
    assert "250 time steps for 6 frames" in solve.detail


def test_large_displacements_in_time() -> None:
    """Frames are those of the solver, what is between them its cubics, and a body that is held by
    its load stays where the nonlinear equilibrium is."""
    hard = {**PUSH, "force_N": [0.0, 0.0, -1.0e3]}
    keys = {"method": "generalized-alpha", "geometry": "nonlinear", "count": None, "step_s": 5e-4,
            "frame_rate_Hz": 500.0, "duration_s": 0.006, "load": [hard]}  # fmt: skip
    scene = scene_of(**keys, shutter=True)
    times, around = np.arange(4) * 2e-3, 4e-4
    history = gs.transient(
        model_of(scene), times=np.unique(np.r_[0.0, times + around, times[1:] - around, times]),
        method="generalized-alpha", geometry="nonlinear", step=5e-4,
    )  # fmt: skip
    bar, size = scene.solution()["bar"], np.abs(history.u).max()
    for frame in range(4):
        assert np.abs(bar.displacement(frame) - history.at(times[frame])[0]).max() <= 1e-9 * size
    assert np.abs(bar.displacement(2, 2e-4) - history.at(4.2e-3)[0]).max() <= 1e-9 * size
    (solve,) = (one for one in make_plan(scene).stages if one.name == "solve")
    assert "nonlinear, 12 time steps for 4 frames" in solve.detail
    linear = scene_of(**{**keys, "geometry": "linear"}).solution()["bar"]
    assert np.abs(bar.displacement(3) - linear.displacement(3)).max() > 0.02 * size
    held = scene_of(**keys, release=[]).solution()["bar"]
    still = gs.solve(model_of(scene), geometry="nonlinear").u
    for frame in (0, 3):
        assert np.abs(held.displacement(frame) - still).max() <= 1e-4 * np.abs(still).max()


def test_what_is_let_go_leaves_from_its_equilibrium() -> None:
    weight = {"name": "weight", "type": "gravity"}
    scene = scene_of(load=[weight, PUSH], release=["push"])
    bar = scene.solution()["bar"]
    both = gs.solve(model_of(scene)).u
    # of the modes and of what they lack of static answers
    assert np.abs(bar.displacement(0) - both).max() <= 2e-3 * np.abs(both).max()
    alone = gs.solve(model_of(scene_of(load=[weight]))).u
    mean = np.mean([bar.displacement(k) for k in range(6)], axis=0)
    assert np.abs(mean - alone).max() < 0.5 * np.abs(both - alone).max()
    held = scene_of(load=[weight, PUSH], release=[])
    still = held.solution()["bar"]
    assert np.abs(still.displacement(5) - both).max() <= 2e-3 * np.abs(both).max()


def test_the_ground_carries_a_body_along(tmp_path: Path) -> None:
    """A camera that stands still sees the ground's motion and the body's on it."""
    (tmp_path / "quake.csv").write_text("t,a\n0,0\n0.001,20\n0.003,-10\n1,-10\n")
    ground = {"file": "quake.csv", "direction": [0.0, 0.0, 2.0]}
    keys = {"load": (), "base_motion": ground, "duration_s": 0.004}
    bar = scene_of(tmp_path, **keys).solution()["bar"]
    fixed = np.isclose(bar.mesh.points[:, 0], 0.0)
    # 20 t^3 / 6 at 1 ms, then a falls by 15 a ms
    v, x = 0.01, 20e-3 / 6e6 * 1e3
    at_2_ms = x + v * 1e-3 + 0.5 * 20 * 1e-6 - 15e3 * 1e-9 / 6
    moved = bar.displacement(2)[fixed]
    assert np.abs(moved - [0.0, 0.0, at_2_ms]).max() <= 1e-12
    record = gs.Record(np.array([0.0, 1e-3, 3e-3, 1.0]), np.outer([0, 20, -10, -10], [0, 0, 1.0]))
    model = model_of(scene_of(tmp_path, **keys))
    relative = gs.transient(model, times=np.arange(5) * 1e-3, count=6, base=record).u[2]
    assert np.abs(bar.displacement(2) - relative - [0.0, 0.0, at_2_ms]).max() <= 1e-10
    (tmp_path / "quake.csv").write_text("t,a\n0,0\n0.001,20\n")
    short = scene_of(tmp_path, **keys)
    with pytest.raises(
        InputError, match=r"base_motion: times; got 0 to 0.001; expected 0 to 0.004"
    ):
        check_files(short)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("t,a\n0,0\n0.001,nan\n", "quake.csv: line 3; got '0.001,nan'"),
        ("t,a\n0,0\n1,0\n0.5,0\n", "quake.csv: line 4; got '0.5,0'; expected times that"),
        ("t,ax,ay,az\n0,0,0,0\n1,0,0,9\n", "quake.csv; got 4 columns; expected time, and one "
         "acceleration along direction"),
        # the shutter is open for 0.4 ms after the last frame
        ("t,a\n0,0\n0.005,9\n", "quake.csv: analysis.base_motion: times; got 0 to 0.005; "
         "expected 0 to 0.0054"),
    ],
)  # fmt: skip
def test_a_ground_whose_record_is_wrong(tmp_path: Path, text: str, told: str) -> None:
    """Told before a run writes anything, as by a plan."""
    (tmp_path / "quake.csv").write_text(text)
    ground = {"file": "quake.csv", "direction": [0.0, 0.0, 1.0]}
    scene = scene_of(tmp_path, load=(), base_motion=ground, shutter=True)
    for check in (check_files, check_views):
        with pytest.raises(InputError, match=told):
            check(scene)


def test_time_functions_of_loads() -> None:
    pulse = {**PUSH, "amplitude": [0.0, 3.0, 0.0], "times_s": [0.001, 0.002, 0.004]}
    frames = {**PUSH, "name": "frames", "amplitude": [0.0, 1.0, 0.0, 0.0, 0.0, 0.0]}
    other = {**PUSH, "name": "gone"}
    scene = scene_of(load=[pulse, frames, other], release=["gone"])
    history = load_history(scene.bodies[0], scene.analysis, 0.0055)
    assert history.times == (0.0, 0.001, 0.002, 0.003, 0.004, 0.005, 0.0055)
    first, second, gone = history.groups
    assert first.amplitude == (0.0, 0.0, 3.0, 1.5, 0.0, 0.0, 0.0) and first.loads == ((0, 1.0),)
    assert second.amplitude == (0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert gone.loads == ((2, 1.0),) and not any(gone.amplitude)
    assert history.start == (0.0, 0.0, 1.0)
    without = load_history(scene_of().bodies[0], scene_of().analysis, 0.01)
    assert without.times == (0.0, 0.01) and without.groups[0].amplitude == (1.0, 1.0)
    assert without.start == ()


@pytest.mark.drawn
def test_report_has_motion_and_energy(tmp_path: Path) -> None:
    scene = scene_of(duration_s=0.002, damping={"rayleigh_mass_per_s": 5.0})
    report = gs.run(scene, tmp_path / "out", backend="numpy")
    assert report.status == "done" and report.facts["solved, bar"].startswith("6 modes")
    assert (tmp_path / "out" / "figures" / "chart-2.png").is_file()
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Motion, bar" in page and "Energy, bar" in page and "time 0.002 s" in page
    assert "Relative to the ground" not in page
    assert [one["mode"] for one in report.modes] == [1, 2, 3, 4, 5, 6]
    first = report.modes[0]
    share = 100 * 5.0 / (4 * np.pi * first["frequency_Hz"])  # of critical damping, by mass
    assert first["damping_percent"] == pytest.approx(share) and "Damping / %" in page
    assert not any("Lowest" in name for name in report.highlights)
