"""Sides that cameras see whole, beside what a camera makes of their corners."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.camera.standpoint import Side, rig_before

LENS = gs.Camera(530, 410, [[900.0, 0, 264.5], [0, 900.0, 204.5], [0, 0, 1]])
CORNERS = np.array(list(product((0.1, 0.5), (-0.2, 0.0), (0.3, 0.37))))


def test_a_side_stands_upright() -> None:
    front = Side.of([CORNERS[:3], CORNERS[3:]], np.array([0.0, -1.0, 0.0]), np.eye(3)[2])
    np.testing.assert_allclose(front.axes, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(front.size, [0.4, 0.07, 0.2])
    np.testing.assert_allclose(front.middle, [0.3, -0.1, 0.335])


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.6, -0.8, 0.0), (-0.48, 0.6, 0.64)])
def test_a_camera_at_the_distance_has_the_front_in_its_picture(
    normal: tuple[float, float, float],
) -> None:
    way = np.array(normal)
    side = Side.of([CORNERS], way, np.array([0.1, 0.9, 0.3]))
    (camera,) = rig_before(side, [LENS], filled=0.8)
    np.testing.assert_allclose(camera.project(side.middle), [264.5, 204.5], atol=1e-9)
    np.testing.assert_allclose(camera.camera_from_world[2, :3], -way, atol=1e-12)
    assert np.linalg.norm(camera.eye - side.middle) == pytest.approx(side.distance(LENS, 0.8))
    # the front of the box takes 0.8 of the width or of the height, and no side more than that
    front = np.array([[x, y, side.box[0, 2]] for x, y in product(*side.box[:, :2].T)]) @ side.axes
    share = np.ptp(camera.project(front), axis=0) / (530, 410)
    assert share.max() == pytest.approx(0.8) and share.min() < 0.8
    across = np.ptp(front @ side.axes[0]) / np.ptp(camera.project(front)[:, 0])
    assert side.pixel(LENS, 0.8) == pytest.approx(across)


def test_axes_that_meet_say_how_far_away_a_rig_is() -> None:
    poses = [gs.Camera.from_lens((1, 1), 1, (10, 10), eye, (0, 0, 0), up=(0, 1, 0))
             for eye in ((-0.2, 0.0, 0.9), (0.2, 0.05, 0.9))]  # fmt: skip
    rig = [gs.Camera(530, 410, LENS.K, None, one.camera_from_world) for one in poses]
    side = Side.of([CORNERS], np.array([0.0, -1.0, 0.0]), np.eye(3)[2])
    moved = rig_before(side, rig, filled=0.8)
    for before, after in zip(rig, moved, strict=True):
        np.testing.assert_allclose(after.project(side.middle), [264.5, 204.5], atol=0.01)
        away = np.linalg.norm(after.eye - side.middle)
        assert away == pytest.approx(float(np.linalg.norm(before.eye)), rel=1e-4)
    between = [two.camera_from_world @ np.linalg.inv(one.camera_from_world)
               for one, two in (rig, moved)]  # fmt: skip
    np.testing.assert_allclose(between[0], between[1], atol=1e-12)
