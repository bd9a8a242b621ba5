"""Effects switched off one by one."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene.effects import (
    EFFECTS,
    active_effects,
    lenses_of_files,
    with_only,
    with_other_patterns,
    without_effects,
)
from tests.support.shifted_plate import shifted_plate
from tests.support.small_scene import DOCUMENT, small_scene

CHANGES: dict[str, Any] = {
    "camera.0.distortion": [-0.1, 0.02, 0.0, 0.0],
    "camera.0.lens": {
        "psf": {"type": "gaussian", "sigma_px": 0.7}, "f_number": 8.0,
        "focus_distance_mm": 900.0, "vignetting": {"cos4": True},
    },
    "camera.0.shutter": {"exposure_ms": 2.0},
    "analysis.frame_rate_Hz": 50.0,
    "sensor.full_well_e": 32000.0,
    "sensor.read_noise_e": 12.0,
    "sensor.bayer": "RGGB",
    "sensor.bayer_response": [0.6, 1.0, 0.8],
    "sensor.demosaic": "malvar",
    "sensor.gamma": "srgb",
    "sensor.drift_percent": 1.0,
    "camera.0.channels": "rgb",
    "camera.0.white_balance_K": 2856.0,
    "light.0.temperature_K": 2856.0,
    "light.0.flicker": {"mains_Hz": 50.0, "modulation": 0.3},
}  # fmt: skip


def full(checkout: Path) -> gs.Scene:
    return gs.load_scene(checkout / "examples" / "cantilever.toml", CHANGES)


def test_every_effect_can_go_and_the_rest_stays(checkout: Path) -> None:
    document = full(checkout).document
    effects = [name for name in EFFECTS if name != "trigger"]  # which is of motions in time
    assert active_effects(document) == tuple(effects)
    before = copy.deepcopy(document)
    for name in effects:
        left = without_effects(document, [name])
        # without a shutter nothing averages what flickers
        gone = {"light": {"shadows", "flicker"}, "motion": {"flicker"}}.get(name, set()) | {name}
        assert active_effects(left) == tuple(one for one in effects if one not in gone)
        assert without_effects(left, [name]) == left
        gs.Scene.from_document(left)  # still a scene
        assert left["body"] == document["body"] and left["measure"] == document["measure"]
    assert document == before
    nothing = with_only(document, [])
    assert active_effects(nothing) == () and nothing["sensor"]["bits"] == 16


def test_only_some_effects(checkout: Path) -> None:
    scene = full(checkout)
    only = scene.with_effects(only=["noise", "distortion"])
    assert active_effects(only.document) == ("noise", "distortion")
    values = scene.sensor.values
    assert only.sensor.values == {key: values[key] for key in ("full_well", "read_noise")}
    shaded = scene.with_effects(only=["shadows"])  # shadows need the light that they keep away
    assert active_effects(shaded.document) == ("shadows", "light")
    bands = scene.with_effects(only=["flicker"])  # which lamps have, and an exposure averages
    assert active_effects(bands.document) == ("motion", "flicker", "light")
    assert scene.with_effects() is scene
    with pytest.raises(InputError, match="did you mean distortion"):
        scene.with_effects(no=["distorsion"])


def test_one_effect_may_be_given_by_its_name(checkout: Path) -> None:
    scene = gs.load_scene(checkout / "examples" / "rigid_shift.toml")
    assert scene.with_effects(no="noise") == scene.with_effects(no=["noise"])
    assert scene.with_effects(only="noise") == scene.with_effects(only=["noise"])


def test_other_drawings_of_random_patterns(checkout: Path) -> None:
    scene = shifted_plate((1.0, 0.0, 0.0), {"camera": "left"})
    other = with_other_patterns(scene.document, 2)
    assert other["prop"][0]["paint"][0]["seed"] == 2
    assert gs.Scene.from_document(other).replace("prop.plate.paint.0.seed", 0).document == (
        scene.document
    )
    marked = full(checkout).document  # nothing random is painted on it
    assert with_other_patterns(marked, 1) == marked


def test_a_raw_mosaic_is_no_effect_but_what_was_asked_for(checkout: Path) -> None:
    raw = {"sensor.bayer": "RGGB", "camera.0.white_balance": [2.0, 1.0, 1.5]}
    scene = gs.load_scene(checkout / "examples" / "cantilever.toml", raw)
    assert "mosaic" not in active_effects(scene.document)
    assert gs.Scene.from_document(with_only(scene.document, [])).sensor.bayer == "RGGB"


def test_a_lens_that_a_calibration_file_undoes_stays(checkout: Path, tmp_path: Path) -> None:
    lens = [-0.2, 0.05, 0.0, 0.0, 0.0]
    pair = {"cameras": ["left", "right"], "calibration": "true"}
    third = {"name": "third", "resolution_px": [20, 20], "pixel_um": 40.0, "focal_mm": 12.0,
             "position_mm": [0.0, 0.0, 200.0], "target_mm": [0.0, 0.0, 0.0]}  # fmt: skip
    changes = {f"camera.{name}.distortion": lens for name in ("left", "right")}
    scene = shifted_plate((1.0, 0.0, 0.0), pair, **changes)
    assert active_effects(scene.document) == ("distortion",)
    assert lenses_of_files(scene.document) == {}
    cameras = [build_camera(one) for one in scene.cameras]
    gs.write_calibration(tmp_path / "rig.yml", cameras, "opencv", unit="mm")
    read = scene.replace("measure.field.calibration", str(tmp_path / "rig.yml"))
    assert lenses_of_files(read.document) == {"left": "field", "right": "field"}
    assert active_effects(read.document) == ()
    assert with_only(read.document, []) == read.document
    expected = "measure.field.calibration=true"
    with pytest.raises(InputError, match=rf"--no distortion.*'left'.*'field'.*{expected}"):
        read.with_effects(no=["noise", "distortion"])
    assert scene.with_effects(no=["distortion"]).cameras[0].distortion == ()
    # a camera that no file tells of loses its lens, and so does one without any from a file
    more = read.document
    more["camera"].append({**third, "distortion": lens})
    more["camera"][1]["distortion"] = []
    assert lenses_of_files(more) == {"left": "field"}
    left = without_effects(more, ["distortion"])["camera"]
    assert [one["distortion"] for one in left] == [lens, [], []]


def test_a_trigger_is_an_effect() -> None:
    """Of a camera alone: its shutter stays."""
    camera = {
        **DOCUMENT["camera"][0],
        "shutter": {"exposure_ms": 1.0},
        "trigger": {"delay_us": 9.0},
    }
    analysis = {"type": "transient", "duration_s": 0.01, "frame_rate_Hz": 500.0}
    document = small_scene(camera=[camera], analysis=analysis).document
    assert set(active_effects(document)) == {"motion", "trigger", "quantisation"}
    (left,) = without_effects(document, ["trigger"])["camera"]
    assert "trigger" not in left and left["shutter"]["exposure_ms"] == 1.0
    (left,) = with_only(document, ["trigger"])["camera"]
    assert "shutter" not in left and left["trigger"]["delay_us"] == 9.0
