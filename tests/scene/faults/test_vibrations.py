"""Scenes that can't vibrate or buckle as they are told to: one clear fault, with a way out."""

from __future__ import annotations

import re
from typing import Any

import pytest

from gpusim.errors import SceneError
from tests.support.small_scene import DOCUMENT, small_scene

MODAL: dict[str, Any] = {"type": "modal"}
TRANSIENT = {"type": "transient", "duration_s": 0.01, "frame_rate_Hz": 1000.0}
HARMONIC = {"type": "harmonic", "frequencies_Hz": [100.0]}
BUCKLING = {"type": "buckling"}
BODY = DOCUMENT["body"][0]
PUSH = BODY["load"][0]


def body(**changes: Any) -> list[dict[str, Any]]:
    return [{**BODY, **changes}]


def told(**changes: Any) -> str:
    with pytest.raises(SceneError) as caught:
        small_scene(**changes)
    message = str(caught.value)
    assert "1 fault\n" in message, message
    return message


@pytest.mark.parametrize(
    ("analysis", "load", "line"),
    [
        (MODAL, [PUSH], "body.bar.load: modes without prestress don't feel loads; got loads; "
         "expected analysis.prestress = true, or no load"),
        ({**MODAL, "prestress": True}, [], "analysis.prestress: nothing acts on bodies; got no "
         "load; expected a [[body.load]]"),
        (BUCKLING, [], "analysis.type: nothing acts on bodies; got no load"),
        (HARMONIC, [], "analysis.type: nothing acts on bodies"),
        (TRANSIENT, [], "analysis.type: nothing acts on bodies"),
        ({**TRANSIENT, "release": ["pusch"]}, [PUSH], "analysis.release.0: no such load; got "
         '"pusch"; expected one of push'),
        (HARMONIC, [{**PUSH, "amplitude": [1.0]}], "body.bar.load.push.amplitude: in an analysis "
         "of type \"harmonic\", whose loads don't vary with frames"),
        ({"type": "static"}, [{**PUSH, "amplitude": [0.0, 1.0], "times_s": [0.0, 1.0]}],
         'load.push.times_s: in an analysis of type "static"; got [0.0, 1.0]; expected none'),
        (TRANSIENT, [{**PUSH, "amplitude": [0.0, 1.0]}], "load.push.amplitude: not one factor per "
         "frame; got 2 factors; expected 11, as many as frames in [analysis]"),
        (TRANSIENT, [{**PUSH, "amplitude": [0.0, 1.0], "times_s": [0.0]}],
         "times_s: not one per factor of amplitude; got 1 times; expected 2"),
        (TRANSIENT, [{**PUSH, "amplitude": [0.0, 1.0], "times_s": [1.0, 0.0]}],
         "times_s: not in their order; got [1.0, 0.0]; expected times that increase"),
        ({**TRANSIENT, "release": ["push"]}, [{**PUSH, "amplitude": [0.0, 1.0],
         "times_s": [0.0, 0.01]}], "load.push.amplitude: of a load that is let go at time 0; got "
         "[0.0, 1.0]; expected no amplitude, or the load not in analysis.release"),
        (TRANSIENT, [{**PUSH, "amplitude": [0.0, 1.0], "times_s": [0.02, 0.03]}],
         "times_s: all after analysis.duration_s; got [0.02, 0.03]; expected times of which some "
         "are within 0.01 s, or a longer duration_s"),
        (TRANSIENT, [{"name": "heat", "type": "thermal", "temperature_change_K": 5.0}],
         'load.heat: not known in an analysis of type "transient"; got "thermal"'),
    ],
)  # fmt: skip
def test_loads(analysis: dict[str, Any], load: list[Any], line: str) -> None:
    expanding = [{**DOCUMENT["material"][0], "expansion_per_K": 2e-5}]
    assert line in told(analysis=analysis, body=body(load=load), material=expanding)


@pytest.mark.parametrize("analysis", [MODAL, TRANSIENT, HARMONIC])
def test_a_material_without_density(analysis: dict[str, Any]) -> None:
    light = [{**DOCUMENT["material"][0], "density_kg_m3": 0.0}]
    load = [] if analysis is MODAL else [PUSH]
    line = ("body.bar.material: vibrates on a material without density; got \"steel\"; expected "
            "density_kg_m3 > 0")  # fmt: skip
    assert line in told(analysis=analysis, body=body(load=load), material=light)


def test_supports_of_what_is_followed_in_time() -> None:
    moved = [{**BODY["support"][0], "displacement_mm": [0.0, 0.0, 1.0]}]
    assert ('support.clamp.displacement_mm: in an analysis of type "transient"; got [0.0, 0.0, 1.0]'
            in told(analysis=TRANSIENT, body=body(support=moved)))  # fmt: skip
    message = told(analysis=MODAL, body=body(support=moved, load=[]))
    assert 'displacement_mm: in an analysis of type "modal"' in message
    assert "expected zero, or analysis.prestress = true" in message
    stressed = {**MODAL, "prestress": True}
    assert small_scene(analysis=stressed, body=body(support=moved), measure=[])


def test_a_shutter_before_what_does_not_move() -> None:
    camera = [{**DOCUMENT["camera"][0], "shutter": {"exposure_ms": 1.0}}]
    line = "without a time between frames; got a shutter; expected no shutter"
    assert line in told(analysis=BUCKLING, camera=camera)


@pytest.mark.parametrize(
    ("analysis", "line"),
    [
        ({"type": "transient", "duration_s": 1.0}, "analysis.frame_rate_Hz: missing; got no "
         "frame_rate_Hz; expected frames per second, in [video] or [analysis]"),
        ({**MODAL, "load_factors": [0.0, 2.0]}, 'analysis.load_factors: unknown key; expected '
         'one of type, count, modes, amplitude_mm, phases, duration_s, frame_rate_Hz, band_Hz, '
         'mass, prestress (a key of "static")'),
        ({**MODAL, "band_Hz": [10.0, 5.0], "modes": [1]}, "analysis.band_Hz: no band"),
        ({**MODAL, "band_Hz": [10.0, 50.0]}, "analysis.modes: missing beside band_Hz"),
        ({**MODAL, "count": 3, "modes": [4]}, "analysis.modes: more than count; got 4; expected at "
         "most 3"),
        ({**MODAL, "damping": {"ratio": 0.1}}, '(a key of "transient" or "harmonic")'),
        ({**TRANSIENT, "damping": {}}, "analysis.damping: not one kind of damping; got no kind"),
        ({**HARMONIC, "damping": {"ratio": 0.1, "loss_factor": 0.1}}, "not one kind of damping; "
         "got ratio and loss"),
        ({**TRANSIENT, "damping": {"loss_factor": 0.1}}, "analysis.damping.loss_factor: unknown "
         "key; expected one of ratio, rayleigh_mass_per_s, rayleigh_stiffness_s"),
        ({**TRANSIENT, "step_s": 1e-5}, 'analysis.step_s: of method "modal"; got 1e-05; expected a '
         'method that steps, as "newmark"'),
        ({**TRANSIENT, "geometry": "nonlinear"}, 'analysis.geometry: of method "modal"'),
        ({**TRANSIENT, "method": "hht", "damping": {"ratio": 0.0}}, "analysis.damping.ratio: of "
         'method "hht"; got 0.0; expected Rayleigh'),
        ({**TRANSIENT, "method": "hht", "geometry": "nonlinear",
          "damping": {"rayleigh_stiffness_s": 0.1}}, "would damp rotations"),
        ({**HARMONIC, "base_motion": {"acceleration_m_s2": 0.0, "direction": [0.0, 0.0, 1.0]}},
         "analysis.base_motion.acceleration_m_s2: out of range; got 0.0"),
        ({**HARMONIC, "band_Hz": [2.0, 2.0]}, "analysis.band_Hz: no band; got [2.0, 2.0]"),
        ({**TRANSIENT, "method": "hht", "count": 5}, 'analysis.count: of method "hht"'),
        ({**TRANSIENT, "duration_s": 1e6}, "analysis.duration_s: too many frames; got 1e+09 "
         "frames; expected at most 10000"),
        ({**MODAL, "phases": 2, "duration_s": 1.0, "frame_rate_Hz": 9.0},
         "analysis.phases: beside duration_s; got 2; expected one of them"),
        ({**MODAL, "frame_rate_Hz": 9.0}, "analysis.frame_rate_Hz: of frames that are phases; got "
         "9.0; expected duration_s beside it"),
        ({**MODAL, "duration_s": 1.0}, "analysis.frame_rate_Hz: missing; got no frame_rate_Hz"),
        ({**MODAL, "duration_s": 2.0, "frame_rate_Hz": 6e3},
         "analysis.duration_s: too many frames; got 12001 frames"),
        ({**MODAL, "phases": 2000}, "analysis.phases: too many frames; got 20001 frames"),
        ({**TRANSIENT, "frame_rate_Hz": 10.0},
         "analysis.duration_s: over before a second frame; got 0.01; expected at least 0.1,"),
        ({**TRANSIENT, "base_motion": {"file": "no.csv", "direction": [1.0, 0.0, 0.0]}},
         "analysis.base_motion.file: "),
    ],
)  # fmt: skip
def test_keys_of_the_analysis(analysis: dict[str, Any], line: str) -> None:
    load = [] if analysis["type"] == "modal" else [PUSH]
    assert line in told(analysis=analysis, body=body(load=load))


def test_what_is_only_known_in_time() -> None:
    """Light flickers in frames that have a time, a camera is late for what moves between them."""
    lamp = {"name": "lamp", "type": "ambient", "radiance_W_m2_sr": 1.0}
    mains = [{**lamp, "flicker": {"mains_Hz": 50.0, "modulation": 0.3}}]
    late = [{**DOCUMENT["camera"][0], "trigger": {"delay_us": 10.0}}]
    modal = {"type": "modal", "count": 1, "phases": 2}
    still = {"body": [{**DOCUMENT["body"][0], "load": []}]}
    for analysis, keys, told in (
        (None, {"light": mains}, "light.lamp.flicker: frames aren't in time; got analysis.type"),
        (modal, {"light": mains, **still}, 'frames aren\'t in time; got analysis.type "modal"'),
        (None, {"camera": late}, "camera.side.trigger: nothing is known between frames"),
    ):
        with pytest.raises(SceneError, match=re.escape(told)):
            small_scene(**keys, **({} if analysis is None else {"analysis": analysis}))
    small_scene(camera=late, analysis=modal, **still)
    small_scene(light=mains, analysis={"type": "static", "frame_rate_Hz": 25.0})
    small_scene(light=mains, video={"frame_rate_Hz": 25.0})


@pytest.mark.parametrize(
    "flicker",
    [{}, {"mains_Hz": 50.0}, {"pwm_Hz": 50.0}, {"pwm_Hz": 50.0, "duty": 0.5, "modulation": 0.1},
     {"mains_Hz": 50.0, "modulation": 0.1, "pwm_Hz": 50.0, "duty": 0.5}],
)  # fmt: skip
def test_flicker_is_said_in_one_way(flicker: dict[str, float]) -> None:
    lamp = {"name": "lamp", "type": "ambient", "radiance_W_m2_sr": 1.0, "flicker": flicker}
    told = "how light varies is to be said in one way"
    with pytest.raises(SceneError, match=told):
        small_scene(light=[lamp], video={"frame_rate_Hz": 25.0})
