"""Calibration files: round trips through every format, files as other programs write them."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.optics.calibration.document import angles_of, from_angles
from tests.support.optics_rigs import rig


def pair(coefficients: list[float], skew: float = 0.0) -> list[gs.Camera]:
    """Two cameras in general position."""
    cameras = []
    for name, seed in (("left", 1), ("right", 2)):
        rng = np.random.default_rng(seed)
        T = np.eye(4)
        T[:3, :3] = from_angles(*rng.uniform(-25, 25, 3))
        T[:3, 3] = rng.uniform([-90, -90, 710], [90, 90, 890])
        K = np.array([[2211.25 + seed, skew, 611.5], [0, 2209.125, 455.25 - seed], [0, 0, 1]])
        cameras.append(gs.Camera(1282, 941, K, coefficients, T, name))
    return cameras


CASES = [
    ("opencv", "a.yml", [0.1, -0.05, 4e-4, 6e-4, 0.02, 0.04, -0.05, 0.01, 1e-3, -2e-3, 7e-4, 5e-4,
                         0.03, -0.02], 1.7),
    ("opencv", "a.xml", [-0.12, 0.05, 1e-3, -5e-4], 0.0),
    ("opencv", "a.json", [-0.12, 0.05, 1e-3, -5e-4, 0.01], 0.0),
    ("kalibr", "camchain.yaml", [-0.12, 0.05, 1e-3, -5e-4], 0.0),
    ("matchid", "a.caldat", [-0.12, 0.05, 1e-3, -5e-4, 0.02], 2.25),
    ("vic", "project.xml", [-0.12, 0.05, 0.0, 0.0, 0.02], -0.66),
    ("dice", "cal.xml", [-0.12, 0.05, 1e-3, -5e-4, 0.02, 0.01, 0.0, 0.0, 1e-3, 0.0, 0.0, 2e-4, 0.01,
                         0.02], 0.5),
]  # fmt: skip


@pytest.mark.parametrize(("format", "name", "coefficients", "skew"), CASES)
def test_round_trips(
    tmp_path: Path, format: str, name: str, coefficients: list[float], skew: float
) -> None:
    cameras = pair(coefficients, skew)
    path = tmp_path / name
    gs.write_calibration(path, cameras, format)
    if format == "matchid":  # which has no place for it
        with pytest.raises(InputError, match=r"the image size; got none.*size=\(columns, rows\)"):
            gs.read_calibration(path)
    got = gs.read_calibration(path, (1282, 941) if format == "matchid" else None)
    # Kalibr and MatchID know the second camera from the first only
    base = np.linalg.inv(cameras[0].camera_from_world)
    moved = base if format in ("kalibr", "matchid") else np.eye(4)
    assert len(got) == 2
    X = np.random.default_rng(4).uniform(-80, 80, (50, 3))
    for before, after in zip(cameras, got, strict=True):
        assert (after.width, after.height) == (1282, 941)
        seen = X if moved is not base else X @ cameras[0].camera_from_world[:3, :3].T + (
            cameras[0].camera_from_world[:3, 3])  # fmt: skip
        assert np.abs(before.project(X) - after.project(seen)).max() < 1e-8


def test_angles_are_those_of_the_rotation() -> None:
    for angles in ((10.0, -20.0, 30.0), (-170.0, 60.0, 100.0), (25.0, 90.0, 0.0)):
        R = from_angles(*angles)
        np.testing.assert_allclose(from_angles(*angles_of(R)), R, atol=1e-12)
    np.testing.assert_allclose(from_angles(90.0, 0.0, 0.0) @ [0, 1, 0], [0, 0, 1], atol=1e-15)


def test_a_stereo_pair_as_the_samples_of_opencv_write_it(tmp_path: Path) -> None:
    path = tmp_path / "stereo.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    K = np.array([[1200.0, 0, 640], [0, 1201, 480], [0, 0, 1]])
    d = np.array([[-0.1, 0.02, 1e-3, -1e-3, 0.0]])
    R = cv2.Rodrigues(np.array([0.02, -0.3, 0.01]))[0]
    T = np.array([[-120.0], [1.0], [9.0]])
    for key, value in (
        ("M1", K),
        ("D1", d),
        ("M2", np.diag([1.001, 1.001, 1]) @ K),
        ("D2", 2 * d),
        ("R", R),
        ("T", T),
    ):
        storage.write(key, value)
    storage.release()
    with pytest.raises(InputError, match=r"image size; got none .*size=\(columns, rows\)"):
        gs.read_calibration(path)
    first, second = gs.read_calibration(path, (1281, 961))
    X = np.random.default_rng(1).uniform(-1, 1, (20, 3)) * 200 + [0, 0, 1500.0]  # mm
    for camera, turn, shift, matrix, bent in (
        (first, np.eye(3), np.zeros(3), K, d), (second, R, T, np.diag([1.001, 1.001, 1]) @ K, 2 * d)
    ):  # fmt: skip
        want = cv2.projectPoints(X, cv2.Rodrigues(turn)[0], shift, matrix, bent)[0].reshape(-1, 2)
        assert np.abs(camera.project(X / 1000.0) - want).max() < 1e-8


@pytest.mark.parametrize(
    ("key", "entry"),
    [
        ("M1", lambda read: read[0].K[0, 0]),
        ("D2", lambda read: read[1].distortion[0]),
        ("T", lambda read: read[1].camera_from_world[0, 3]),
        ("camera_matrix", lambda read: read[0].K[0, 0]),
        ("distortion_coefficients", lambda read: read[0].distortion[0]),
    ],
)
def test_a_file_of_opencv_changed_in_one_of_two_places(
    tmp_path: Path, key: str, entry: Callable[[list[gs.Camera]], float]
) -> None:
    """Such a file tells each camera in a list, and in keys of OpenCV's samples beside it."""
    path, cameras = tmp_path / "rig.yml", pair([0.1, -0.05, 4e-4, 6e-4, 0.02])
    gs.write_calibration(path, cameras if len(key) < 3 else cameras[:1], "opencv", unit="mm")
    text = path.read_text()

    def without_list() -> float:
        path.write_text(path.read_text().partition("\ncameras:")[0] + "\n")
        return entry(gs.read_calibration(path, (1282, 941)))

    larger = re.compile(rf"(^{key}:.*?data: \[\s*)([^,\s]+)", re.MULTILINE | re.DOTALL)
    path.write_text(larger.sub(lambda m: f"{m[1]}{1.25 * float(m[2])!r}", text, count=1))
    with pytest.raises(InputError, match=r"cameras\[[01]\]: .* change both, or delete these keys"):
        gs.read_calibration(path)
    changed = without_list()
    path.write_text(text)
    assert changed == pytest.approx(1.25 * without_list())


def test_a_file_of_matchid(tmp_path: Path) -> None:
    """As published with stereo data sets; X_1 = Rz(psi) Ry(phi) Rx(theta) X_0 + T."""
    path = tmp_path / "calibration.caldat"
    lines = []
    for camera, fx in ((0, 6651.97), (1, 6607.28)):
        lines += [f"Cam{camera}_Fx [pixels];{fx}", f"Cam{camera}_Fy [pixels];6648.81",
                  f"Cam{camera}_Fs [pixels];0", f"Cam{camera}_Kappa 1;0.041",
                  f"Cam{camera}_Cx [pixels];902.85", f"Cam{camera}_Cy [pixels];586.14"]  # fmt: skip
    lines += ["Tx [mm];174.15", "Ty [mm];0.65", "Tz [mm];27.26", "Theta [deg];0.069",
              "Phi [deg];-18.97", "Psi [deg];0.263"]  # fmt: skip
    path.write_text("\n".join(lines))
    left, right = gs.read_calibration(path, (1920, 1200))
    np.testing.assert_allclose(left.camera_from_world, np.eye(4))
    np.testing.assert_allclose(right.camera_from_world[:3, 3], [0.17415, 0.00065, 0.02726])
    # a turn by phi about y moves what is ahead to -sin(18.97 deg) in x
    assert right.camera_from_world[0, 2] == pytest.approx(np.sin(np.radians(-18.97)), abs=1e-4)
    path.write_text("\n".join(lines).replace("Theta [deg]", "Theta [rad]"))
    with pytest.raises(InputError, match=r"line 16, Theta \[rad\]; got unit \[rad\]"):
        gs.read_calibration(path, (1920, 1200))


def test_a_camchain_of_kalibr(tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    text = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.7e-05]
  distortion_model: radtan
  intrinsics: [458.6, 457.3, 367.2, 248.4]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99999, 0.0023, 0.0004, -0.1100]
  - [-0.0023, 0.9999, 0.0141, 0.0004]
  - [-0.0003, -0.0141, 0.9999, -0.0008]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, -0.0001, -3.5e-05]
  distortion_model: radtan
  intrinsics: [457.5, 456.1, 379.9, 255.2]
  resolution: [752, 480]
"""
    path.write_text(text)
    cameras = gs.read_calibration(path)
    assert [c.name for c in cameras] == ["cam0", "cam1"]
    np.testing.assert_allclose(cameras[1].camera_from_world[:3, 3], [-0.11, 0.0004, -0.0008])
    path.write_text(text.replace("radtan", "equidistant"))
    with pytest.raises(InputError, match=r"cam0.distortion_model; got 'equidistant'; .*radtan"):
        gs.read_calibration(path)
    path.write_text(text.replace("[752, 480]", "[752]"))
    with pytest.raises(InputError, match=r"cam0.resolution; got 1 numbers; expected 2"):
        gs.read_calibration(path)


def test_vic_in_one_line_and_with_an_orientation(tmp_path: Path) -> None:
    path = tmp_path / "project.xml"
    inner, outer = "640.5 480.25 2200 2201 -0.5 0.1 -0.02 0.003", "1.5 -20 0.25 -150 2 30"
    texts = (f'<camera id="1">{inner} {outer}</camera>',
             f'<camera id="1">{inner}<orientation>{outer}</orientation></camera>')  # fmt: skip
    for text in texts:
        path.write_text(f"<project>{text}</project>")
        (camera,) = gs.read_calibration(path, (1281, 961))
        np.testing.assert_allclose(camera.K[0], [2200, -0.5, 640.5])
        np.testing.assert_allclose(camera.distortion, [0.1, -0.02, 0, 0, 0.003])
        np.testing.assert_allclose(camera.camera_from_world[:3, :3], from_angles(1.5, -20, 0.25))
    path.write_text(f'<project><camera id="1">{inner}</camera></project>')
    with pytest.raises(InputError, match="camera 1; got 8 numbers; expected 14: cx cy fx"):
        gs.read_calibration(path, (1281, 961))


def test_what_dice_says_that_has_no_like_here(tmp_path: Path) -> None:
    path = tmp_path / "cal.xml"
    gs.write_calibration(path, pair([0.1, 0.0, 0.0, 0.0]), "dice")
    assert [c.name for c in gs.read_calibration(path)] == ["left", "right"]
    path.write_text(path.read_text().replace("OPENCV_LENS", "VIC3D_LENS"))
    with pytest.raises(InputError, match="CAMERA 0 LENS_DISTORTION_MODEL; got VIC3D"):
        gs.read_calibration(path)


@pytest.mark.parametrize("format", ["kalibr", "matchid", "vic"])
def test_lenses_that_a_format_cannot_hold_are_refused(tmp_path: Path, format: str) -> None:
    camera, _ = rig("rational", 1)
    with pytest.raises(InputError, match=r"'rational'; got .*k6; .* all that this format"):
        gs.write_calibration(tmp_path / "a.txt", [camera], format)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "text", "part"),
    [
        ("a.yml", "%YAML:1.0\n---\nother: 3\n", "camera_matrix"),
        ("a.txt", "nothing", "expected one of"),
        ("a.xml", "<ParameterList><Parameter></ParameterList>", "well-formed"),
        ("a.caldat", "Cam0_Fx [pixels];wide", "line 1, Cam0_Fx"),
    ],
)
def test_files_that_are_none(tmp_path: Path, name: str, text: str, part: str) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=part) as caught:
        gs.read_calibration(path, (100, 80))
    assert name in str(caught.value)


def test_missing_files_and_unknown_formats(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected a readable text"):
        gs.read_calibration(tmp_path / "none.yml")
    with pytest.raises(InputError, match="format; got 'other'"):
        gs.write_calibration(tmp_path / "a", pair([0.0] * 4), "other")
