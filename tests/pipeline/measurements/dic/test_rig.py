"""Pairs of cameras from calibration files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.pipeline.measurements.dic.rig import calibrated_rig, rig_of
from gpusim.pipeline.measurements.sources import Sources
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene
from gpusim.scene.part import SceneParts
from tests.support.shifted_plate import shifted_plate

PAIR: dict[str, Any] = {"cameras": ["left", "right"], "calibration": "true"}
NO_SOURCES: Any = Sources(lambda *_: None, lambda *_: None)  # type: ignore[arg-type, return-value]


@pytest.fixture
def cameras() -> tuple[gs.Camera, gs.Camera]:
    left, right = (build_camera(one) for one in shifted_plate((1.0, 0.0, 0.0), PAIR).cameras)
    return left, replace(right, distortion=np.array([-0.1, 0.02, 1e-3, 0.0, 0.0]))


def given(path: Path) -> Scene:
    return shifted_plate((1.0, 0.0, 0.0), {**PAIR, "calibration": str(path)})


@pytest.mark.parametrize("turned", [False, True])
def test_a_file_is_read_by_names_or_in_its_order(
    tmp_path: Path, cameras: tuple[gs.Camera, gs.Camera], turned: bool
) -> None:
    path = tmp_path / "rig.yml"
    named = cameras[::-1] if turned else [
        replace(one, name=f"c{k}") for k, one in enumerate(cameras)
    ]  # fmt: skip
    gs.write_calibration(path, named, "opencv", unit="mm")
    scene = given(path)
    (spec,) = scene.measures
    assert not spec.uses_calibration
    rig, rms = calibrated_rig(spec, scene, NO_SOURCES, cameras)  # type: ignore[arg-type]
    assert np.isnan(rms)
    for one, camera, true in zip(rig, cameras, rig_of(cameras), strict=True):
        assert pytest.approx(camera.K) == one.K
        assert one.camera_from_rig == pytest.approx(true.camera_from_rig, abs=1e-9)
    assert rig[1].distortion[:3] == pytest.approx([-0.1, 0.02, 1e-3])
    # centres: 45 mm apart
    apart = np.linalg.inv(rig[1].camera_from_rig)[:3, 3]
    assert np.linalg.norm(apart) == pytest.approx(45.0)


def test_another_file_is_another_measurement(
    tmp_path: Path, cameras: tuple[gs.Camera, gs.Camera]
) -> None:
    digests = []
    for k in (0, 1):
        path = tmp_path / f"rig{k}.yml"
        gs.write_calibration(
            path,
            [replace(one, K=one.K + k * np.eye(3)[:, :1] * np.eye(3)[2]) for one in cameras],
            "opencv",
        )
        digests.append(SceneParts(given(path)).of("measure.field").digests["measure.field"])
    assert digests[0] != digests[1]


def test_files_that_dont_fit(tmp_path: Path, cameras: tuple[gs.Camera, gs.Camera]) -> None:
    path = tmp_path / "rig.yml"
    gs.write_calibration(path, cameras[:1], "opencv")
    scene = given(path)
    with pytest.raises(InputError, match="got 1 cameras; expected 2"):
        gs.run(scene, tmp_path / "out", backend="numpy")
    assert not (tmp_path / "out" / "images").exists()  # told before any picture
    gs.write_calibration(path, [replace(one, width=100) for one in cameras], "opencv")
    with pytest.raises(InputError, match="got camera 'left' with 100x165 px; expected 2"):
        gs.run(given(path), tmp_path / "out", backend="numpy")
    with pytest.raises(SceneError, match="calibration"):
        given(tmp_path / "none.yml")
    with pytest.raises(SceneError, match="calibration: of a pair, but one camera is given"):
        shifted_plate((1.0, 0.0, 0.0), {"camera": "left", "calibration": "true"})
    with pytest.raises(SceneError, match="or calibration, a file"):
        shifted_plate((1.0, 0.0, 0.0), {"cameras": ["left", "right"]})
