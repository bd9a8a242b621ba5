"""Ground truth at pixel centres against rays and planes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.truth import BAND, seen_in
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.twin_checks.images import near_an_edge

QUAD = np.array([[0, 1, 2, 3]])


def camera(width: int = 73, height: int = 41) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 36.0 * height / width), 35.0, (width, height), (0.4, -1.3, 0.2), (0.02, 0, -0.03),
        up=(0.1, 0, 1), principal_point_offset_mm=(0.7, -0.4),
    )  # fmt: skip


def plate() -> gs.Surface:
    points = np.array(
        [[-0.5, 0.1, -0.3], [0.4, -0.05, -0.32], [0.42, 0.0, 0.3], [-0.48, 0.15, 0.32]]
    )
    points[3] = points[0] + points[2] - points[1]  # in one plane
    return gs.Surface(points, QUAD)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_layers_equal_rays_against_the_moved_plane(device: Device, backend: str) -> None:
    surface = plate()
    matrix = np.array([[1.02, 0.01, 0.03], [-0.02, 0.98, 0.0], [0.01, 0.02, 1.01]])
    shift = np.array([0.013, -0.02, 0.007])
    moved = surface.moved(surface.points @ matrix.T + shift)
    view = camera()
    truth = gs.render([moved], view, device=device, backend=backend).truth()
    assert len(truth.row) > 1000
    p = moved.points
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    normal /= np.linalg.norm(normal)
    pixel = np.stack([truth.column, truth.row, np.ones(len(truth.row))], axis=1)
    ray = pixel @ np.linalg.inv(view.K).T @ view.camera_from_world[:3, :3]
    depth = ((p[0] - view.eye) @ normal) / (ray @ normal)
    position = view.eye + depth[:, None] * ray
    X = (position - shift) @ np.linalg.inv(matrix).T
    np.testing.assert_allclose(truth.depth, depth, rtol=1e-12)
    np.testing.assert_allclose(truth.reference, X, atol=1e-12)
    np.testing.assert_allclose(truth.displacement, position - X, atol=1e-12)
    np.testing.assert_allclose(truth.normal, np.tile(normal, (len(X), 1)), atol=1e-12)
    np.testing.assert_allclose(truth.flow, view.project(X) - pixel[:, :2], atol=1e-9)
    assert (truth.face == 0).all() and (truth.region == 0).all()


def test_a_plate_that_moves_along_the_image_has_a_constant_flow(device: Device) -> None:
    view = gs.Camera.from_lens((36, 24), 30, (73, 49), (0, -1.0, 0), (0, 0, 0))
    points = np.array([[-0.3, 0, -0.2], [0.3, 0, -0.2], [0.3, 0, 0.2], [-0.3, 0, 0.2]])
    surface = gs.Surface(points, QUAD)
    shift = np.array([1.7, 0.0, 0.6]) / view.K[0, 0]
    truth = gs.render([surface.moved(points + shift)], view, device=device).truth()
    want = [-1.7, 0.6 * view.K[1, 1] / view.K[0, 0]]
    np.testing.assert_allclose(truth.flow, np.tile(want, (len(truth.row), 1)), atol=1e-10)
    np.testing.assert_allclose(truth.displacement, np.tile(shift, (len(truth.row), 1)), atol=1e-13)


def test_images_of_layers_and_selected_faces(device: Device) -> None:
    surfaces = [plate(), gs.Surface(plate().points + np.array([0.5, -0.1, 0.2]), QUAD)]
    frame = gs.render(surfaces, camera(), device=device)
    whole, second = frame.truth(), frame.truth(faces=(1, 2))
    depth = whole.image("depth")
    assert depth.shape == (41, 73) and np.isnan(depth).any()
    np.testing.assert_array_equal(np.isfinite(depth), frame.ids() > 0)
    assert whole.image("flow").shape == (41, 73, 2)
    assert 0 < len(second.row) < len(whole.row) and (second.face == 1).all()
    np.testing.assert_array_equal(second.depth, whole.depth[whole.face == 1])
    with pytest.raises(InputError, match="truth layer; got 'speed'; expected one of"):
        whole.image("speed")


def test_bands_are_the_whole_image_in_pieces(device: Device) -> None:
    view = camera(61, 2 * BAND + 37)
    tall = plate().points * [3.0, 1.0, 60.0]
    surfaces = [gs.Surface(tall, QUAD), gs.Surface(tall + np.array([0.7, -0.1, 0.2]), QUAD)]
    frame = gs.render(surfaces, view, lights=[gs.PointLight((0, -2, 1), 5.0)], device=device)
    whole, bands = frame.truth(), list(frame.truth_bands())
    assert [len(np.unique(band.row // BAND)) for band in bands] == [1, 1, 1]
    for layer in ("row", "column", *gs.Truth.LAYERS):
        joined = np.concatenate([getattr(band, layer) for band in bands])
        np.testing.assert_array_equal(joined, getattr(whole, layer))
    second = list(frame.truth_bands(faces=(1, 2)))
    assert sum(len(band.row) for band in second) == (whole.face == 1).sum() > 1000


def test_bands_need_the_memory_of_a_band(device: Device) -> None:
    tall = gs.Surface(plate().points * [1.0, 1.0, 30.0], QUAD)
    frame = gs.render([tall], camera(700, 8 * BAND), device=device)
    frame.ids()

    def peak(use: Callable[[], object]) -> int:
        tracemalloc.start()
        use()
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    banded = peak(lambda: [len(band.row) for band in frame.truth_bands()])
    assert banded <= 0.5 * peak(frame.truth)


def test_ids_equal_the_twin_away_from_edges(device: Device) -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform([-0.5, -0.4, -0.4], [0.5, 0.6, 0.4], (60, 3))
    surface = gs.Surface(points, np.arange(60).reshape(20, 3))
    frame = gs.render([surface], camera(), device=device)
    got, want = frame.ids(), visibility_twin(frame.view)
    far = ~near_an_edge(frame.view, 1 / 128)
    assert far.sum() > 2000 and (want[far] > 0).sum() > 500
    np.testing.assert_array_equal(got[far], want[far])
    assert (got != want).sum() < 20


def test_seen_in_detects_what_is_hidden(device: Device) -> None:
    wall = gs.Surface(np.array([[-2.0, 0.5, -2], [2, 0.5, -2], [2, 0.5, 2], [-2, 0.5, 2]]), QUAD)
    corners = np.array([[-0.1, 0, -0.1], [0.15, 0, -0.1], [0.15, 0, 0.2], [-0.1, 0, 0.2]])
    screen = gs.Surface(corners, QUAD)
    view = camera()
    frame = gs.render([wall, screen], view, device=device)
    rng = np.random.default_rng(8)
    points = np.stack([rng.uniform(-2, 2, 3000), np.full(3000, 0.5), rng.uniform(-2, 2, 3000)], 1)
    at = view.project(points)
    inside = ((at > 0) & (at < [72, 40])).all(axis=1)
    # where the line of sight crosses the plane of the screen
    t = -view.eye[1] / (points[:, 1] - view.eye[1])
    crossing = view.eye + t[:, None] * (points - view.eye)
    margin = 2.0 * 1.3 / view.K[0, 0]
    x, z = crossing[:, 0], crossing[:, 2]
    hidden = (x > -0.1 + margin) & (x < 0.15 - margin) & (z > -0.1 + margin) & (z < 0.2 - margin)
    beside = (x < -0.1 - margin) | (x > 0.15 + margin) | (z < -0.1 - margin) | (z > 0.2 + margin)
    seen = seen_in(frame.view, frame.ids(), points)
    assert hidden[inside].sum() > 20 and beside[inside].sum() > 100
    assert not seen[inside & hidden].any()
    assert seen[inside & beside].all()
    outside = ((at < -1) | (at > [73, 41])).any(axis=1)
    assert outside.any() and not seen[outside].any()
    behind = view.eye - 2.0 * (points[:5] - view.eye)
    assert not seen_in(frame.view, frame.ids(), behind).any()
    on_screen = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.1]])
    assert seen_in(frame.view, frame.ids(), on_screen).all()
