"""What cameras see at places of a picture, and where it goes: against planes and motions in closed
form."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.errors import InputError
from tests.support.moved_block import moved_block

STRAIN = np.array([[0.02, 0.01, 0.0], [0.0, -0.005, 0.0], [0.03, 0.0, 0.004]])
SHIFT = np.array([1.5e-3, -2e-3, 0.7e-3])
PLACES = np.array([[150.0, 90.0], [183.37, 66.81], [101.02, 120.9], [20.4, 20.6]])
"""Three on the block, one on the wall."""


def affine(points: np.ndarray) -> np.ndarray:
    return np.asarray(points @ STRAIN.T + SHIFT)


def test_places_are_where_the_ray_meets_the_surface() -> None:
    _, motion = moved_block(affine)
    points = motion.seen_at("front", PLACES)
    assert points.seen.all() and points.surface.tolist() == [0, 0, 0, 1]
    assert motion.body(points).tolist() == [0, 0, 0, -1]
    camera = motion.camera("front")
    ideal = camera.undistort(PLACES)
    ray = np.concatenate([ideal, np.ones((4, 1))], axis=1) @ camera.ray_matrix().T
    direction = ray @ camera.camera_from_world[:3, :3]
    plane = np.array([0.0, 0.0, 0.0, 0.06])  # y, m
    met = camera.eye + direction * ((plane - camera.eye[1]) / direction[:, 1])[:, None]
    assert np.abs(motion.position(points, 0) - met).max() <= 1e-15
    assert np.abs(motion.pixels(points, "front", 0) - PLACES).max() <= 1e-9


def test_they_stay_on_their_material() -> None:
    _, motion = moved_block(affine)
    points = motion.seen_at("front", PLACES)
    at = motion.position(points, 0)
    moved = motion.displacement(points, 1)
    assert np.abs(moved[:3] - affine(at[:3])).max() <= 1e-16
    turn = np.radians(4.0)
    own = at[3] - [0.03, 0.06, 0.02]
    turned = [np.cos(turn) * own[0] + np.sin(turn) * own[2], own[1],
              np.cos(turn) * own[2] - np.sin(turn) * own[0]]  # fmt: skip
    assert moved[3] == pytest.approx(np.array(turned) - own + [0.0015, 0, 0], abs=1e-15)
    assert np.abs(motion.position(points, 1) - at - moved).max() <= 1e-16
    side = motion.camera("side").project(at + moved)
    assert np.abs(motion.pixels(points, "side", 1) - side).max() <= 1e-9


def test_a_camera_finds_points_where_another_one_says() -> None:
    _, motion = moved_block(affine)
    points = motion.seen_at("front", PLACES[:3])
    for frame in (0, 1):
        again = motion.seen_at("side", motion.pixels(points, "side", frame), frame)
        gap = motion.position(again, 0) - motion.position(points, 0)
        assert np.abs(gap).max() <= 1e-13, frame


def test_points_get_hidden_and_out_of_sight() -> None:
    # the block goes on before what the camera sees of the wall, and half turned out of the image
    _, motion = moved_block(lambda points: np.tile([-0.045, 0.0, 0.0], (len(points), 1)))
    points = motion.seen_at("front", np.array([[40.0, 95.0], [60.0, 100.0], [230.0, 90.0]]))
    assert motion.visible(points, "front", 0).tolist() == [True, True, True]
    assert motion.visible(points, "front", 1).tolist() == [False, False, True]
    unseen = motion.seen_at("front", np.array([[-4000.0, 0.0]]))
    assert not unseen.seen.any() and np.isnan(motion.position(unseen, 1)).all()
    assert not motion.visible(unseen, "front", 0).any()


def test_a_thin_plate_seen_from_behind_hides_its_front() -> None:
    # 0.05 mm at 0.2 m: a quarter of a thousandth of the depth
    mesh = {"builder": "box", "size_mm": [60.0, 0.05, 40.0], "divisions": [6, 1, 4]}
    scene, _ = moved_block(affine)
    body = {**scene.document["body"][0], "mesh": mesh}
    middle = np.array([0.03, 0.0, 0.02])
    _, motion = moved_block(lambda X: (X - middle) * [-2.0, -2.0, 0.0], body=[body])
    points = motion.seen_at("front", PLACES[:2])
    assert motion.visible(points, "front", 0).all()
    assert not motion.visible(points, "front", 1).any()


def test_some_of_them_are_points_too() -> None:
    _, motion = moved_block(affine)
    points = motion.seen_at("front", PLACES)
    some = points[np.array([True, False, False, True])]
    assert len(some) == 2 and some.surface.tolist() == [0, 1]
    assert np.array_equal(motion.position(some, 1), motion.position(points, 1)[[0, 3]])


def test_wrong_places_and_cameras_are_named() -> None:
    _, motion = moved_block(affine)
    with pytest.raises(InputError, match="camera; got 'frnt'; expected one of front"):
        motion.seen_at("frnt", PLACES)
    with pytest.raises(InputError, match=r"pixels; got \(2,\)"):
        motion.seen_at("front", PLACES[0])
    with pytest.raises(InputError, match="points; got int; expected what seen_at returned"):
        motion.displacement(3, 1)
    assert motion.seen_at("front", [[np.nan, 3.0], [-900.0, 5.0]]).seen.tolist() == [False, False]
