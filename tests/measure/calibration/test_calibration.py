"""Calibration against known cameras: points with and without noise, photographs, renderings."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import cv2
import numpy as np
import pytest

import gpusim as gs
from gpusim.choices import LensModel
from gpusim.errors import GpusimError, InputError
from gpusim.measure import Chessboard, Sighting, calibrate, find_chessboard, target_statistics
from gpusim.measure.calibration.bundle_adjustment import LENSES, Rig, Rows, _Layout, _project
from tests.support.target_images import (
    Photograph,
    board_poses,
    board_surface,
    places_in_world,
    seen_poses,
    stereo_rig,
)

BOARD = Chessboard(9, 8, 40.0)


def test_derivatives_are_those_of_the_projection() -> None:
    rng = np.random.default_rng(1)
    rig = Rig(
        np.array([[1000.0, 1010.0], [900.0, 905.0]]), np.array([[640.0, 480.0], [600.0, 500.0]]),
        rng.normal(0, 0.01, (2, 14)), np.array([[0.0] * 6, [0.1, -0.3, 0.05, -200.0, 5.0, 20.0]]),
        np.array([[0.2, -0.1, 0.3, -50.0, 20.0, 900.0], [-0.3, 0.2, 0.1, 10.0, -30.0, 1100.0]]),
    )  # fmt: skip
    layout = _Layout(rig, "tilted", square_pixels=False)
    p, row = layout.pack(rig), Rows(1, 1, BOARD.points(), np.zeros((56, 2)))
    at, slopes = layout.places(1, 1), _project(layout, rig, row)[1]
    for k, i in enumerate(at):
        step = np.zeros(len(p))
        step[i] = 1e-6 * max(1.0, abs(p[i]))
        ends = [_project(layout, layout.unpack(p + s * step), row)[0].ravel() for s in (1, -1)]
        numeric = (ends[0] - ends[1]) / (2 * step[i])
        assert np.abs(numeric - slopes[:, k]).max() <= 1e-6 * np.abs(numeric).max()


def test_rig_is_found_again_from_perfect_points() -> None:
    rig = stereo_rig()
    found = calibrate(rig.sightings(BOARD, seen_poses(9, 2), 0.0, 1))
    assert found.rms <= 1e-8 and found.used == 2 * 9 * 56 and found.outliers == 0
    for camera, K, lens, pose in zip(found.cameras, rig.K, rig.distortion, rig.pose, strict=True):
        assert np.abs(camera.K - K).max() <= 1e-5
        assert np.abs(camera.distortion - lens).max() <= 1e-6
        assert np.abs(camera.camera_from_rig - pose).max() <= 1e-5
    assert abs(found.baseline()[0] - np.linalg.norm(rig.pose[1][:3, 3])) <= 1e-5


def test_uncertainties_are_the_scatter_of_the_parameters() -> None:
    """Errors over their stated sigma are standard normal: 40 parameters x 12 calibrations."""
    rig, poses = stereo_rig(), seen_poses(8, 3)
    scores = []
    for seed in range(12):
        found = calibrate(rig.sightings(BOARD, poses, 0.05, seed))
        assert 0.9 * 0.05 * np.sqrt(2) <= found.rms <= 1.1 * 0.05 * np.sqrt(2)
        for camera, K, lens in zip(found.cameras, rig.K, rig.distortion, strict=True):
            truth = dict(fx=K[0, 0], fy=K[1, 1], cx=K[0, 2], cy=K[1, 2])
            got = dict(fx=camera.K[0, 0], fy=camera.K[1, 1], cx=camera.K[0, 2], cy=camera.K[1, 2])
            truth |= dict(zip(("k1", "k2", "p1", "p2", "k3"), lens[:5], strict=True))
            got |= dict(zip(("k1", "k2", "p1", "p2", "k3"), camera.distortion[:5], strict=True))
            scores += [(got[k] - truth[k]) / camera.sigma[k] for k in truth]
        length, sigma = found.baseline()
        angle, sigma_angle = found.angle()
        scores.append((length - np.linalg.norm(rig.pose[1][:3, 3])) / sigma)
        true_angle = np.linalg.norm(cv2.Rodrigues(rig.pose[1][:3, :3])[0])
        scores.append((angle - true_angle) / sigma_angle)
    assert 0.8 <= np.sqrt(np.mean(np.square(scores))) <= 1.25


def test_a_lens_that_the_views_do_not_determine_is_named_by_its_coefficients() -> None:
    seen = stereo_rig().sightings(BOARD, seen_poses(4, 3), 0.02, 1)
    words = r"at 0\.02\d+ px RMS: the views don't determine k1 k2 .*k[456].* of camera 1"
    with pytest.raises(GpusimError, match=words):
        calibrate(seen, lens="rational")
    found = calibrate(seen, lens="radtan").cameras[0]
    assert found.distortion[4] == 0.0 and set(found.sigma) == set("fx fy cx cy k1 k2 p1 p2".split())


def test_wrong_points_are_left_out() -> None:
    rig = stereo_rig()
    seen = rig.sightings(BOARD, seen_poses(8, 4), 0.02, 5)
    seen["camera-1"][3].image[[4, 30]] += [[3.0, -1.0], [0.0, 5.0]]
    found = calibrate(seen)
    assert found.outliers == 2
    assert abs(found.cameras[1].K[0, 0] / 1611.0 - 1) <= 5e-4


def test_a_view_taken_for_another_part_of_the_board_is_left_out() -> None:
    """One camera took one board for a line of fields further on, which fits perfectly by itself."""
    rig = stereo_rig()
    sightings = rig.sightings(BOARD, seen_poses(9, 2), 0.02, 1)
    name = list(sightings)[1]
    views = list(sightings[name])
    views[4] = replace(views[4], board=views[4].board + np.array([0.0, 40.0, 0.0]))
    found = calibrate({**sightings, name: views})
    assert found.outliers == 56 and found.rms <= 0.035
    views[4] = Sighting.none(views[4].resolution, 56, "left out")
    without = calibrate({**sightings, name: views})
    assert (
        np.abs(found.cameras[1].camera_from_rig - without.cameras[1].camera_from_rig).max() <= 1e-4
    )
    assert np.abs(found.cameras[1].K - without.cameras[1].K).max() <= 1e-4


def test_views_of_one_camera_alone_count_too() -> None:
    rig = stereo_rig()
    seen = rig.sightings(BOARD, seen_poses(9, 6), 0.02, 7)
    for camera, view in (("camera-0", 0), ("camera-0", 4), ("camera-1", 7)):
        seen[camera][view] = Sighting.none(rig.size, 56, "no board found")
    found = calibrate(seen)
    assert np.isnan(found.view_rms).sum() == 3 and found.used == 15 * 56
    length = np.linalg.norm(rig.pose[1][:3, 3])
    assert abs(found.baseline()[0] - length) <= 1e-3 * length


def test_what_cannot_be_calibrated_is_refused() -> None:
    rig = stereo_rig()
    seen = rig.sightings(BOARD, seen_poses(6, 8), 0.0, 1)["camera-0"]
    nothing = Sighting.none(rig.size, 56, "no board found")
    with pytest.raises(InputError, match=r"found in 2 of 6 images \(no board found\)"):
        calibrate([*seen[:2], *[nothing] * 4])
    with pytest.raises(InputError, match="share no view"):
        calibrate({"a": [*seen[:3], *[nothing] * 3], "b": [*[nothing] * 3, *seen[3:]]})
    with pytest.raises(InputError, match="lens; got 'fisheye'"):
        calibrate(seen, lens="fisheye")
    with pytest.raises(InputError, match="as many for every camera"):
        calibrate({"a": seen, "b": seen[:-1]})
    with pytest.raises(GpusimError, match="calibrat"):
        calibrate([seen[0]] * 3, lens="tilted")  # one pose says nothing about the focal length


def test_photographs_with_a_bad_lens_noise_and_uneven_light() -> None:
    """A webcam's lens, k1 = -0.27, at 480 x 360."""
    K = np.array([[401.0, 0, 250.0], [0, 404.0, 181.0], [0, 0, 1]])
    lens = np.array([-0.27, 0.06, 1.2e-3, -2e-4, 0.0])
    photograph, board = Photograph((480, 360), K, lens), Chessboard(10, 7, 25.0)
    rays, sightings = photograph.rays(), []
    for seed, pose in enumerate(board_poses(6, np.array([0.0, 420.0, 0.0]), 12, 40.0)):
        to_camera = np.eye(4)
        to_camera[:3, :3] = FACING_CAMERA @ pose[:3, :3]
        middle = board.square / 2 * np.array([board.columns - 2, board.rows - 2, 0.0])
        to_camera[:3, 3] = FACING_CAMERA @ pose[:3, 3] - to_camera[:3, :3] @ middle
        sightings.append(find_chessboard(photograph.take(board, to_camera, rays, seed), board))
    statistics = target_statistics(sightings)
    assert statistics.found >= 5 and statistics.share >= 0.95
    assert 0.7 <= statistics.blur <= 0.95 and statistics.sigma <= 0.02
    found = calibrate(sightings, lens="brown").cameras[0]
    assert found.rms <= 0.03  # measured: 0.018 px
    for value, true, name in ((found.K[0, 0], 401, "fx"), (found.K[1, 1], 404, "fy"),
                              (found.K[0, 2], 250, "cx"), (found.K[1, 2], 181, "cy"),
                              (found.distortion[0], -0.27, "k1")):  # fmt: skip
        assert abs(value - true) <= 4 * found.sigma[name]
    assert abs(found.K[0, 0] / 401 - 1) <= 1e-3


FACING_CAMERA = np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]])


def test_rendered_pairs(device: gs.Device) -> None:
    """The goal for 21 pairs at 21 Mpx, kept by 7 pairs of 720 x 480."""
    cameras = [
        gs.Camera.from_lens((36, 24), 30, (720, 480), (100, -1000, 300), (300, 0, 290)),
        gs.Camera.from_lens((36, 24), 32, (720, 480), (600, -980, 300), (310, 0, 300)),
    ]
    seen: dict[str, list[Sighting]] = {"left": [], "right": []}
    errors = []
    for pose in board_poses(7, np.array([300.0, 0.0, 290.0]), 3):
        for views, camera in zip(seen.values(), cameras, strict=True):
            frame = gs.render([board_surface(BOARD, pose)], camera, background=0.3, device=device)
            views.append(find_chessboard(gs.Sensor().expose(frame), BOARD))
            world = places_in_world(BOARD, views[-1].board, pose)
            errors.append(camera.project(world) - views[-1].image)
    # measured: RMS 0.0003 px
    assert np.sqrt(np.mean(np.concatenate(errors) ** 2)) <= 0.001
    found = calibrate(seen, lens="pinhole")
    assert found.rms <= 0.003
    for got, camera in zip(found.cameras, cameras, strict=True):
        assert abs(got.K[0, 0] / camera.K[0, 0] - 1) <= 5e-5
        assert np.abs(got.K[:2, 2] - camera.K[:2, 2]).max() <= 0.02
    relative = cameras[1].camera_from_world @ np.linalg.inv(cameras[0].camera_from_world)
    assert abs(found.baseline()[0] / np.linalg.norm(relative[:3, 3]) - 1) <= 2e-5
    turn = np.linalg.norm(cv2.Rodrigues(relative[:3, :3])[0])
    assert abs(np.degrees(found.angle()[0] - turn)) <= 1e-3


def test_lenses_are_those_that_users_choose_from() -> None:
    assert tuple(LENSES) == get_args(LensModel)
    assert [len(terms) for terms in LENSES.values()] == [0, 2, 3, 4, 5, 8, 12, 14]
