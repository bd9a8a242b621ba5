"""Round dots: centres on exact pictures, and the bias of perspective taken off."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from gpusim.errors import InputError
from gpusim.measure import CalibratedCamera, circle_centres, find_dots, rig_camera

FINE = 20  # samples of a pixel along each axis


def camera(distortion: tuple[float, ...] = ()) -> CalibratedCamera:
    K = np.array([[900.0, 0.0, 161.3], [0.0, 905.0, 118.2], [0.0, 0.0, 1.0]])
    return rig_camera((320, 240), K, distortion or None)


def pose() -> np.ndarray:
    """A plane tilted by 40 degrees, half a metre away."""
    result = np.eye(4)
    result[:3, :3] = cv2.Rodrigues(np.array([0.65, 0.2, 0.1]))[0]
    result[:3, 3] = [-60.0, -40.0, 500.0]
    return result


def conic_centre(K: np.ndarray, pose: np.ndarray, place: np.ndarray, radius: float) -> np.ndarray:
    """Centre of a circle's image in closed form: the pole of the line at infinity."""
    x, y = place
    circle = np.array([[1, 0, -x], [0, 1, -y], [-x, -y, x * x + y * y - radius**2]])
    inverse = np.linalg.inv(K @ pose[:3][:, [0, 1, 3]])
    pole = np.linalg.inv(inverse.T @ circle @ inverse) @ [0, 0, 1]
    return pole[:2] / pole[2]


def picture(places: np.ndarray, radius: float, slope: float = 0.0) -> np.ndarray:
    """Dark dots on the plane, by samples of every pixel near them."""
    inverse = np.linalg.inv(np.array(camera().K) @ pose()[:3][:, [0, 1, 3]])
    axis = (np.arange(FINE) + 0.5) / FINE - 0.5
    share = np.zeros((240, 320))
    for place in places:
        column, row = np.rint(conic_centre(camera().K, pose(), place, radius)).astype(int) - 26
        x, y = ((first + np.arange(52)[:, None] + axis).ravel() for first in (column, row))
        grid = np.stack([*np.meshgrid(x, y), np.ones((y.size, x.size))], axis=-1) @ inverse.T
        covered = ((grid[..., :2] / grid[..., 2:] - place) ** 2).sum(axis=-1) <= radius**2
        own = covered.reshape(52, FINE, 52, FINE).mean(axis=(1, 3))
        share[row : row + 52, column : column + 52] += own
    return (200.0 - 160.0 * share) * (1.0 + slope * np.arange(320) / 320)


PLACES = np.array([[x, y] for y in (8.0, 44.0, 80.0) for x in (5.0, 40.0, 77.0, 110.0)])


@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_centres_are_those_of_the_ellipses(slope: float) -> None:
    # noise as any camera has: steps of the light by whole grey levels would stand out otherwise
    noise = np.random.default_rng(4).normal(0.0, 0.7 if slope else 0.0, (240, 320))
    image = np.rint(picture(PLACES, 9.0, slope) + noise).astype(np.uint8)
    found = find_dots(image, (10, 45))
    want = np.array([conic_centre(camera().K, pose(), place, 9.0) for place in PLACES])
    order = [int(np.argmin(np.linalg.norm(found.points - one, axis=1))) for one in want]
    assert sorted(order) == list(range(len(PLACES)))
    error = np.abs(found.points[order] - want).max()
    assert error <= (0.01 if slope else 0.003)  # measured: 0.0053, 0.0018
    assert (found.axes[:, 0] > 1.15 * found.axes[:, 1]).all()
    assert (found.contrast > 120).all()
    bright = find_dots(255 - image, (10, 45), dark=False)
    assert len(bright.points) == len(PLACES) and (bright.contrast < -100).all()


def test_the_bias_of_perspective_is_taken_off() -> None:
    radius, K = 9.0, camera().K
    seen = np.array([conic_centre(K, pose(), place, radius) for place in PLACES])
    homogeneous = np.column_stack([PLACES, np.ones(len(PLACES))]) @ (K @ pose()[:3][:, [0, 1, 3]]).T
    true = homogeneous[:, :2] / homogeneous[:, 2:]
    assert np.abs(seen - true).max() >= 0.1  # px: what it would be wrong by
    assert np.abs(circle_centres(seen, camera(), pose(), radius) - true).max() <= 1e-6


def test_the_lens_counts_too() -> None:
    """Behind a lens with distortion: against the centroid of a finely sampled disc's image."""
    lens = camera((-0.25, 0.1, 0.001, -0.002, 0.0))
    rng = np.random.default_rng(2)
    spread = np.sqrt(rng.uniform(size=200_000)), rng.uniform(0, 2 * np.pi, 200_000)
    disc = 9.0 * spread[0][:, None] * np.stack([np.cos(spread[1]), np.sin(spread[1])], axis=1)
    turn, shift = cv2.Rodrigues(pose()[:3, :3])[0], pose()[:3, 3]

    def project(flat: np.ndarray) -> np.ndarray:
        space = np.column_stack([flat, np.zeros(len(flat))])
        return cv2.projectPoints(space, turn, shift, lens.K, lens.distortion)[0].reshape(-1, 2)

    for place in PLACES[[0, 7]]:
        around = place + disc
        ends = [project(around + d) for d in ([1e-3, 0.0], [-1e-3, 0.0], [0.0, 1e-3], [0.0, -1e-3])]
        by_x, by_y = ends[0] - ends[1], ends[2] - ends[3]
        weight = np.abs(by_x[:, 0] * by_y[:, 1] - by_x[:, 1] * by_y[:, 0])
        mean = weight @ project(around) / weight.sum()
        got = circle_centres(mean[None], lens, pose(), 9.0)
        # 200,000 random samples of a disc 30 px wide leave 0.02 px
        assert np.abs(got - project(place[None])).max() <= 0.06


def test_a_blurred_dot_is_as_well_located() -> None:
    image = cv2.GaussianBlur(picture(PLACES[5:6], 9.0), (0, 0), 1.2)
    (point,) = find_dots(np.rint(image).astype(np.uint8), (10, 45)).points
    assert np.abs(point - conic_centre(camera().K, pose(), PLACES[5], 9.0)).max() <= 0.006


def test_what_is_no_dot_is_not_reported() -> None:
    image = np.full((120, 160), 200.0)
    image[20:40, 20:40] = 40.0  # a square
    image[60:70, 20:60] = 40.0  # a bar
    image[90:120, 100:130] = 40.0  # over the border
    assert len(find_dots(image, (8, 40)).points) == 0
    assert len(find_dots(np.full((60, 60), 9, np.uint8), (8, 40)).points) == 0


def test_wrong_arguments_name_themselves() -> None:
    with pytest.raises(InputError, match="size_px"):
        find_dots(np.zeros((60, 60)), (3, 10))
    with pytest.raises(InputError, match="radius"):
        circle_centres([[3.0, 4.0]], camera(), pose(), 0.0)


@pytest.mark.parametrize("slope", [0.0, 0.3])
def test_bright_dots_on_dark_tell_the_light_by_themselves(slope: float) -> None:
    """What is dark around them tells little of it: with that alone, 0.017 px."""
    y, x = np.indices((111, 151), dtype=float)
    errors = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        places = np.array([[38.0, 55.0], [108.0, 53.0]]) + rng.uniform(-0.5, 0.5, (2, 2))
        far = np.hypot(x - places[:, :1, None], y - places[:, 1:, None]).min(axis=0)
        clear = 30.0 + 170.0 * np.clip(15.5 - far, 0.0, 1.0)
        image = clear * (1.0 + slope * (x - 75.0) / 150) + rng.normal(0.0, 2.0, x.shape)
        found = find_dots(np.rint(image).astype(np.uint8), (26, 34), dark=False)
        assert found.points.shape == (2, 2)
        order = np.argsort(found.points[:, 0])
        errors.append(found.points[order] - places)
    rms = float(np.sqrt(np.mean(np.square(errors))))
    print(f"slope of the light {slope}: {rms:.4f} px RMS")
    assert rms <= 0.014
