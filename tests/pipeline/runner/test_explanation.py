"""`gpusim explain`: parts of a field's error against closed forms, and against other runs."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import gpusim as gs
from gpusim.cli import app
from gpusim.errors import InputError
from gpusim.pipeline.measurements.dic import FullFieldResult
from gpusim.pipeline.scene_objects.cameras import build_camera
from tests.support.report_figures import figures_drawn
from tests.support.shifted_plate import shifted_plate
from tests.support.small_scene import small_scene
from tests.support.speckled_plate import speckled_plate


@pytest.fixture(scope="module")
def nearer(tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    """A plate that comes 1 mm nearer to a camera 200 mm away, and goes 3 mm to the side."""
    out = tmp_path_factory.mktemp("explain") / "out"
    measure = {"camera": "left", "mm_per_px": 8.8 / 220 * 200.0 / 12.0 * 1.01}
    sensor = {"bits": 8, "exposure": "auto", "full_well_e": 4000.0, "read_noise_e": 10.0}
    psf = {"psf": {"type": "gaussian", "sigma_px": 0.7}}
    changes = {"camera.left.distortion": [-0.2, 0.05, 0.0, 0.0], "camera.left.lens": psf}
    scene = shifted_plate((3.0, 0.0, 1.0), measure, sensor=sensor, **changes)
    with figures_drawn():
        return gs.explain(scene, out), out


def maps(out: Path) -> dict[str, np.ndarray]:
    with (out / "explain" / "field.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {
        key: np.array([float(row[key] or "nan") for row in rows])
        for key in rows[0]
        if key != "point"
    }


def test_parts_add_up_to_the_error(nearer: tuple[gs.Report, Path]) -> None:
    report, out = nearer
    (told,) = report.explanations
    assert [*told.parts] == [
        "scale and perspective", "out-of-plane motion", "distortion",
        "noise", "quantisation", "psf", "settings", "speckle", "matching", "missing",
        "measured less true",
    ]  # fmt: skip
    assert told.units == {"displacements": "mm", "strains": "microstrain"}
    for kind in told.units:
        missing, error = (told.parts[one][kind] for one in ("missing", "measured less true"))
        assert missing.rms_percent == pytest.approx(100.0 * missing.rms / error.rms)
        assert missing.rms_percent < 10.0 and error.rms_percent == error.share_percent == 100.0
        shares = [one[kind].share_percent for one in told.parts.values()]
        assert sum(shares) == pytest.approx(200.0, abs=1e-9)
    noise, steps = (told.parts[one]["strains"].rms for one in ("noise", "quantisation"))
    assert noise > 3.0 * steps > 0.0
    columns = maps(out)
    for name in ("u_mm", "exx"):
        parts = sum(columns[f"{part.replace(' ', '-')}_{name}"] for part in [*told.parts][:-2])
        miss = np.nanstd(columns[f"error_{name}"] - parts) / np.nanstd(columns[f"error_{name}"])
        assert miss < 0.1, name
    measured = FullFieldResult.read(out / "measure", "field")
    found = (measured.values("measured", ["exx"]) - measured.values("true", ["exx"]))[-1, :, 0]
    known = np.isfinite(columns["error_exx"])
    assert columns["error_exx"][known] == pytest.approx(found[known], abs=1e-9)
    assert known.sum() > 150


def test_parts_of_the_projection_in_closed_form(nearer: tuple[gs.Report, Path]) -> None:
    columns = maps(nearer[1])
    x = (columns["x_px"] - 109.5) * 8.8 / 220 / 12.0  # with the lens' distortion
    undistorted = np.abs(x) < 0.1
    # nearer by 1 of 200 mm: all looks 1 / 199 larger, about the optical axis, 3 mm further by then
    expected = 1.01 * (200.0 * x + 3.0) / 199.0
    got = columns["out-of-plane-motion_u_mm"]
    near = undistorted & np.isfinite(got)
    assert near.sum() > 50
    assert got[near] == pytest.approx(expected[near], abs=0.01)
    strain = columns["out-of-plane-motion_exx"][near]
    # Green-Lagrange, at the scale that is 1 % too large
    stretch = 1.01 * (1.0 + 1.0 / 199.0)
    assert strain == pytest.approx(0.5 * (stretch**2 - 1.01**2), rel=2e-2)
    # it comes nearer, and w goes away from the camera
    truth = FullFieldResult.read(nearer[1] / "measure", "field").table["true_w_mm"]
    assert truth == pytest.approx(np.full_like(truth, -1.0), abs=1e-12)
    scale = columns["scale-and-perspective_u_mm"]
    assert scale[near] == pytest.approx(0.03, abs=1e-6)


def test_the_report_and_the_command_say_it(nearer: tuple[gs.Report, Path]) -> None:
    report, out = nearer
    (told,) = report.explanations
    assert told.remarks[0].startswith("The largest part of the error of displacements is ")
    # by 3 mm to the side and 1 mm to the camera
    shape = "A rigid motion of 3.16 mm reads as a stretch or tilt, by out-of-plane motion: up to 0."
    assert any(text.startswith(shape) for text in told.remarks)
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "Why field differs from the truth" in page and "parts of the error of strains" in page
    stored = json.loads((out / "report.json").read_text(encoding="utf-8"))["explanations"]
    noise = stored[0]["parts"]["noise"]["strains"]
    assert noise == pytest.approx(vars(told.parts["noise"]["strains"]))
    assert "figures" not in stored[0]


def test_a_wrong_principal_point_is_found(tmp_path: Path) -> None:
    true = {"cameras": ["left", "right"], "calibration": "true"}
    lens = [-0.2, 0.05, 0.0, 0.0, 0.0]
    changes = {"camera.left.distortion": lens, "camera.right.distortion": lens}
    scene = shifted_plate((5.0, 0.0, 0.0), true, **changes)
    left, right = (build_camera(one) for one in scene.cameras)
    K = right.K.copy()
    K[0, 2] += 3.0
    wrong = gs.Camera(right.width, right.height, K, right.distortion, right.camera_from_world,
                      "right")  # fmt: skip
    # by their names, in another order
    gs.write_calibration(tmp_path / "rig.yml", [wrong, left], "opencv", unit="mm")
    file = str(tmp_path / "rig.yml")
    report = gs.explain(scene.replace("measure.field.calibration", file), tmp_path / "wrong")
    (told,) = report.explanations
    assert told.parts["calibration"]["displacements"].share_percent > 95.0
    assert any(
        "A rigid motion of 5 mm reads as a parabola in U" in text and "by calibration" in text
        for text in told.remarks
    )
    (cause,) = (text for text in told.remarks if text.startswith("What calibration does"))
    assert "principal point of camera right, off by (+3, +0) px (+100 %)" in cause
    assert cause.count("%") == 1
    # the same measured with the true cameras: the difference is what calibration is said to do
    found, exact = (
        FullFieldResult.read(tmp_path / out / "measure", "field")
        for out in ("wrong", "wrong/explain/none")
    )
    names = [*found.displacements, *found.strains]
    difference = (found.values("measured", names) - exact.values("measured", names))[-1]
    known = found.geometric_errors["calibration"]
    both = np.isfinite(difference).all(axis=1) & np.isfinite(known).all(axis=1)
    assert both.sum() > 100
    spread = np.abs(known[both]).max(axis=0)
    assert (np.abs(difference - known)[both] < 0.1 * spread + ([1e-3] * 3 + [5e-5] * 3)).all()
    assert [*exact.geometric_errors] == ["calibration"] and exact.causes == {}
    assert np.nanmax(np.abs(exact.geometric_errors["calibration"])) < 1e-9


def test_what_cant_be_explained(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='0 measures of type "dic"; expected'):
        gs.explain(small_scene(), tmp_path / "out")
    chosen = speckled_plate({"camera": "left", "settings": "best", "subset_px": 31, "step_px": 10})
    with pytest.raises(InputError, match='got settings = "best"; expected the subset'):
        gs.explain(chosen, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_scene_file_needs_a_folder(tmp_path: Path) -> None:
    path = tmp_path / "plate.toml"
    path.write_text(shifted_plate((1.0, 0.0, 0.0), {"camera": "left"}).to_toml(), encoding="utf-8")
    got = CliRunner().invoke(app, ["explain", str(path)])
    assert got.exit_code == 2 and "expected -o OUT" in got.output
