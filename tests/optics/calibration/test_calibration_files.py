"""A rig's calibration files: read back by us, and projected as programs document it."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError

Array = npt.NDArray[np.float64]
LENS = [-0.12, 0.08, 9e-4, -7e-4, 0.03]
SIZE = (1282, 941)


def rig(lens: list[float], count: int = 2, skew: float = 0.0) -> list[gs.Camera]:
    """Cameras about the scene's origin, each of its own."""
    rng = np.random.default_rng(3)
    cameras = []
    for number, name in enumerate(("left", "right", "above", "below")[:count]):
        eye = np.array([-0.3 + 0.25 * number, 0.04 * number, 0.9]) + rng.uniform(-0.02, 0.02, 3)
        K = np.array([[2211.0 + number, skew, 611.5], [0, 2209.0, 455.25 - number], [0, 0, 1]])
        pose = gs.Camera.from_lens((1, 1), 1, SIZE, eye, (0.01, 0, 0), up=(0.05, 1, 0.1))
        cameras.append(gs.Camera(*SIZE, K, lens, pose.camera_from_world, name))
    return cameras


def points() -> Array:
    """Of the scene, m."""
    return np.random.default_rng(4).uniform(-0.11, 0.11, (400, 3))


def bent(X: Array, k: dict[str, float]) -> Array:
    """Brown's lens, as OpenCV's documents have it: (X / Z, Y / Z) moved by k1 k2 k3 p1 p2."""
    x, y = X[:, 0] / X[:, 2], X[:, 1] / X[:, 2]
    r2 = x * x + y * y
    radial = 1 + k["k1"] * r2 + k["k2"] * r2**2 + k.get("k3", 0.0) * r2**3
    p1, p2 = k.get("p1", 0.0), k.get("p2", 0.0)
    return np.stack([
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    ], axis=1)  # fmt: skip


def pixels(flat: Array, fx: float, fy: float, fs: float, cx: float, cy: float) -> Array:
    return np.stack([fx * flat[:, 0] + fs * flat[:, 1] + cx, fy * flat[:, 1] + cy], axis=1)


def turn(a: float, b: float, c: float) -> Array:
    """Rz(c) Ry(b) Rx(a), degrees, by Rodrigues' vectors."""
    axes = np.eye(3) * np.radians([a, b, c])
    x, y, z = (np.asarray(cv2.Rodrigues(axis)[0], np.float64) for axis in axes)
    return z @ y @ x


def by_matchid(path: Path, first: gs.Camera) -> list[Array]:
    """Cam0 at the origin; mm, degrees."""
    rows = [line.split(";") for line in path.read_text().splitlines()]
    v = {re.sub(r"\[.*\]|\s", "", name): float(value) for name, value in rows}
    X = 1e3 * first.to_camera(points())
    found = []
    for n in (0, 1):
        if n:
            X = X @ turn(v["Theta"], v["Phi"], v["Psi"]).T + [v["Tx"], v["Ty"], v["Tz"]]
        names = {"k1": "Kappa1", "k2": "Kappa2", "k3": "Kappa3", "p1": "P1", "p2": "P2"}
        flat = bent(X, {key: v[f"Cam{n}_{name}"] for key, name in names.items()})
        found.append(pixels(flat, *(v[f"Cam{n}_{key}"] for key in ("Fx", "Fy", "Fs", "Cx", "Cy"))))
    return found


def by_vic(path: Path, first: gs.Camera) -> list[Array]:
    found = []
    for camera in ET.parse(path).getroot().iter("camera"):
        cx, cy, fx, fy, fs, k1, k2, k3 = map(float, (camera.text or "").split())
        a, b, c, *shift = map(float, (camera.findtext("orientation") or "").split())
        X = 1e3 * points() @ turn(a, b, c).T + shift
        found.append(pixels(bent(X, {"k1": k1, "k2": k2, "k3": k3}), fx, fy, fs, cx, cy))
    return found


def by_dice(path: Path, first: gs.Camera) -> list[Array]:
    """OpenCV's lens; x = fx X + fs Y + cx."""
    found = []
    root = ET.parse(path).getroot()
    for block in root.findall("ParameterList"):
        v = {p.get("name"): p.get("value", "") for p in block.findall("Parameter")}
        rows = [p.get("value", "").strip("{} ").split(",") for p in block.findall("*/Parameter")]
        X = 1e3 * points() @ np.array(rows, float).T + [float(v[k]) for k in ("TX", "TY", "TZ")]
        lens = {k.lower(): float(v[k]) for k in ("K1", "K2", "K3", "P1", "P2")}
        found.append(pixels(bent(X, lens), *(float(v[k]) for k in ("FX", "FY", "FS", "CX", "CY"))))
    return found


def by_kalibr(path: Path, first: gs.Camera) -> list[Array]:
    """pinhole + radtan, T_cn_cnm1 takes the camera before to this one; m."""
    found: list[Array] = []
    X = first.to_camera(points())
    for block in re.split(r"^cam\d+:$", path.read_text(), flags=re.MULTILINE)[1:]:
        step = [json.loads(row) for row in re.findall(r"^  - (\[.*\])$", block, re.MULTILINE)]
        if found:
            X = X @ np.array(step)[:3, :3].T + np.array(step)[:3, 3]
        v: dict[str, Any] = {k: json.loads(text) for k, text in
                             re.findall(r"^  (\w+): (\[.*\])$", block, re.MULTILINE)}  # fmt: skip
        flat = bent(X, dict(zip(("k1", "k2", "p1", "p2"), v["distortion_coeffs"], strict=True)))
        fu, fv, pu, pv = v["intrinsics"]
        found.append(pixels(flat, fu, fv, 0.0, pu, pv))
        assert v["resolution"] == list(SIZE)
    return found


def by_opencv(path: Path, first: gs.Camera) -> list[Array]:
    """A pair as OpenCV's stereo sample has it, by OpenCV."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    M1, D1, M2, D2, R, T = (file.getNode(k).mat() for k in ("M1", "D1", "M2", "D2", "R", "T"))
    X = 1e3 * first.to_camera(points())
    one = cv2.projectPoints(X, np.zeros(3), np.zeros(3), M1, D1)[0].reshape(-1, 2)
    return [one, cv2.projectPoints(X, cv2.Rodrigues(R)[0], T, M2, D2)[0].reshape(-1, 2)]


PROGRAMS = {
    "opencv": ("opencv-left+right.yml", by_opencv),
    "matchid": ("matchid-left+right.caldat", by_matchid),
    "vic": ("vic.xml", by_vic),
    "dice": ("dice.xml", by_dice),
    "kalibr": ("kalibr.yaml", by_kalibr),
}


@pytest.mark.parametrize("format", PROGRAMS)
@pytest.mark.parametrize("skew", [0.0, 1.5])
@pytest.mark.parametrize("lens", [[*LENS[:2], 0.0, 0.0], LENS], ids=["radial", "brown"])
def test_programs_project_as_the_camera_does(
    tmp_path: Path, format: str, lens: list[float], skew: float
) -> None:
    cameras = rig(lens, skew=skew)
    said = gs.write_calibration_files(tmp_path, cameras, [format])
    name, project = PROGRAMS[format]
    first = gs.fit_lens(cameras[0], format).camera  # the frame of a file without that of the scene
    for camera, found in zip(cameras, project(tmp_path / name, first), strict=True):
        off = np.linalg.norm(found - camera.project(points()), axis=1)
        # points reach a little beyond the grid's places; what is exact is so to rounding
        assert off.max() <= (1.02 * said[name] if said[name] else 1e-7)
    known = {"kalibr": skew or lens[-1], "vic": lens[2], "opencv": skew}
    assert (said[name] > 0) == bool(known.get(format, 0.0))


@pytest.mark.parametrize("format", PROGRAMS)
def test_files_are_read_back(tmp_path: Path, format: str) -> None:
    cameras = rig(LENS, 3)
    said = gs.write_calibration_files(tmp_path, cameras, [format])
    for name, most in said.items():
        read = gs.read_calibration(tmp_path / name, SIZE)
        parts = re.sub(r"^\w+-|\.\w+$", "", name).split("+")
        whole = format not in ("opencv", "matchid")
        own = cameras if whole else [one for one in cameras if one.name in parts]
        # the first camera's frame is that of Kalibr's and MatchID's files, as it was refitted
        frame = gs.fit_lens(own[0], format).camera
        first = frame.to_camera(points()) if format in ("kalibr", "matchid") else points()
        for camera, again in zip(own, read, strict=True):
            off = np.linalg.norm(again.project(first) - camera.project(points()), axis=1)
            assert off.max() <= max(1.02 * most, 1e-7)


def test_names_and_comments(tmp_path: Path) -> None:
    cameras = rig(LENS, 3)
    said = gs.write_calibration_files(tmp_path, cameras)
    pairs = ("left", "right", "above", "left+right", "left+above", "right+above")
    assert sorted(said) == sorted([
        *(f"opencv-{name}.yml" for name in pairs), *(f"matchid-{name}.caldat" for name in pairs),
        "vic.xml", "dice.xml", "kalibr.yaml",
    ])  # fmt: skip
    assert sorted(said) == sorted(path.name for path in tmp_path.iterdir())
    text = (tmp_path / "vic.xml").read_text()
    assert f"camera 2: above; {gs.fit_lens(cameras[2], 'vic').words}" in text
    assert "# camera 1: right; kalibr has no k3" in (tmp_path / "kalibr.yaml").read_text()
    assert "camera 0: left -->" in (tmp_path / "dice.xml").read_text()


def test_opencv_reads_a_single_camera(tmp_path: Path) -> None:
    """With the keys of its calibration sample; here the pose in the scene beside them."""
    camera = rig([*LENS, 0.02, 0.01, 0.0, 1e-3, 0.0, 2e-4, 0.0, 0.01, -0.02])[0]
    assert gs.write_calibration_files(tmp_path, [camera], ["opencv"]) == {"opencv-left.yml": 0.0}
    file = cv2.FileStorage(str(tmp_path / "opencv-left.yml"), cv2.FILE_STORAGE_READ)
    K, d, R, T = (file.getNode(key).mat() for key in
                  ("camera_matrix", "distortion_coefficients", "R", "T"))  # fmt: skip
    seen = cv2.projectPoints(1e3 * points(), cv2.Rodrigues(R)[0], T, K, d)[0].reshape(-1, 2)
    assert np.abs(seen - camera.project(points())).max() < 1e-7
    assert [int(file.getNode(f"image_{k}").real()) for k in ("width", "height")] == list(SIZE)


def test_names_that_end_a_comment(tmp_path: Path) -> None:
    camera = rig(LENS, 1)[0]
    odd = gs.Camera(*SIZE, camera.K, LENS, camera.camera_from_world, "a--b-")
    gs.write_calibration_files(tmp_path, [odd], ["vic", "dice"])
    assert len(gs.read_calibration(tmp_path / "vic.xml")) == 1
    assert [one.name for one in gs.read_calibration(tmp_path / "dice.xml")] == ["a--b-"]


def test_refusals_leave_nothing(tmp_path: Path) -> None:
    camera = rig(LENS, 1)[0]
    rigs = [gs.Camera(*SIZE, camera.K, None, np.eye(4), f"c{k}") for k in range(11)]
    with pytest.raises(InputError, match=r"dice.xml: cameras; got 11; expected 1 to 10 for dice"):
        gs.write_calibration_files(tmp_path, rigs, ["vic", "dice"])
    with pytest.raises(InputError, match="format; got 'gom'; expected one of opencv, kalibr"):
        gs.write_calibration_files(tmp_path, [camera], ["gom"])
    with pytest.raises(InputError, match=r"cameras; got 'left'; expected a Camera .of a scene"):
        gs.write_calibration_files(tmp_path, {"left": camera})
    with pytest.raises(InputError, match=r"cameras; got Camera\(.*; expected a list of Camera"):
        gs.write_calibration(tmp_path / "a.yml", camera, "opencv")
    for names in (("cam 1", "cam_1"), ("camera", "camera")):
        pair = [replace(camera, name=name) for name in names]
        for format in ("opencv", "vic"):
            with pytest.raises(InputError, match=f"cameras; got names .*{names[0]}.*different"):
                gs.write_calibration_files(tmp_path, pair, [format])
    assert not list(tmp_path.iterdir())


def test_names_of_cameras_don_t_lead_out_of_the_folder(tmp_path: Path) -> None:
    camera = replace(rig([0.0] * 5)[0], name="x/../../evil\n")
    folder = tmp_path / "in" / "rig"
    names = gs.write_calibration_files(folder, [camera], ["opencv", "kalibr"])
    written = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert sorted(path.name for path in written) == sorted(names)
    assert {path.parent for path in written} == {folder}
    assert len(gs.read_calibration(folder / "kalibr.yaml", (camera.width, camera.height))) == 1
