"""The preview's camera: moves in closed form, and the same view when it is written down."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from gpusim.optics.camera.pinhole import Camera
from gpusim.pipeline.scene_objects.cameras import build_camera
from gpusim.scene import Scene
from gpusim.visualization.turntable import MARGIN, Turntable, camera_lines
from tests.support.small_scene import DOCUMENT

VIEW = Turntable((0.3, -0.2, 0.7), 2.3, 0.8, 0.4, 0.6)
WIDTH, HEIGHT = 1280, 790


def point_under(view: Turntable, x: float, y: float) -> np.ndarray:
    """(3,): what lies as deep as the pivot under a place of the window."""
    camera = view.camera(WIDTH, HEIGHT)
    ray = camera.ray_matrix() @ [x - 0.5, y - 0.5, 1.0]
    return np.asarray(camera.eye + view.distance * ray @ camera.camera_from_world[:3, :3])


def test_sides_look_along_axes() -> None:
    for side, forward, right in (("front", (0, 1, 0), (1, 0, 0)), ("right", (-1, 0, 0), (0, 1, 0)),
                                 ("top", (0, 0, -1), (1, 0, 0))):  # fmt: skip
        R = VIEW.side(side).camera(40, 30).camera_from_world[:3, :3]
        np.testing.assert_allclose(R[2], forward, atol=1e-15)
        np.testing.assert_allclose(R[0], right, atol=1e-15)


def test_z_is_up_and_the_pivot_in_the_middle() -> None:
    camera = VIEW.camera(WIDTH, HEIGHT)
    np.testing.assert_allclose(camera.project(VIEW.pivot), [639.5, 394.5], atol=1e-10)
    assert camera.camera_from_world[0, 2] == 0.0  # level
    assert camera.project(np.add(VIEW.pivot, (0, 0, 0.1)))[1] < 394.5
    assert np.linalg.norm(camera.eye - VIEW.pivot) == pytest.approx(2.3, rel=1e-14)


def test_orbit_drags_what_is_in_front() -> None:
    """Half a turn for the window's height; what faces the camera follows the mouse."""
    near = np.array(VIEW.pivot) - 0.1 * VIEW.axes[2]
    for dx, dy, axis in ((30, 0, 0), (0, 30, 1)):
        turned = VIEW.orbit(dx, dy, HEIGHT).camera(WIDTH, HEIGHT)
        assert turned.project(near)[axis] > VIEW.camera(WIDTH, HEIGHT).project(near)[axis] + 1.0
    there = VIEW.orbit(HEIGHT, 0, HEIGHT)
    np.testing.assert_allclose(there.axes[0], -VIEW.axes[0], atol=1e-14)
    assert VIEW.orbit(0, 1e6, HEIGHT).elevation == pytest.approx(np.pi / 2)


def test_pan_and_zoom_keep_what_is_under_the_cursor() -> None:
    point = point_under(VIEW, 300, 200)
    panned = VIEW.pan(90, -40, HEIGHT).camera(WIDTH, HEIGHT)
    np.testing.assert_allclose(panned.project(point), [389.5, 159.5], atol=1e-9)
    for steps in (-3.0, 1.0, 5.5):
        zoomed = VIEW.zoom(steps, 300, 200, WIDTH, HEIGHT)
        np.testing.assert_allclose(
            zoomed.camera(WIDTH, HEIGHT).project(point), [299.5, 199.5], atol=1e-9
        )
        assert zoomed.distance == pytest.approx(2.3 * 1.1**steps, rel=1e-14)


@pytest.mark.parametrize("size", [(1280, 790), (500, 900)])
def test_fit_is_as_near_as_it_gets(size: tuple[int, int]) -> None:
    """All in the image, the outermost on the margin on two opposite sides."""
    points = np.random.default_rng(4).normal(size=(200, 3)) * [3.0, 0.2, 1.0] + [5.0, 7.0, -2.0]
    fitted = VIEW.fit(points, *size)
    assert (fitted.azimuth, fitted.elevation) == (VIEW.azimuth, VIEW.elevation)
    half = np.array(size) / 2
    at = (fitted.camera(*size).project(points) + 0.5 - half) / half
    reach = np.stack([-at.min(axis=0), at.max(axis=0)])
    assert reach.max() <= 1.0 - MARGIN + 1e-9
    tight = np.argmax(reach.max(axis=0))
    np.testing.assert_allclose(reach[:, tight], 1.0 - MARGIN, atol=1e-9)
    np.testing.assert_allclose(VIEW.fit(points[:1], *size).pivot, points[0], atol=1e-12)
    # what is taken of two sides is left free, and no more
    free = np.array(size) - (180, 70)
    beside = VIEW.fit(points, *size, taken=(180, 70))
    at = 2.0 * (beside.camera(*size).project(points) + 0.5) / free - 1.0
    reach = np.stack([-at.min(axis=0), at.max(axis=0)])
    assert reach.max() == pytest.approx(1.0 - MARGIN, abs=1e-9)
    np.testing.assert_allclose(reach[0], reach[1], atol=0.15)


def test_a_scene_camera_is_taken_over() -> None:
    given = Camera.from_lens((36, 24), 50, (600, 400), (1.0, -2.0, 1.5), (0.2, 0.1, 0.3))
    taken = VIEW.of_camera(given, (0.2, 0.1, 0.3)).camera(600, 400)
    points = np.random.default_rng(1).normal(size=(20, 3)) * 0.2
    np.testing.assert_allclose(taken.project(points), given.project(points), atol=1e-9)
    down = Camera.from_lens((36, 24), 50, (600, 400), (0, 0, 2), (0, 0, 0), up=(0, 1, 0))
    taken = VIEW.of_camera(down, (0, 0, 0)).camera(600, 400)
    np.testing.assert_allclose(taken.project(points), down.project(points), atol=1e-9)


@pytest.mark.parametrize("elevation", [0.4, np.pi / 2, -np.pi / 2])
def test_the_written_camera_gives_the_same_view(elevation: float) -> None:
    view = Turntable((0.31, -0.17, 0.72), 2.3456, -2.2, elevation, 0.61)
    document = tomllib.loads(camera_lines(view, WIDTH, HEIGHT, "fitted"))
    scene = Scene.from_document({**DOCUMENT, "camera": document["camera"], "measure": []})
    read, own = build_camera(scene.cameras[0]), view.camera(WIDTH, HEIGHT)
    points = np.array(view.pivot) + np.random.default_rng(2).normal(size=(50, 3)) * 0.4
    np.testing.assert_allclose(read.project(points), own.project(points), atol=2e-3)
