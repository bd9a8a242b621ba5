"""Lens, shutter and noise of a scene: its keys, its plan, its images, its report."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import SceneError
from gpusim.optics.sensor.emva1288 import CAMERAS
from gpusim.pipeline.scene_objects.cameras import (
    build_camera,
    build_lens,
    build_sensor,
    build_shutter,
    moving,
)
from gpusim.plan.plan import make_plan
from gpusim.scene.description.sensor import SensorTable

SCENE = """
schema = 1
name = "photo"
[analysis]
load_factors = [0.0, 1.0]
frame_rate_Hz = 200.0
[[prop]]
name = "board"
center_mm = [0.0, 0.0, 0.0]
normal = [0.0, -1.0, 0.0]
size_mm = [60.0, 40.0]
  [[prop.paint]]
  name = "fields"
  type = "checker"
  cell_mm = 6.0
  columns = 8
  rows = 5
  origin_mm = [-24.0, 0.0, -15.0]
  albedo = 0.8
[[camera]]
name = "front"
sensor_mm = [8.0, 6.0]
resolution_px = [92, 69]
focal_mm = 25.0
position_mm = [20.0, -220.0, 12.0]
target_mm = [0.0, 0.0, 0.0]
[sensor]
exposure = 0.9
"""
LENS = """
  [camera.lens]
  psf = { type = "gaussian", sigma_px = 0.9 }
  f_number = 2.0
  focus_distance_mm = 205.0
  vignetting = { cos4 = true, polynomial = [-0.05] }
  [camera.shutter]
  exposure_ms = 2.0
  line_time_us = 12.0
"""
FULL = SCENE.replace("[sensor]", LENS + "[sensor]\npreset = 'imx174'\nprnu_percent = 1.0\nseed = 5")


def load(text: str, folder: Path) -> gs.Scene:
    path = folder / "scene.toml"
    path.write_text(text, encoding="utf-8")
    return gs.load_scene(path)


def test_values_reach_the_optics(tmp_path: Path) -> None:
    scene = load(FULL, tmp_path)
    camera = scene.cameras[0]
    lens = build_lens(camera)
    assert lens is not None and lens.psf == gs.psf.Gaussian(0.9)
    # the focal length that puts the image of 205 mm at a distance of 25 mm
    assert lens.focal_length == pytest.approx(1 / (1 / 0.025 + 1 / 0.205))
    assert lens.aperture == pytest.approx(lens.focal_length / 2.0)
    assert build_shutter(camera) == gs.Shutter(2e-3, 12e-6)
    sensor = build_sensor(scene.sensor, camera, 0.7)
    assert (sensor.full_well, sensor.prnu, sensor.bits) == (32_691.0, 0.01, 8)
    assert sensor.exposure_time == 2e-3 and sensor.full_scale == 0.7
    again = gs.Scene.from_document(scene.document)
    assert again.cameras == scene.cameras and again.sensor == scene.sensor


def test_presets_of_scenes_are_those_of_the_sensor() -> None:
    (literal, _none) = get_args(SensorTable.model_fields["preset"].annotation)
    assert set(get_args(literal)) == set(CAMERAS)


def test_what_is_absent_from_the_scene_is_absent_from_the_work(tmp_path: Path) -> None:
    plain, full = load(SCENE, tmp_path), load(FULL, tmp_path)
    camera = plain.cameras[0]
    assert build_lens(camera) is None and build_shutter(camera) is None
    assert build_sensor(plain.sensor, camera, 1.0).signal() is None
    details = [make_plan(scene)["render/front/0000"].detail for scene in (plain, full)]
    assert "pinhole, no noise" in details[0]
    for words in ("gaussian point spread 0.9 px", "depth of field f/2", "vignetting", "2 ms",
                  "rolling shutter 12 us", "imx174"):  # fmt: skip
        assert words in details[1] and words not in details[0]
    assert make_plan(full).seconds > make_plan(plain).seconds


def test_images_and_report_of_a_run(tmp_path: Path) -> None:
    scene = load(FULL, tmp_path)
    gs.run(scene, tmp_path / "a")
    facts = json.loads((tmp_path / "a" / "report.json").read_text())["facts"]
    assert "lens positions" in facts["camera front: depth of field"]
    assert "imx174" in facts["camera front"]
    first, second = (
        cv2.imread(str(tmp_path / f"a/images/front/000{k}.png"), cv2.IMREAD_UNCHANGED).astype(float)
        for k in (0, 1)
    )
    # nothing moves between the frames: they differ by their noise alone, full well at 255
    noise = np.std(second - first) / 2**0.5
    mean = float(first.mean())
    assert noise**2 == pytest.approx(mean * 255 / 32_691 + (6.83 * 255 / 32_691) ** 2 + 1 / 12,
                                     rel=0.15)  # fmt: skip
    gs.run(scene, tmp_path / "b")
    same = cv2.imread(str(tmp_path / "b/images/front/0001.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(second, same)
    # against the same picture without lens and noise
    gs.run(load(SCENE, tmp_path), tmp_path / "c")
    sharp = cv2.imread(str(tmp_path / "c/images/front/0000.png"), cv2.IMREAD_UNCHANGED)

    def edge(image: Any) -> float:
        return float(np.abs(np.diff(image.astype(float), axis=1)).max())

    assert edge(first) < 0.7 * edge(sharp)


def test_motion_between_frames_is_that_of_the_neighbours(tmp_path: Path) -> None:
    scene = load(SCENE, tmp_path)
    surface = gs.Surface(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]]))
    before, after = (
        surface.moved(surface.points + np.array([shift, 0, 0])) for shift in (-0.1, 0.3)
    )
    at = moving([before], [surface], [after], 0.01)
    assert at is not None
    np.testing.assert_allclose(at(0.002)[0].points[:, 0] - surface.points[:, 0], 0.4 / 0.01 * 0.002)
    np.testing.assert_array_equal(at(0.0)[0].points, surface.points)
    assert moving([surface], [surface], [surface], 0.01) is None
    assert build_camera(scene.cameras[0]).width == 92


def test_a_moving_body_is_blurred_and_only_then(tmp_path: Path) -> None:
    """A strip that a support pulls sideways between the frames."""
    body = """
[[material]]
name = "steel"
type = "isotropic"
youngs_modulus_GPa = 200.0
poissons_ratio = 0.3
[[body]]
name = "strip"
material = "steel"
mesh = { builder = "box", size_mm = [30.0, 2.0, 20.0], divisions = [3, 1, 2] }
  [[body.support]]
  name = "pulled"
  where = { x_min_mm = -1000.0 }
  fix = ["x", "y", "z"]
  displacement_mm = [4.0, 0.0, 0.0]
  [[body.paint]]
  name = "white"
  type = "plain"
  albedo = 0.9
"""
    text = SCENE[: SCENE.index("[[prop]]")] + body + SCENE[SCENE.index("[[camera]]") :]
    shutter = "  [camera.shutter]\n  exposure_ms = 2.5\n"
    blurred = load(text.replace("[sensor]", shutter + "[sensor]"), tmp_path)
    gs.run(blurred, tmp_path / "blurred")
    gs.run(load(text, tmp_path), tmp_path / "sharp")
    row = {}
    for name in ("blurred", "sharp"):
        path = tmp_path / name / "images/front/0001.png"
        row[name] = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[34].astype(float) / 255
    facts = json.loads((tmp_path / "blurred/report.json").read_text())["facts"]
    travel = 4.0 * 0.5 * (25.0 / 220.0) * 92 / 8.0  # half of the way between the frames
    assert facts["camera front: motion"].startswith(f"{travel:.1f}"[:2])
    full = 0.9 * 0.9
    width = {k: np.count_nonzero((v > 0.03 * full) & (v < 0.97 * full)) for k, v in row.items()}
    assert width["blurred"] >= width["sharp"] + 2
    assert row["blurred"].sum() == pytest.approx(row["sharp"].sum(), abs=0.3)
    # the reference frame depends on the solution now, because it is blurred too
    keys = [make_plan(scene)["render/front/0000"].key for scene in (blurred, load(text, tmp_path))]
    assert keys[0] != keys[1]


@pytest.mark.parametrize(
    ("text", "key"),
    [
        (FULL.replace("frame_rate_Hz = 200.0", ""), "camera.0.shutter"),
        (FULL.replace("exposure_ms = 2.0", "exposure_ms = 20.0"), "camera.0.shutter.exposure_ms"),
        (FULL.replace("f_number = 2.0\n", "\n"), "camera.0.lens.f_number"),
        (FULL.replace("205.0", "20.5"), "camera.0.lens.focus_distance_mm"),
        (FULL.replace("sigma_px = 0.9", "sigma_px = -0.9"), "psf"),
        (FULL.replace("preset = 'imx174'", ""), "sensor.prnu_percent"),
        (FULL.replace("imx174", "imx175"), "sensor.preset"),
        (FULL.replace('psf = { type = "gaussian", sigma_px = 0.9 }',
                      'psf = { type = "measured", kernel = [[0.5, 0.5]] }'), "kernel"),
    ],
)  # fmt: skip
def test_faults_name_the_key(tmp_path: Path, text: str, key: str) -> None:
    with pytest.raises(SceneError) as caught:
        load(text, tmp_path)
    assert any(key in fault.key for fault in caught.value.faults), caught.value.faults
