"""The lens model against OpenCV, its inverse, and the lenses it refuses."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.optics.camera.distortion import Distortion
from tests.support.optics_rigs import RIGS, rig

BARREL = [-0.21, 0.06, 0.0011, -0.0007]


@pytest.mark.parametrize("name", RIGS)
def test_projection_equals_opencv(name: str) -> None:
    """Off-centre, skewed, rational, tilted, 10 m lens, 5616 px: to 0.002 px, here to 1e-9."""
    camera, X = rig(name, 10_000)
    R, t = camera.camera_from_world[:3, :3], camera.camera_from_world[:3, 3]
    no_skew = camera.K.copy()
    no_skew[0, 1] = 0.0
    d = np.zeros(5) if camera.distortion is None else np.asarray(camera.distortion)
    want = cv2.projectPoints(X, cv2.Rodrigues(R)[0], t, no_skew, d)[0].reshape(-1, 2)
    # OpenCV has no skew: it adds skew * y, and y is what its second row shows
    want[:, 0] += camera.K[0, 1] * (want[:, 1] - camera.K[1, 2]) / camera.K[1, 1]
    got = camera.project(X)
    inside = np.all((got > -0.5) & (got < [camera.width - 0.5, camera.height - 0.5]), axis=1)
    assert inside.sum() > 5000
    worst = np.abs(got - want)[inside].max()
    print(f"{name}: {inside.sum()} points in the image, worst {worst:.1e} px")
    assert worst < 1e-9


@pytest.mark.parametrize("name", RIGS)
def test_undistorting_inverts_the_lens_everywhere_in_the_image(name: str) -> None:
    camera, _ = rig(name, 1)
    x = np.linspace(-0.5, camera.width - 0.5, 61)
    y = np.linspace(-0.5, camera.height - 0.5, 43)
    pixels = np.stack(np.meshgrid(x, y), axis=-1)
    ideal = camera.undistort(pixels)
    assert np.abs(camera.distort(ideal) - pixels).max() < 1e-11 * camera.K[0, 0]
    if camera.K[0, 1] == 0.0 and camera.lens is not None:
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 500, 1e-14)
        want = cv2.undistortPointsIter(
            pixels.reshape(-1, 1, 2), camera.K, np.asarray(camera.distortion), None, camera.K,
            criteria,
        ) if hasattr(cv2, "undistortPointsIter") else cv2.undistortPoints(
            pixels.reshape(-1, 1, 2), camera.K, np.asarray(camera.distortion), P=camera.K,
            criteria=criteria,
        )  # fmt: skip
        assert np.abs(want.reshape(-1, 2) - ideal.reshape(-1, 2)).max() < 1e-6


def test_the_jacobian_is_the_derivative() -> None:
    lens = Distortion(
        np.array([0.1, -0.05, 0.003, -0.002, 0.02, 0.04, -0.05, 0.01, 0.01, -0.02, 0.007, 0.005])
    )
    points = np.random.default_rng(3).uniform(-0.6, 0.6, (40, 2))
    _, jacobian = lens._on_flat_sensor(points)
    step = 1e-6
    for axis in range(2):
        e = step * np.eye(2)[axis]
        numeric = (lens.distort(points + e) - lens.distort(points - e)) / (2.0 * step)
        assert np.abs(jacobian[..., axis] - numeric).max() < 1e-9


def test_a_lens_that_folds_in_the_image_is_refused_with_its_radius() -> None:
    """r (1 - 0.5 r^2) grows up to r = sqrt(2 / 3), where it is 0.5443."""
    K = np.array([[4700.0, 0, 2731], [0, 4688, 1904.7], [0, 0, 1]])
    with pytest.raises(InputError) as caught:
        gs.Camera(5616, 3744, K, [-0.5, 0, 0, 0], name="left")
    text = str(caught.value)
    assert "left" in text and "monotonic" in text and "0.544331" in text and "2558.36 px" in text


def test_only_what_the_image_needs_must_be_monotonic() -> None:
    """k3 = -125 folds at r = 0.32, and a long lens shows no more than 0.02."""
    K = np.array([[150e3, 0, 2731], [0, 150e3, 1904.7], [0, 0, 1]])
    camera = gs.Camera(5616, 3744, K, [0.2, 0.0, 0.0, 0.0, -125.0])
    assert camera.lens is not None and camera.lens.limit == pytest.approx(0.3267, abs=1e-4)
    assert np.isfinite(camera.undistort([[0.0, 0.0], [5615.0, 3743.0]])).all()


def test_points_beyond_the_domain_are_nan_and_not_folded_back() -> None:
    camera = gs.Camera.from_lens(
        (36, 24), 50, (600, 400), (0, -1, 0), (0, 0, 0), distortion=[-0.5, 0.0, 0.0, 0.0]
    )
    x = np.linspace(0.0, 3.0, 301)
    got = camera.project(np.stack([x, 0 * x, 0 * x], axis=1))[:, 0]
    good = np.isfinite(got)
    assert good[x < 0.81].all() and not good[x > 0.82].any()
    assert (np.diff(got[good]) > 0).all()
    # OpenCV folds: the same point lands in the image again
    folded = cv2.projectPoints(
        np.array([[1.41, 0.0, 1.0]]),
        np.zeros(3),
        np.zeros(3),
        camera.K,
        np.array([-0.5, 0, 0, 0.0]),
    )[0].ravel()
    assert abs(folded[0] - camera.K[0, 2]) < 10.0


def test_a_pixel_that_the_lens_cannot_reach_has_no_ideal_position() -> None:
    lens = Distortion(np.array([-0.5, 0.0, 0.0, 0.0]))
    assert np.isnan(lens.undistort(np.array([[0.56, 0.0]]))).all()
    assert np.isfinite(lens.undistort(np.array([[0.54, 0.0]]))).all()


def test_zeros_are_no_distortion() -> None:
    camera = gs.Camera(40, 30, np.array([[100.0, 0, 20], [0, 100, 15], [0, 0, 1]]), np.zeros(8))
    assert camera.lens is None
    np.testing.assert_array_equal(camera.undistort([3.0, 4.0]), [3.0, 4.0])


@pytest.mark.parametrize("pixels", [[1.0, 2.0, 3.0], 4.0])
def test_pixels_to_undistort_have_two_coordinates(pixels: object) -> None:
    camera = gs.Camera(40, 30, np.array([[100.0, 0, 20], [0, 100, 15], [0, 0, 1]]), BARREL)
    with pytest.raises(InputError, match="undistort; got pixels of shape"):
        camera.undistort(pixels)  # type: ignore[arg-type]
