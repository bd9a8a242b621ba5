"""`gpusim budget`: what each effect adds to the measured errors."""

from __future__ import annotations

from pathlib import Path

import pytest

import gpusim as gs
from gpusim.cli.tables import print_budget
from gpusim.errors import InputError
from gpusim.pipeline.runner.effect_states import EffectStates, documents_of_states
from gpusim.pipeline.runner.error_budget import FOLDER, run_budget
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene.description.video import filming
from gpusim.scene.effects import active_effects
from tests.support.shifted_plate import shifted_plate
from tests.support.speckled_plate import speckled_plate


def test_the_budget_of_noise(checkout: Path, tmp_path: Path) -> None:
    changes = {"light": [], "sensor.bits": 16, "sensor.full_well_e": 800.0, "output.truth": []}
    changes |= {"video": {"frame_rate_Hz": 25.0}}
    scene = gs.load_scene(checkout / "examples" / "cantilever.toml", changes)
    report = run_budget(scene, tmp_path)
    assert [film.parent for film in tmp_path.rglob("*.mkv")] == [tmp_path / "video"]
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


def test_a_shutter_of_video_is_an_effect_of_its_own(checkout: Path) -> None:
    """States film nothing, and their frames follow each other as fast."""
    changes = {"video": {"frame_rate_Hz": 25.0, "exposure_us": 9e3, "format": "png"}, "light": []}
    scene = gs.load_scene(checkout / "examples" / "cantilever.toml", changes)
    effects = active_effects(scene.document)
    assert effects == ("quantisation", "motion")
    scenes = EffectStates(FOLDER, effects, documents_of_states(scene.document, effects)).scenes(
        scene
    )
    shutters = {
        name: [camera.shutter and camera.shutter.exposure for camera in one.cameras]
        for name, one in scenes.items()
    }
    blurred, sharp = [9e-3] * len(scene.cameras), [None] * len(scene.cameras)
    assert shutters == {
        "": blurred, "budget/none": sharp, "budget/only-quantisation": sharp,
        "budget/only-motion": blurred, "budget/no-quantisation": blurred, "budget/no-motion": sharp,
    }  # fmt: skip
    assert {one.analysis.frame_rate for one in scenes.values()} == {25.0}
    films = [filming(one.video, one.cameras) for one in scenes.values()]
    assert films[0] and not any(films[1:])


def test_a_budget_needs_measures_and_effects(checkout: Path, tmp_path: Path) -> None:
    path = checkout / "examples" / "cantilever.toml"
    bare = gs.load_scene(path, {"light": [], "sensor.bits": 16})
    with pytest.raises(InputError, match="none of the effects"):
        run_budget(bare, tmp_path / "out")
    unmeasured = gs.load_scene(path, {"measure": []})
    with pytest.raises(InputError, match="0 measures"):
        run_budget(unmeasured, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_settings_that_every_state_would_choose_anew(tmp_path: Path) -> None:
    scene = speckled_plate({"camera": "left", "settings": "best", "subset_px": 31, "step_px": 10})
    with pytest.raises(InputError, match=r'budget: .*got settings = "best"; expected the subset'):
        run_budget(scene, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_lens_that_a_calibration_file_undoes_is_in_every_state(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pair = {"cameras": ["left", "right"], "calibration": "true", "strain": "none"}
    lens = [-0.2, 0.05, 0.0, 0.0, 0.0]
    changes = {f"camera.{name}.distortion": lens for name in ("left", "right")}
    sensor = {"bits": 16, "exposure": "auto", "full_well_e": 1000.0, "read_noise_e": 20.0}
    scene = shifted_plate((3.0, 0.0, 0.0), pair, sensor=sensor, **changes)
    file = tmp_path / "rig.yml"
    cameras = [build_camera(one) for one in scene.cameras]
    gs.write_calibration(file, cameras, "opencv", unit="mm")
    report = run_budget(scene.replace("measure.field.calibration", str(file)), tmp_path / "out")
    budget = report.budget
    assert budget is not None and budget.sources == ("noise",)
    rms = next(k for k, (name, _) in enumerate(budget.quantities) if "RMS" in name)
    # without noise the perfect calibration measures better, not by a lens that isn't there worse
    assert budget.row("none").errors[rms] < 0.3 * budget.row("all").errors[rms]
    told = [f"Distortion of camera {name!r} stays in every state" for name in ("left", "right")]
    assert [text.partition(":")[0] for text in budget.remarks] == told
    print_budget(report, tmp_path)
    assert told[0] in capsys.readouterr().out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert told[1].replace("'", "&#39;") in page
