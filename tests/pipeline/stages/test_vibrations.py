"""Scenes of modes, steady vibrations and buckling, against the solver that finds them."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, NotConverged
from gpusim.pipeline.runner.scene_contents import scene_contents
from gpusim.pipeline.scene_objects.modelling import build_model
from gpusim.pipeline.scene_objects.surfaces import build_body
from gpusim.plan.plan import make_plan
from gpusim.scene import Scene
from gpusim.scene.amplitudes import load_groups
from gpusim.scene.frames import frame_table
from gpusim.view.content.loading import load_content
from tests.support.small_scene import DOCUMENT, small_scene

BODY = DOCUMENT["body"][0]
MODAL = {"type": "modal", "count": 4, "modes": [1, 3], "phases": 4, "amplitude_mm": 3.0}
PUSHED = {**BODY, "load": [{**BODY["load"][0], "force_N": [-100.0, 0.0, 0.0]}]}


def scene_of(analysis: dict[str, Any], body: dict[str, Any] = BODY, **changes: Any) -> Scene:
    own = {"measure": [], "output": {"fields": False}}
    return small_scene(analysis=analysis, body=[body], **{**own, **changes})


def model_of(scene: Scene) -> gs.Model:
    parts = build_body(scene.bodies[0], scene.input)
    return build_model(parts, load_groups(parts.body, (1.0,)), may_be_free=True).model


@pytest.fixture(scope="module")
def modal() -> Scene:
    return scene_of(MODAL, {**BODY, "load": []})


def test_frames_show_modes_in_their_phases(modal: Scene) -> None:
    bar = modal.solution()["bar"]
    found = gs.modes(model_of(modal), 4)
    assert bar.frames == 1 + 2 * 4 and not bar.displacement(0).any()
    for frame, mode in ((1, 0), (5, 2)):
        shape = found.shapes[mode]
        u = 3e-3 * shape / np.linalg.norm(shape, axis=1).max()
        assert np.abs(bar.displacement(frame) - u).max() <= 1e-12
        assert not bar.displacement(frame + 1).any()
        assert np.abs(bar.displacement(frame + 2) + u).max() <= 1e-12
    assert bar.reactions(1).shape == (0, 3)


IN_TIME = {"duration_s": 0.01, "frame_rate_Hz": 1000.0}


def test_frames_of_a_duration_are_in_time(modal: Scene) -> None:
    """Each mode at its own frequency, all at once, from their place at rest."""
    video = {"frame_rate_Hz": 1000.0, "exposure_us": 300.0}
    analysis = {key: value for key, value in MODAL.items() if key != "phases"}
    scene = small_scene(**{**modal.document, "analysis": {**analysis, "duration_s": 0.01},
                           "video": video})  # fmt: skip
    bar, found = scene.solution()["bar"], gs.modes(model_of(scene), 4)
    assert bar.frames == 11 and not bar.displacement(0).any()
    motion, state = scene_contents(scene).vibrations(4)[0]
    now, speed = np.zeros_like(found.shapes[0]), np.zeros_like(found.shapes[0])
    for mode in (0, 2):
        shape, angular = found.shapes[mode], 2.0 * np.pi * found.frequencies[mode]
        u = 3e-3 * shape / np.linalg.norm(shape, axis=1).max()
        now += u * np.sin(0.004 * angular)
        speed += angular * u * np.cos(0.004 * angular)
    assert np.abs(bar.displacement(4) - now).max() <= 1e-9
    assert np.abs(motion.velocity(state) - speed).max() <= 1e-6 * np.abs(speed).max()
    table = frame_table(scene)
    assert [table[k].time for k in (0, 4, 10)] == [0.0, 0.004, 0.01]
    assert table[4].shown.states == ((-1.0, -0.25, 0.004),)
    assert scene.analysis.frame_text(4) == "time 0.004 s"
    keys = [_solve_key(one) for one in (modal, scene)]
    assert keys[0] == keys[1], "modes are solved again to be filmed"


def test_a_rolling_shutter_films_a_mode_row_by_row(modal: Scene) -> None:
    """At any instant around any frame the sine of that time."""
    analysis = {**MODAL, **IN_TIME}
    del analysis["phases"]
    scene = small_scene(**{**modal.document, "analysis": {**analysis, "modes": [1]}})
    objects = scene_contents(scene)
    motion, state = objects.vibrations(7)[0]
    rate, amplitude = gs.modes(model_of(scene), 4).frequencies[0], motion.displacement((1.0, 0.0))
    for later in (-3e-4, 0.0, 2.5e-3):
        u = motion.displacement(motion.later(state, later))
        now = amplitude * np.sin(2.0 * np.pi * rate * (0.007 + later))
        assert np.abs(u - now).max() <= 1e-12
    in_time = objects.around((7,), 7, 0.0)
    assert in_time is not None and objects.around((0,), 0, 0.0) is not None


def test_a_camera_sees_what_happens_while_its_shutter_is_open(modal: Scene) -> None:
    """At any instant the mode's own motion, not a straight line from frame to frame."""
    objects = scene_contents(modal)
    motion, state = objects.vibrations(5)[0]
    in_time = objects.around((5,), 5, 0.0)
    assert in_time is not None
    rest = objects.surfaces(5)[0].points
    rate = gs.modes(model_of(modal), 4).frequencies[2]
    for time in (0.0, 0.25 / rate, 1.7 / rate):
        (surface,) = in_time(time)
        u = motion.displacement(state) * np.cos(2.0 * np.pi * rate * time)
        moved = objects.bodies[0].skin.moved(objects.bodies[0].surface, u)
        assert np.abs(surface.points - moved.points).max() <= 1e-9
    assert np.abs(in_time(0.5 / rate)[0].points - rest).max() > 5e-3
    assert objects.around((0,), 0, 0.0) is None


def test_what_an_exposure_takes_for_the_place(modal: Scene) -> None:
    """Its mean: of a cosine that is in its middle at rest sin x / x of the amplitude, x being half
    the angle that passes while the shutter is open."""
    objects = scene_contents(modal)
    motion, state = objects.vibrations(5)[0]
    rate, amplitude = gs.modes(model_of(modal), 4).frequencies[2], motion.displacement(state)
    for periods in (0.05, 0.4, 2.5):
        mean = amplitude + objects.drift(0, 5, periods / rate)
        assert np.abs(mean - np.sinc(periods) * amplitude).max() <= 2e-4 * np.abs(amplitude).max()
    assert not objects.drift(0, 0, 0.01).any(), "in frame 0 it rests"


def test_a_blurred_motion_is_named_as_the_cause(tmp_path: Path) -> None:
    """143 Hz: the first bending mode is a fifth of a period on the way in 1.5 ms."""
    camera = {**DOCUMENT["camera"][0], "shutter": {"exposure_ms": 1.5}}
    shape = {"type": "modal", "count": 2, "modes": [1], "phases": 1, "amplitude_mm": 1.0}
    body = {**BODY, "load": []}
    scene = scene_of(shape, body, camera=[camera], measure=DOCUMENT["measure"])
    report = gs.run(scene, tmp_path / "out", backend="numpy")
    (tip,) = [one for one in report.measurements if one.name.endswith(", -z")]
    rate = report.modes[0]["frequency_Hz"]
    missed = float(np.sinc(1.5e-3 * rate)) - 1.0
    assert abs(tip.measured / tip.truth - 1.0 - missed) <= 0.1 * abs(missed) + 2e-3
    assert any("the shutter is open while it moves" in text for text in report.warnings)


def test_loads_stiffen_or_weaken() -> None:
    """Frame 0 has the body loaded, and the others vibrate about that."""
    scene = scene_of({"type": "modal", "count": 1, "phases": 2, "prestress": True}, PUSHED)
    model = model_of(scene)
    solved = gs.solve(model)
    found = gs.modes(model, 1, prestress=solved)
    assert found.frequencies[0] < 0.995 * gs.modes(model, 1).frequencies[0]
    bar = scene.solution()["bar"]
    assert np.abs(bar.displacement(0) - solved.u).max() <= 1e-12
    swing = bar.displacement(1) - bar.displacement(0)
    shape = 1e-3 * found.shapes[0] / np.linalg.norm(found.shapes[0], axis=1).max()
    assert np.abs(swing - shape).max() <= 1e-9


def test_a_free_body_shows_its_elastic_modes() -> None:
    scene = scene_of(
        {"type": "modal", "count": 2, "phases": 1}, {**BODY, "load": [], "support": []}
    )
    found = gs.modes(model_of(scene), 8)
    u = scene.solution()["bar"].displacement(1)
    shape = found.shapes[6] / np.linalg.norm(found.shapes[6], axis=1).max()
    assert found.rigid and found.frequencies[6] > 0.0
    assert np.abs(u - 1e-3 * shape).max() <= 1e-9


def test_modes_that_a_band_has_not() -> None:
    scene = scene_of({"type": "modal", "band_Hz": [100.0, 300.0], "modes": [3]},
                     {**BODY, "load": []})  # fmt: skip
    with pytest.raises(InputError, match=r"analysis.modes: body 'bar'; got 3; expected at most 2"):
        scene.solution()


def test_a_steady_vibration_lags_behind_its_load() -> None:
    given = {"type": "harmonic", "frequencies_Hz": [100.0, 143.0], "phases": 4,
             "damping": {"ratio": 0.02}}  # fmt: skip
    scene = scene_of(given)
    bar = scene.solution()["bar"]
    found = gs.harmonic(model_of(scene), [100.0, 143.0], damping=gs.ModalDamping(0.02))
    del given["phases"]
    filmed = scene_of({**given, "duration_s": 0.002, "frame_rate_Hz": 800.0}).solution()["bar"]
    u = sum(found.at(k, 2.0 * np.pi * rate / 800.0) for k, rate in enumerate((100.0, 143.0)))
    assert filmed.frames == 2 and np.abs(filmed.displacement(1) - u).max() <= 1e-9
    assert bar.frames == 9 and not bar.displacement(0).any()
    for frame, number, phase in ((1, 0, 0.0), (2, 0, 0.5), (7, 1, 1.0)):
        u = found.at(number, np.pi * phase)
        assert np.abs(bar.displacement(frame) - u).max() <= 1e-9 * np.abs(found.u).max()


def test_a_rod_on_a_shaker() -> None:
    """Shaken along its axis: the ends of a slender rod move as 1 to 1 / cos(k L)."""
    slack, length, rates = 0.1, 0.24, [4000.0, 5300.0]
    material = [{**DOCUMENT["material"][0], "poissons_ratio": 0.0}]
    shaker = {"acceleration_m_s2": 50.0, "direction": [2.0, 0.0, 0.0]}
    scene = scene_of(
        {"type": "harmonic", "frequencies_Hz": rates, "phases": 4, "base_motion": shaker,
         "damping": {"loss_factor": slack}, "count": 40, "band_Hz": [10.0, 5000.0]},
        {**BODY, "load": [], "mesh": {**BODY["mesh"], "divisions": [40, 1, 1]}},
        material=material,
    )  # fmt: skip
    bar = scene.solution()["bar"]
    x, steel = bar.mesh.points[:, 0], scene.materials[0]
    assert np.isclose(np.ptp(x), length) and not bar.displacement(0).any()
    speed = np.sqrt(steel.youngs_modulus * (1.0 + 1j * slack) / steel.density)
    for number, rate in enumerate(rates):
        angular = 2.0 * np.pi * rate
        base = -50.0 / angular**2
        true = base * np.cos(angular / speed * (length - x)) / np.cos(angular / speed * length)
        for phase in range(4):
            moved = bar.displacement(1 + 4 * number + phase)
            off = moved[:, 0] - (true * 1j**phase).real
            assert np.abs(off).max() <= 2e-3 * np.abs(true).max()
            assert np.abs(moved[:, 1:]).max() <= 1e-6 * np.abs(true).max()
            held = np.isclose(x, x.min())
            assert np.abs(moved[held, 0] - (base * 1j**phase).real).max() <= 1e-12 * abs(base)
    # at the end of its first quarter of a wave it moves more than the shaker
    assert np.abs(bar.displacement(6)).max() > 5.0 * 50.0 / (2.0 * np.pi * rates[1]) ** 2


def test_a_body_that_nothing_drives_rests() -> None:
    still = {**BODY, "name": "still", "load": []}
    still["paint"] = [{**one, "name": f"still-{one['name']}"} for one in BODY["paint"]]
    given = {"type": "harmonic", "frequencies_Hz": [100.0], "phases": 2, "damping": {"ratio": 0.1}}
    both = small_scene(analysis=given, body=[BODY, still], measure=[], output={"fields": False})
    solved = both.solution()
    assert solved["bar"].displacement(1).any() and not solved["still"].displacement(1).any()


def test_a_column_buckles() -> None:
    scene = scene_of({"type": "buckling", "count": 2, "amplitude_mm": 5.0}, PUSHED)
    found = gs.buckling(model_of(scene), 2)
    u = scene.solution()["bar"].displacement(2)
    shape = found.shapes[1] / np.linalg.norm(found.shapes[1], axis=1).max()
    assert np.abs(u - 5e-3 * shape).max() <= 1e-9 and make_plan(scene)


def test_what_is_wrong_is_told_of_a_body() -> None:
    pulled = {**BODY, "load": [{**BODY["load"][0], "force_N": [100.0, 0.0, 0.0]}]}
    scene = scene_of({"type": "buckling", "count": 2, "amplitude_mm": 5.0}, pulled)
    with pytest.raises(NotConverged, match=r"solve, body 'bar': buckling: .*no positive load f"):
        scene.solution()


@cache
def _stages(scene_text: str) -> str:
    (solve,) = (one for one in make_plan(gs.load_scene(scene_text)).stages if one.name == "solve")
    return solve.detail


def test_a_plan_says_what_is_superposed(modal: Scene, tmp_path: Path) -> None:
    path = tmp_path / "modal.toml"
    path.write_text(modal.to_toml())
    assert "4 modes; 9 frames are superposed from them" in _stages(str(path))
    changed = modal.replace("analysis.phases", 16), modal.replace("analysis.amplitude_mm", 1.0)
    keys = [_solve_key(one) for one in (modal, *changed)]
    assert len(set(keys)) == 1, "modes are solved again for other phases"
    assert _solve_key(modal.replace("analysis.mass", "lumped")) != keys[0]


def _solve_key(scene: Scene) -> str:
    return next(one.key for one in make_plan(scene).stages if one.name == "solve")


def test_report_and_window(modal: Scene, tmp_path: Path) -> None:
    report = gs.run(modal.replace("output.fields", True), tmp_path / "out", backend="numpy")
    assert report.status == "done" and [one["mode"] for one in report.modes] == [1, 2, 3, 4]
    first = report.modes[0]
    assert 140.0 < first["frequency_Hz"] < 147.0 and first["error"] <= 1e-8
    assert 60.0 < first["mass_z_percent"] < 65.0 and first["mass_x_percent"] == 0.0
    (table,) = report.first_tables
    assert table.columns[:3] == ("Body", "Mode", "Frequency / Hz")
    assert table.rows[0][:2] == ("bar", "1")
    assert report.highlights["Lowest frequency, bar"][1] == "mode 1"
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "mode 3, phase 270 deg" in page
    content = load_content(tmp_path / "out")
    assert content.frames == 9 and not content.unloaded
    assert content.frame_text(2) == "frame 2 (3 of 9): mode 1, phase 90 deg"
    assert np.isclose(np.linalg.norm(content.displacement(0, 1), axis=1).max(), 3e-3)
    again = load_content(tmp_path / "out")
    again.move((), None)
    assert again.unloaded and again.take_over(content) and not again.unloaded
