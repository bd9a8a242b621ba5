"""Cameras of scenes as a calibration has them, and back."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export.calibrated_cameras import calibrated_cameras, cameras_in_file, scene_cameras

LENSES = ([-0.1, 0.02, 1e-3, -2e-3, 0.0], [0.01] * 8, [0.01] * 12, None)
CAMERAS = [
    gs.Camera.from_lens((36, 24), 50, (570, 330), (0.4 * k, -1.0, 0.1), (0.0, 0.0, 0.0),
                        name=f"c{k}", distortion=lens)
    for k, lens in enumerate(LENSES)
]  # fmt: skip


def test_both_kinds_project_as_opencv_does() -> None:
    X = np.random.default_rng(1).uniform(-0.1, 0.1, (20, 3))  # m
    first = CAMERAS[0].to_camera(X)
    found = calibrated_cameras(CAMERAS)
    for camera, own, back in zip(CAMERAS, found, scene_cameras(found), strict=True):
        pose = own.camera_from_rig
        turn = cv2.Rodrigues(pose[:3, :3])[0]
        seen = cv2.projectPoints(1000.0 * first, turn, pose[:3, 3], own.K, own.distortion)[0]
        assert np.abs(seen.reshape(-1, 2) - camera.project(X)).max() < 1e-8
        assert np.abs(back.project(first) - camera.project(X)).max() < 1e-8
        assert (own.name, own.resolution) == (back.name, (570, 330)) and own.name == camera.name


def test_cameras_of_a_file_are_known_by_names_or_by_their_order(tmp_path: Path) -> None:
    path = tmp_path / "rig.yml"
    gs.write_calibration(path, CAMERAS[:3], "opencv", unit="mm")
    size = (570, 330)

    def names(*asked: str, sizes: int = 2) -> list[str]:
        return [one.name for one in cameras_in_file("rig", path, [size] * sizes, names=asked)]

    assert names() == names("c0", "other") == ["c0", "c1"]
    assert names("c2", "c0") == ["c2", "c0"]
    with pytest.raises(InputError, match=r"got cameras .*c0.*; expected .*other.*, or none"):
        names("other", "c0")  # of which c0 would be taken for the other one
    (second, _) = cameras_in_file("rig", path, [size] * 2, names=("c1", "c2"))
    assert np.abs(second.camera_from_rig - np.eye(4)).max() < 1e-12
    with pytest.raises(InputError, match="rig; got 3 cameras; expected 4"):
        names(sizes=4)
    gs.write_calibration(path, [CAMERAS[0], replace(CAMERAS[1], width=569)], "opencv")
    with pytest.raises(InputError, match="camera 'c1' with 569x330 px; expected 570x330"):
        names()
