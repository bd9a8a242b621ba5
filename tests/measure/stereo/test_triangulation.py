"""Points in space: exact without noise, as uncertain as stated with it; which point is which."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gpusim as gs
from gpusim.errors import InputError
from gpusim.measure import (
    CalibratedCamera,
    align,
    displacement_3d,
    epipolar_distance,
    match_epipolar,
    triangulate,
)
from gpusim.measure.stereo.triangulation import normalised
from tests.support.target_images import stereo_rig

RIG = stereo_rig()
CAMERAS = tuple(
    CalibratedCamera(f"camera-{c}", RIG.size, RIG.K[c], RIG.distortion[c], RIG.pose[c], {}, 0.0)
    for c in range(2)
)


def cloud(count: int, seed: int) -> np.ndarray:
    """Points that both cameras see, in the rig's coordinates."""
    rng = np.random.default_rng(seed)
    return rng.uniform([50, -120, 850], [350, 120, 1150], (count, 3))


def pixels(points: np.ndarray) -> np.ndarray:
    return np.stack([RIG.project(c, points) for c in range(2)])


def test_lens_is_undone_exactly() -> None:
    points = cloud(60, 1)
    rays = normalised(CAMERAS[0], RIG.project(0, points))
    assert np.abs(rays - points[:, :2] / points[:, 2:]).max() <= 1e-11
    assert np.isnan(normalised(CAMERAS[0], [[np.nan, 3.0]])).all()


@pytest.mark.parametrize("refine", [False, True])
def test_perfect_pixels_give_the_points_back(refine: bool) -> None:
    points = cloud(50, 2)
    seen = pixels(points)
    seen[1, 7] = np.nan
    found = triangulate(CAMERAS, seen, refine=refine)
    assert np.isnan(found.points[7]).all() and found.cameras[7] == 1
    rest = np.arange(50) != 7
    assert np.abs(found.points[rest] - points[rest]).max() <= 1e-8
    assert found.residual[rest].max() <= 1e-9


def test_refined_points_scatter_as_their_covariance_says() -> None:
    points, sigma = cloud(400, 3), 0.2
    seen = pixels(points)
    seen += np.random.default_rng(4).normal(0, sigma, seen.shape)
    found = triangulate(CAMERAS, seen, sigma_px=sigma)
    error = found.points - points
    # squared Mahalanobis distances are chi-square with three degrees of freedom: mean 3
    distance = np.einsum("ni,nij,nj->n", error, np.linalg.inv(found.covariance), error)
    assert 2.6 <= distance.mean() <= 3.4
    linear = triangulate(CAMERAS, seen, refine=False)
    assert found.residual.mean() <= linear.residual.mean() * (1 + 1e-9)


def test_displacement_in_the_axes_of_the_object() -> None:
    points = cloud(20, 5)
    turn = Rotation.from_euler("xyz", [10, -30, 50], degrees=True).as_matrix()
    own = (points - [3.0, 4.0, 5.0]) @ turn
    moved = own + np.array([0.4, -3.0, 1.5])
    after = moved @ turn.T + [3.0, 4.0, 5.0]
    before, later = triangulate(CAMERAS, pixels(points)), triangulate(CAMERAS, pixels(after))
    frame = align(before.points, own)
    assert frame.rms <= 1e-8 and frame.scale == 1.0
    found = displacement_3d(before, later, frame)
    assert np.abs(found.displacement - [0.4, -3.0, 1.5]).max() <= 1e-7
    assert np.abs(found.magnitude - np.linalg.norm([0.4, -3.0, 1.5])).max() <= 1e-7


def test_similarity_is_found_and_no_mirror_image() -> None:
    source = cloud(12, 6)
    turn = Rotation.from_rotvec([0.2, -1.0, 0.4]).as_matrix()
    target = 1.7 * source @ turn.T + [10.0, -20.0, 5.0]
    target[3] = np.nan
    found = align(source, target, scale=True)
    assert abs(found.scale - 1.7) <= 1e-12 and np.abs(found.rotation - turn).max() <= 1e-12
    mirrored = align(source, source * [1.0, 1.0, -1.0])
    assert np.linalg.det(mirrored.rotation) > 0 and mirrored.rms > 10
    with pytest.raises(InputError, match="got 2 common points"):
        align(source[:2], source[:2])
    with pytest.raises(InputError, match="on one line"):
        align(np.outer(np.arange(5.0), [1.0, 2.0, 3.0]), np.outer(np.arange(5.0), [3.0, 2.0, 1.0]))
    with pytest.raises(InputError, match="in one place"):
        align(np.ones((4, 3)), np.ones((4, 3)))


def test_points_are_paired_by_their_epipolar_lines() -> None:
    points = cloud(15, 7)
    first, second = pixels(points)
    distance = epipolar_distance(CAMERAS[0], CAMERAS[1], first, second)
    assert np.diag(distance).max() <= 1e-6
    order = np.random.default_rng(8).permutation(15)
    found = match_epipolar(CAMERAS[0], CAMERAS[1], first, second[order][:-2], limit_px=0.5)
    sure = ~found.ambiguous
    assert sure.sum() >= 6
    assert (order[found.pairs[sure, 1]] == found.pairs[sure, 0]).all()


def test_depth_tells_points_on_one_epipolar_line_apart() -> None:
    near = np.array([200.0, 0.0, 950.0])
    far = 1.25 * near  # behind each other for the first camera: one epipolar line in the second
    first, second = pixels(np.stack([near, far]))
    first[1] += 0.01
    both = match_epipolar(CAMERAS[0], CAMERAS[1], first, second)
    assert both.ambiguous.all()
    one = match_epipolar(CAMERAS[0], CAMERAS[1], first[:1], second, depth=(1100.0, 1300.0))
    assert one.pairs.tolist() == [[0, 1]] and not one.ambiguous.any()


def test_wrong_input_is_refused() -> None:
    camera = gs.Camera(70, 60, np.diag([80.0, 80.0, 1.0]))
    with pytest.raises(InputError, match="got Camera; expected those of calibrate"):
        triangulate([camera, camera], np.zeros((2, 1, 2)))  # type: ignore[list-item]
    with pytest.raises(InputError, match="at least two"):
        triangulate(CAMERAS[:1], np.zeros((1, 4, 2)))
    with pytest.raises(InputError, match="limit_px"):
        match_epipolar(CAMERAS[0], CAMERAS[1], np.zeros((1, 2)), np.zeros((1, 2)), limit_px=0.0)
    with pytest.raises(InputError, match="depth"):
        match_epipolar(CAMERAS[0], CAMERAS[1], np.zeros((1, 2)), np.zeros((1, 2)), depth=(2, 1))
