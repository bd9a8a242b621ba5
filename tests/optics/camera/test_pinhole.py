"""The camera model against OpenCV, geometry and rendered discs."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device


def random_camera(seed: int, skew: float = 0.0) -> gs.Camera:
    """Off-centre, in general position, 5616 px wide."""
    rng = np.random.default_rng(seed)
    rotation, _ = cv2.Rodrigues(rng.normal(size=3) * 0.2)
    T = np.eye(4)
    T[:3, :3] = np.linalg.qr(rotation.astype(np.float64))[0]
    T[:3, :3] *= np.sign(np.diag(T[:3, :3] @ rotation.T))[:, None]
    T[:3, 3] = rng.normal(size=3) * 0.3 + [0.0, 0.0, 4.0]
    K = np.array(
        [[4700.0 + seed, skew, 2731.4 - 60 * seed], [0.0, 4688.0, 1904.7], [0.0, 0.0, 1.0]]
    )
    return gs.Camera(5616, 3744, K, None, T)


@pytest.mark.parametrize("seed", range(3))
def test_projection_equals_opencv(seed: int) -> None:
    camera = random_camera(seed)
    X = np.random.default_rng(9).uniform(-1.0, 1.0, (10_000, 3))
    rotation, _ = cv2.Rodrigues(camera.camera_from_world[:3, :3])
    want, _ = cv2.projectPoints(X, rotation, camera.camera_from_world[:3, 3], camera.K, None)
    assert np.abs(camera.project(X) - want.reshape(-1, 2)).max() < 1e-8


def test_projection_with_skew_equals_the_matrix_product() -> None:
    camera = random_camera(1, skew=3.7)
    X = np.random.default_rng(9).uniform(-1.0, 1.0, (50, 3))
    homogeneous = (camera.K @ (camera.camera_from_world @ np.c_[X, np.ones(50)].T)[:3]).T
    want = homogeneous[:, :2] / homogeneous[:, 2:]
    assert np.abs(camera.project(X) - want).max() < 1e-9


def test_ray_matrix_inverts_the_projection() -> None:
    camera = random_camera(2, skew=1.3)
    pixels = np.array([[0.0, 0.0], [5615.0, 0.0], [17.3, 3700.1], [2808.0, 1872.0]])
    rays = np.c_[pixels, np.ones(4)] @ camera.ray_matrix().T
    np.testing.assert_allclose(rays[:, 2], 1.0, atol=1e-12)
    X = camera.eye + 3.3 * rays @ camera.camera_from_world[:3, :3]
    assert np.abs(camera.project(X) - pixels).max() < 1e-8


def test_a_lens_in_a_photographers_words() -> None:
    """Full frame, 30 mm, 1 m away: 156 px a millimetre on the sensor, 0.2137 mm a pixel."""
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (5616, 3744), eye=(0.3, -1.0, 0.28), target=(0.3, 0.0, 0.28)
    )
    np.testing.assert_allclose(
        camera.K, [[4680.0, 0, 2807.5], [0, 4680.0, 1871.5], [0, 0, 1]], rtol=1e-14
    )
    np.testing.assert_allclose(camera.eye, [0.3, -1.0, 0.28], atol=1e-15)
    centre, right, up = camera.project(
        np.array([[0.3, 0.0, 0.28], [0.4, 0.0, 0.28], [0.3, 0.0, 0.38]])
    )
    np.testing.assert_allclose(centre, [2807.5, 1871.5], atol=1e-9)
    np.testing.assert_allclose(right - centre, [468.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(up - centre, [0.0, -468.0], atol=1e-9)
    shifted = gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (5616, 3744), (0.3, -1.0, 0.28), (0.3, 0.0, 0.28),
        principal_point_offset_mm=(2.0, -1.0),
    )  # fmt: skip
    np.testing.assert_allclose(shifted.K[:2, 2], [2807.5 + 312.0, 1871.5 - 156.0], rtol=1e-14)


def test_points_behind_or_at_the_camera_are_nan() -> None:
    camera = random_camera(0)
    at = camera.eye - camera.camera_from_world[2, :3]
    got = camera.project(np.stack([at, camera.eye, at + 5.0 * camera.camera_from_world[2, :3]]))
    assert np.isnan(got[:2]).all() and np.isfinite(got[2]).all()


@pytest.mark.parametrize(("width", "height"), [(171, 102), (172, 99)])
def test_pixel_centres(device: Device, width: int, height: int) -> None:
    """A disc that faces the camera has its centroid where its centre projects.

    Off the lattice's symmetry, the centroid of exact pixel areas itself is off by a share of
    radius^-1.5 (5e-4 px here).
    """
    camera = gs.Camera.from_lens((36.0, 24.0), 30.0, (width, height), (0, -1.0, 0), (0, 0, 0))
    for s, t, limit in ((0.0, 0.0, 1e-5), (0.0371, -0.0127, 1e-3)):
        points = np.array([[-0.3, 0, -0.2], [0.3, 0, -0.2], [0.3, 0, 0.2], [-0.3, 0, 0.2]])
        paint = gs.paint.Dots(0.2, 0.2, 1, 1, (0.3 + s, 0.2 + t), albedo=1.0, ground=0.0)
        surface = gs.Surface(points, np.array([[0, 1, 2, 3]]), paint=paint)
        for backend in ("gpu", "numpy"):
            image = gs.render([surface], camera, device=device, backend=backend).radiance
            y, x = np.mgrid[:height, :width]
            centroid = np.array([(x * image).sum(), (y * image).sum()]) / image.sum()
            want = camera.project(np.array([s, 0.0, t]))
            print(f"{width}x{height} {backend}: off by {centroid - want}")
            assert np.abs(centroid - want).max() < limit
            scale = camera.K[:2, :2].diagonal() * 0.1
            assert image.sum() == pytest.approx(np.pi * scale.prod(), rel=1e-5)


def test_a_camera_turned_by_the_up_vector() -> None:
    camera = gs.Camera.from_lens((36, 24), 30, (90, 60), (0, -1, 0), (0, 0, 0), up=(1, 0, 0))
    np.testing.assert_allclose(camera.project(np.array([0.1, 0, 0])), [44.5, 22.0], atol=1e-12)


K = np.array([[100.0, 0, 20], [0, 100, 15], [0, 0, 1]])


def changed(matrix: np.ndarray, row: int, column: int, value: float) -> np.ndarray:
    result = matrix.copy()
    result[row, column] = value
    return result


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ({"width": 0}, ("width", "0", "1 to 65535")),
        ({"height": 12.5}, ("height", "12.5", "1 to 65535")),
        ({"width": float("nan")}, ("width", "nan", "1 to 65535")),
        ({"width": "40"}, ("width", "40", "1 to 65535")),
        ({"K": "eye"}, ("K", "eye", "numbers")),
        ({"K": K[:2]}, ("K", "(2, 3)", "(3, 3)")),
        ({"K": changed(K, 0, 0, np.nan)}, ("K", "finite")),
        ({"K": changed(K, 0, 0, -100.0)}, ("K", "-100", "fx, fy above 0")),
        ({"K": changed(K, 1, 0, 2.0)}, ("K", "skew")),
        ({"K": changed(K, 2, 2, 2.0)}, ("K", "[0, 0, 1]")),
        ({"distortion": [0.1, 0, 0]}, ("distortion", "0.1", "4, 5, 8, 12 or 14")),
        ({"distortion": 0.1}, ("distortion", "0.1", "4, 5, 8, 12 or 14")),
        ({"distortion": [np.nan, 0, 0, 0]}, ("distortion", "nan", "finite")),
        ({"camera_from_world": np.eye(3)}, ("camera_from_world", "(3, 3)", "(4, 4)")),
        ({"camera_from_world": 2 * np.eye(4)}, ("camera_from_world", "rotation")),
        ({"camera_from_world": np.diag([1.0, 1, -1, 1])}, ("camera_from_world", "rotation")),
        ({"camera_from_world": changed(np.eye(4), 3, 0, 1e-3)}, ("camera_from_world", "rotation")),
        ({"camera_from_world": changed(np.eye(4), 0, 3, np.inf)}, ("camera_from_world", "finite")),
    ],
)
def test_cameras_that_cannot_be(arguments: dict[str, Any], parts: tuple[str, ...]) -> None:
    values: dict[str, Any] = {"width": 40, "height": 30, "K": K, "name": "left", **arguments}
    with pytest.raises(InputError) as caught:
        gs.Camera(**values)
    for part in ("left", *parts):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        ({"focal_mm": 0.0}, "focal_mm"),
        ({"sensor_mm": (36.0, np.nan)}, "sensor_mm"),
        ({"target": (0.0, -1.0, 0.0)}, "same point"),
        ({"target": (0.0, -1.0, 5.0)}, "parallel"),
        ({"eye": (0.0, np.nan, 0.0)}, "eye"),
        ({"target": (0.0, 1.0)}, "target"),
        ({"up": (0.0, 0.0, 0.0)}, "up"),
        ({"up": (0.0, np.inf, 0.0)}, "up"),
        ({"principal_point_offset_mm": (np.nan, 0.0)}, "principal_point_offset_mm"),
    ],
)
def test_lenses_that_cannot_be(arguments: dict[str, Any], part: str) -> None:
    values: dict[str, Any] = {
        "sensor_mm": (36.0, 24.0), "focal_mm": 30.0, "resolution": (60, 40),
        "eye": (0.0, -1.0, 0.0), "target": (0.0, 0.0, 0.0), "name": "left", **arguments,
    }  # fmt: skip
    with pytest.raises(InputError) as caught:
        gs.Camera.from_lens(**values)
    assert part in str(caught.value) and "left" in str(caught.value)


def test_whole_numbers_as_floats_make_a_size() -> None:
    camera = gs.Camera(40.0, np.int32(30), K)  # type: ignore[arg-type]
    assert (camera.width, camera.height) == (40, 30) and type(camera.width) is int


def test_points_to_project_have_three_coordinates() -> None:
    with pytest.raises(InputError, match=r"project; got points of shape \(1, 2\)"):
        gs.Camera(40, 30, K).project([[0.0, 1.0]])
