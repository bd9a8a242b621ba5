"""Effects switched off one by one, and what the budget makes of them."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.pipeline.runner.error_budget import run_budget
from gpusim.scene.effects import (
    EFFECTS,
    active_effects,
    with_only,
    with_other_patterns,
    without_effects,
)
from tests.support.shifted_plate import shifted_plate

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
    "camera.0.channels": "rgb",
    "camera.0.white_balance_K": 2856.0,
    "light.0.temperature_K": 2856.0,
}  # fmt: skip


def full(checkout: Path) -> gs.Scene:
    return gs.load_scene(checkout / "examples" / "cantilever.toml", CHANGES)


def test_every_effect_can_go_and_the_rest_stays(checkout: Path) -> None:
    document = full(checkout).document
    assert active_effects(document) == tuple(EFFECTS)
    before = copy.deepcopy(document)
    for name in EFFECTS:
        left = without_effects(document, [name])
        gone = {"shadows", name} if name == "light" else {name}
        assert active_effects(left) == tuple(one for one in EFFECTS if one not in gone)
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
    assert scene.with_effects() is scene
    with pytest.raises(InputError, match="did you mean distortion"):
        scene.with_effects(no=["distorsion"])


def test_other_drawings_of_random_patterns(checkout: Path) -> None:
    scene = shifted_plate((1.0, 0.0, 0.0), {"camera": "left"})
    other = with_other_patterns(scene.document, 2)
    assert other["prop"][0]["paint"][0]["seed"] == 2
    assert gs.Scene.from_document(other).replace("prop.plate.paint.0.seed", 0).document == (
        scene.document
    )
    marked = full(checkout).document  # nothing random is painted on it
    assert with_other_patterns(marked, 1) == marked


def test_the_budget_of_noise(checkout: Path, tmp_path: Path) -> None:
    changes = {"light": [], "sensor.bits": 16, "sensor.full_well_e": 800.0, "output.truth": []}
    scene = gs.load_scene(checkout / "examples" / "cantilever.toml", changes)
    report = run_budget(scene, tmp_path)
    budget = report.budget
    assert budget is not None and budget.sources == ("noise",)
    names = [name for name, _ in budget.quantities]
    assert names[0] == report.measurements[0].name and any("RMS" in name for name in names)
    rms = next(k for k, name in enumerate(names) if "RMS" in name)
    # one effect: alone and among all it is the same, and noise of 28 electrons outweighs the rest
    assert budget.row("only", "noise").errors == pytest.approx(budget.row("all").errors, rel=1e-9)
    assert budget.row("no", "noise").errors == pytest.approx(budget.row("none").errors, rel=1e-9)
    assert budget.row("all").errors[rms] > 3.0 * budget.row("none").errors[rms]
    assert '"budget": {' in (tmp_path / "report.json").read_text(encoding="utf-8")


def test_a_raw_mosaic_is_no_effect_but_what_was_asked_for(checkout: Path) -> None:
    raw = {"sensor.bayer": "RGGB", "camera.0.white_balance": [2.0, 1.0, 1.5]}
    scene = gs.load_scene(checkout / "examples" / "cantilever.toml", raw)
    assert "mosaic" not in active_effects(scene.document)
    assert gs.Scene.from_document(with_only(scene.document, [])).sensor.bayer == "RGGB"


def test_a_budget_needs_measures_and_effects(checkout: Path, tmp_path: Path) -> None:
    path = checkout / "examples" / "cantilever.toml"
    bare = gs.load_scene(path, {"light": [], "sensor.bits": 16})
    with pytest.raises(InputError, match="none of the effects"):
        run_budget(bare, tmp_path / "out")
    unmeasured = gs.load_scene(path, {"measure": []})
    with pytest.raises(InputError, match="0 measures"):
        run_budget(unmeasured, tmp_path / "out")
    assert not (tmp_path / "out").exists()
