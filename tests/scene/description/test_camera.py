"""Cameras of scenes: lens and pose in every way that a scene may say them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.optics.calibration.document import from_angles
from gpusim.pipeline.scene_objects.cameras import build_camera

HEAD = """schema = 1
name = "cameras"
[[prop]]
name = "wall"
center_mm = [0, 0, 0]
normal = [0, -1, 0]
size_mm = [300, 200]
paint = [{ type = "plain", name = "grey", albedo = 0.5 }]
[analysis]
load_factors = [0]
[[camera]]
name = "left"
resolution_px = [121, 87]
"""
POSE = "position_mm = [100, -900, 50]\ntarget_mm = [0, 0, 0]\n"
INNER = "fx_px = 152.5\nfy_px = 151.25\ncx_px = 58.5\ncy_px = 44.25\n"
BENT = "distortion = [-0.12, 0.05, 0.001, -0.0005]\n"


def scene(tmp_path: Path, text: str) -> gs.Scene:
    path = tmp_path / "scene.toml"
    path.write_text(HEAD + text)
    return gs.load_scene(path)


def test_a_photographers_lens_may_distort(tmp_path: Path) -> None:
    text = "sensor_mm = [12.1, 8.7]\nfocal_mm = 16\n" + POSE + BENT
    camera = build_camera(scene(tmp_path, text).cameras[0])
    want = gs.Camera.from_lens(
        (12.1, 8.7), 16, (121, 87), (0.1, -0.9, 0.05), (0, 0, 0), name="left",
        distortion=[-0.12, 0.05, 0.001, -0.0005],
    )  # fmt: skip
    X = np.random.default_rng(1).uniform(-0.1, 0.1, (20, 3))
    assert np.abs(camera.project(X) - want.project(X)).max() < 1e-9


@pytest.mark.parametrize("how", ["vector", "matrix"])
def test_intrinsics_and_a_rotation(tmp_path: Path, how: str) -> None:
    R = from_angles(80.0, 10.0, -5.0)
    rows = ", ".join(str([round(float(v), 9) for v in row]) for row in R)
    turn = f"rotation_matrix = [{rows}]\n"
    if how == "vector":
        turn = "rotation_vector = [1.3, -0.2, 0.1]\n"
    text = INNER + "skew_px = 0.75\n" + BENT + turn + "translation_mm = [5, -7, 900]\n"
    camera = build_camera(scene(tmp_path, text).cameras[0])
    np.testing.assert_allclose(camera.K, [[152.5, 0.75, 58.5], [0, 151.25, 44.25], [0, 0, 1]])
    np.testing.assert_allclose(camera.camera_from_world[:3, 3], [0.005, -0.007, 0.9])
    if how == "matrix":
        np.testing.assert_allclose(camera.camera_from_world[:3, :3], R, atol=1e-8)
    else:  # the axis of the turn stays
        axis = np.array([1.3, -0.2, 0.1])
        np.testing.assert_allclose(camera.camera_from_world[:3, :3] @ axis, axis)


def calibration(tmp_path: Path) -> list[gs.Camera]:
    cameras = []
    for index in range(2):
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = from_angles(90.0, 12.0 * index, 3.0), [0.04 * index, -0.003, 0.9]
        K = np.array([[152.5 + index, 0.5, 58.5], [0, 151.25, 44.25], [0, 0, 1]])
        cameras.append(gs.Camera(121, 87, K, [-0.12, 0.05, 0.001, -0.0005], T, f"cam{index}"))
    gs.write_calibration(tmp_path / "rig.yml", cameras, "opencv")
    return cameras


@pytest.mark.parametrize("which", ['"cam1"', "1"])
def test_a_rigs_calibration_file(tmp_path: Path, which: str) -> None:
    want = calibration(tmp_path)[1]
    text = f'calibration = "rig.yml"\ncalibration_camera = {which}\n'
    loaded = scene(tmp_path, text)
    assert any(path.endswith("rig.yml") for path, _ in loaded.files)
    camera = build_camera(loaded.cameras[0])
    X = np.random.default_rng(1).uniform(-0.1, 0.1, (20, 3))
    assert np.abs(camera.project(X) - want.project(X)).max() < 1e-9
    assert camera.name == "left"
    moved = build_camera(scene(tmp_path, text + POSE).cameras[0])
    np.testing.assert_allclose(moved.eye, [0.1, -0.9, 0.05], atol=1e-12)
    np.testing.assert_allclose(moved.K, camera.K)


def test_files_that_do_not_fit(tmp_path: Path) -> None:
    calibration(tmp_path)
    for more, part in (
        ('calibration_camera = "cam7"', "expected one of ['cam0', 'cam1']"),
        ("calibration_camera = 2", "expected 0 to 1"),
    ):
        loaded = scene(tmp_path, f'calibration = "rig.yml"\n{more}\n')
        with pytest.raises(InputError) as caught:
            build_camera(loaded.cameras[0])
        assert part in str(caught.value) and "left" in str(caught.value)
    with pytest.raises(SceneError, match="calibration"):
        scene(tmp_path, 'calibration = "none.yml"\n')


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (POSE, "one way"),
        (INNER + "focal_mm = 16\nsensor_mm = [12.1, 8.7]\n" + POSE, "one way"),
        ("focal_mm = 16\n" + POSE, "sensor_mm"),
        ("fx_px = 100\n" + POSE, "incomplete"),
        (INNER, "pose is missing"),
        (INNER + "position_mm = [0, -900, 0]\n", "incomplete"),
        (INNER + POSE + "translation_mm = [0, 0, 900]\n", "one way"),
        (INNER + "rotation_vector = [1, 0, 0]\n", "incomplete"),
        (INNER + POSE + "distortion = [0.1, 0.2]\n", "no model of OpenCV"),
        (INNER + POSE + "principal_point_offset_mm = [1, 0]\n", "focal_mm only"),
        ('calibration = "scene.toml"\n' + BENT + POSE, "calibration file"),
        (INNER + POSE + "[camera.lens]\nf_number = 4\nfocus_distance_mm = 900\n", "aperture"),
    ],
)
def test_cameras_said_wrongly(tmp_path: Path, text: str, part: str) -> None:
    with pytest.raises(SceneError) as caught:
        scene(tmp_path, text)
    assert part in str(caught.value)


def test_a_matrix_that_is_no_rotation(tmp_path: Path) -> None:
    text = (
        INNER
        + "rotation_matrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1.1]]\ntranslation_mm = [0, 0, 1]\n"
    )
    with pytest.raises(InputError, match="'left' rotation_matrix"):
        build_camera(scene(tmp_path, text).cameras[0])


def test_a_calibrated_scene_runs(tmp_path: Path) -> None:
    calibration(tmp_path)
    gs.run(scene(tmp_path, 'calibration = "rig.yml"\n'), tmp_path / "out", backend="numpy")
    assert (tmp_path / "out" / "images" / "left" / "0000.png").is_file()
