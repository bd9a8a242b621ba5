"""What lies beside the pictures that are to measure it is told before any work."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.checks.warnings import scene_warnings
from gpusim.pipeline.pictures.framing import share_in_picture
from gpusim.scene import Scene
from tests.support.speckled_plate import DOCUMENT, speckled_plate


def seen_by(*focal_mm: float) -> list[dict[str, Any]]:
    """The two cameras with these lenses."""
    cameras = copy.deepcopy(DOCUMENT["camera"])
    return [one | {"focal_mm": focal} for one, focal in zip(cameras, focal_mm, strict=True)]


def framed(scene: Scene) -> list[str]:
    return [text for text in scene_warnings(scene) if "in the picture" in text]


def test_boards_and_regions_within_the_pictures_are_not_told_of() -> None:
    assert framed(speckled_plate({"cameras": ["left", "right"]})) == []


def test_boards_that_are_cut_off_are_counted() -> None:
    """Of a pose that is moved out of the right picture, and of a lens that is too long for all."""
    calibration = copy.deepcopy(DOCUMENT["calibration"])
    calibration["pose"][1]["position_mm"] = [80.0, 0.0, 0.0]
    (left, right) = framed(speckled_plate(calibration=calibration))
    assert left.startswith("camera 'left': 6 of 7 poses of the board lie whole in the picture")
    assert right.startswith("camera 'right': 6 of 7 poses")
    (left,) = framed(speckled_plate(camera=seen_by(150.0, 35.0)))
    assert left.startswith("camera 'left': 0 of 7 poses") and "a shorter focal_mm" in left


def test_a_measure_without_boards_to_calibrate_by_is_an_error() -> None:
    far = {"cameras": ["left", "right"]}
    with pytest.raises(InputError, match="measure 'field0': camera 'right': 0 of 7 poses of the"):
        scene_warnings(speckled_plate(far, camera=seen_by(35.0, 150.0)))
    assert framed(speckled_plate(far | {"calibration": "true"}, camera=seen_by(35.0, 150.0)))


@pytest.mark.parametrize("roi", [None, {"paint": "speckle"}, {"where": {"normal": "+z"}}])
def test_a_region_beside_the_picture_is_told_with_its_share(roi: dict[str, Any] | None) -> None:
    """13.2 x 8.8 mm at f = 100, from 338 mm: some 45 x 29 mm of 120 x 60, without a hole of 20."""
    asked = {"cameras": ["left", "right"], "calibration": "true", **({"roi": roi} if roi else {})}
    region = [
        t for t in framed(speckled_plate(asked, camera=seen_by(100.0, 35.0))) if "region" in t
    ]
    (text,) = region
    share = float(text.split(":")[1].split("%")[0])
    assert "camera 'left'" in text and abs(share - 15.0) <= 2.0


def test_the_share_of_a_square_that_its_camera_sees_half_of() -> None:
    square = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)
    eye = (0.0, 0.5, 10.0)  # its image ends at x = 0.5
    camera = Camera.from_lens((1, 4), 10, (250, 1000), eye, (0.0, 0.5, 0.0), up=(0.0, 1.0, 0.0))
    closed = np.array([True, True])
    assert abs(share_in_picture(square, closed, camera) - 0.5) <= 0.01
    turned = square[:, ::-1]
    assert np.isnan(share_in_picture(turned, closed, camera))
    assert abs(share_in_picture(turned, ~closed, camera) - 0.5) <= 0.01
