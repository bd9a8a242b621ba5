"""Results without the lens's distortion, and in millimetres on a plane."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import (
    DicResult,
    Status,
    lens_mapping,
    mapped,
    plane_mapping,
    rig_camera,
    strain,
)

K = np.array([[820.0, 0.0, 401.3], [0.0, 815.0, 296.8], [0.0, 0.0, 1.0]])
LENS = np.array([-0.21, 0.08, 0.0011, -0.0007, 0.02])
CAMERA = rig_camera((800, 600), K, LENS)
POSE = np.eye(4)
POSE[:3, :3] = cv2.Rodrigues(np.array([0.31, -0.24, 0.1]))[0]
POSE[:3, 3] = [-20.0, 35.0, 640.0]
GRADIENT = np.array([[0.012, -0.02], [0.015, 0.006]])


def seen(plane: np.ndarray) -> np.ndarray:
    """Pixels (N, 2) of points (N, 2) mm on the plane."""
    points = np.column_stack([plane, np.zeros(len(plane))])
    turn = cv2.Rodrigues(POSE[:3, :3])[0]
    return cv2.projectPoints(points, turn, POSE[:3, 3], K, LENS)[0].reshape(-1, 2)


def measured() -> tuple[DicResult, np.ndarray]:
    """Pixels of a plane that is stretched, and where its points are in mm."""
    x, y = np.meshgrid(np.linspace(-180, 200, 15), np.linspace(-150, 130, 12))
    before = np.column_stack([x.ravel(), y.ravel()])
    after = before @ (np.eye(2) + GRADIENT).T + [1.7, -0.9]
    points = seen(before)
    h = 0.01
    slopes = [
        np.stack(
            [(seen(at + np.array(d)) - seen(at - np.array(d))) / (2 * h) for d in ((h, 0), (0, h))],
            axis=2,
        )
        for at in (before, after)
    ]
    F = slopes[1] @ (np.eye(2) + GRADIENT) @ np.linalg.inv(slopes[0])
    count = len(points)
    status = np.zeros(count, dtype=np.int8)
    status[7] = Status.LOW_CORRELATION
    displacement, gradient = seen(after) - points, F - np.eye(2)
    displacement[7], gradient[7] = np.nan, np.nan
    ones = np.ones(count)
    result = DicResult(
        points, displacement, gradient, 0.99 * ones, 0.01 * ones, ones.astype(np.int32), status, 31
    )
    return result, before


def test_a_stretched_plane_is_measured_in_millimetres_through_a_bent_lens() -> None:
    result, before = measured()
    found = mapped(result, plane_mapping(CAMERA, POSE))
    good = found.ok
    assert good.sum() == len(good) - 1 and found.status[7] == Status.LOW_CORRELATION
    assert np.abs(found.points - before).max() <= 1e-8
    truth = before @ GRADIENT.T + [1.7, -0.9]
    assert np.abs(found.displacement[good] - truth[good]).max() <= 1e-8
    assert np.abs(found.gradient[good] - GRADIENT).max() <= 1e-5
    assert np.isnan(found.displacement[7]).all() and np.isnan(found.sigma[7])
    assert 0.6 <= found.subset / (31 * 640 / 817) <= 1.6
    assert np.all((found.sigma[good] > 0.004) & (found.sigma[good] < 0.02))
    # the raw pixels show strains that aren't there
    raw = np.abs(result.gradient[good] - GRADIENT).max()
    assert raw >= 5e-3
    local = strain(found, window=3, kind="small", spacing=28.0)
    want = 0.5 * (GRADIENT + GRADIENT.T)
    assert np.abs(local.tensor[local.ok] - want).max() <= 1e-9


def test_pixels_of_an_ideal_lens() -> None:
    result, before = measured()
    found = mapped(result, lens_mapping(CAMERA))
    points = np.column_stack([before, np.zeros(len(before))]) @ POSE[:3, :3].T + POSE[:3, 3]
    ideal = points @ K.T
    assert np.abs(found.points - ideal[:, :2] / ideal[:, 2:]).max() <= 1e-8
    assert 25 <= found.subset <= 45


def test_what_lies_beyond_the_horizon_is_outside() -> None:
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.array([1.35, 0.0, 0.0]))[0]
    pose[:3, 3] = [0.0, 50.0, 300.0]
    points = np.array([[400.0, 590.0], [400.0, 10.0]])
    zero, ones = np.zeros((2, 2)), np.ones(2)
    result = DicResult(
        points, zero, np.zeros((2, 2, 2)), ones, ones, ones.astype(np.int32),
        np.zeros(2, dtype=np.int8), 21,
    )  # fmt: skip
    found = mapped(result, plane_mapping(rig_camera((800, 600), K), pose))
    assert sorted(found.status.tolist()) == [Status.OK, Status.OUTSIDE]
    assert np.isnan(found.displacement[~found.ok]).all()


def test_what_is_no_mapping_is_refused() -> None:
    with pytest.raises(InputError, match="result, mapping; got int, int; expected what dic"):
        mapped(3, 4)  # type: ignore[arg-type]
    result, _ = measured()
    with pytest.raises(InputError, match="mapping"):
        mapped(result, lambda pixels: pixels[:, 0])
    with pytest.raises(InputError, match="camera_from_plane"):
        plane_mapping(CAMERA, np.eye(3))
    edge_on = np.eye(4)
    edge_on[:3, :3] = cv2.Rodrigues(np.array([np.pi / 2, 0.0, 0.0]))[0]
    edge_on[:3, 3] = [0.0, 0.0, 100.0]
    with pytest.raises(InputError, match="along"):
        plane_mapping(CAMERA, edge_on)
