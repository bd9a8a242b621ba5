"""Triangles cut for a lens: that it ends, that nothing opens, and what half a plane covers."""

from __future__ import annotations

from collections import Counter

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry import clipping
from gpusim.optics.geometry.clipping import ImagePlane
from gpusim.optics.geometry.view import View, look
from tests.optics.geometry.test_polygon_clipping import cut, shoelace
from tests.support.optics_edges import HEIGHT, WIDTH, half_plane

Array = npt.NDArray[np.float64]
FINE = np.array([[2700.0, 0.0, 139.9], [0.0, 2700.0, 229.3], [0.0, 0.0, 1.0]])
STRONG = [-8.0, 30.0, 0.02, -0.03]
"""Monotonic by a little in the image; beyond it, the tangential terms fold it."""


def through(distortion: list[float] | None) -> gs.Camera:
    return gs.Camera(3 * WIDTH, 3 * HEIGHT, FINE, distortion=distortion)


@pytest.mark.parametrize("depth", [0.7, 1.2, 2.0])
@pytest.mark.parametrize("distortion", [STRONG, [-1.2, 1.5, 0.02, -0.03]])
def test_cutting_ends_with_few_triangles(distortion: list[float], depth: float) -> None:
    view = look([half_plane(depth, shift=22.0)], through(distortion), lit=False)
    assert 50 < view.count < 3000


def mesh(seed: int) -> gs.Surface:
    """A wavy sheet of uneven faces from behind the camera to far away, larger than the view."""
    rng = np.random.default_rng(seed)
    u, v = np.meshgrid(np.linspace(-1.3, 1.1, 12), np.linspace(-1.0, 1.2, 9), indexing="ij")
    u, v = u + rng.normal(0.0, 0.03, u.shape), v + rng.normal(0.0, 0.03, v.shape)
    z = 1.1 + 0.9 * u + 0.05 * np.sin(5.0 * v)
    number = np.arange(u.size).reshape(u.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points = np.stack([0.16 * u, 0.22 * v, z], axis=-1).reshape(-1, 3)
    return gs.Surface(points, quads.reshape(-1, 4), paint=gs.paint.Plain(1.0))


def open_edges(view: View) -> Array:
    """Edges (n, 2, 2) px of triangles that no neighbour shares, to the last bit."""
    found: Counter[tuple[tuple[float, ...], ...]] = Counter()
    for triangle in view.screen.tolist():
        for k in range(3):
            found[tuple(sorted((tuple(triangle[k]), tuple(triangle[k - 1]))))] += 1
    return np.array([edge for edge, count in found.items() if count != 2]).reshape(-1, 2, 2)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("distortion", [None, STRONG, [-1.2, 1.5, 0.02, -0.03], [0.9, 40.0, 0, 0]])
def test_neighbours_are_cut_at_the_same_points(distortion: list[float] | None, seed: int) -> None:
    """Inside the image every edge has its twin, though many triangles leave it, or the lens."""
    camera = through(distortion)
    view = look([mesh(seed)], camera, lit=False)
    edges = open_edges(view)
    low, high = edges.min(axis=1), edges.max(axis=1)
    inside = (high > -0.5).all(axis=1) & (low < [camera.width - 0.5, camera.height - 0.5]).all(1)
    assert view.count > 40 and len(edges) > 10
    assert not inside.any(), edges[inside][:3]
    # and what is drawn has no holes: the sheet fills the image
    image = gs.render([mesh(seed)], camera, background=0.0, backend="numpy").radiance
    assert image.min() == 1.0


def test_the_rule_for_an_edge_is_that_of_its_reverse() -> None:
    screen = ImagePlane(through(STRONG))
    rng = np.random.default_rng(3)
    ideal = rng.uniform(-20.0, 300.0, (4000, 1, 2)) + rng.normal(0.0, 25.0, (4000, 3, 2))
    ideal[:100, 1, 0] = ideal[:100, 0, 0]
    shows = np.ones((4000, 3), bool)
    one = clipping.edge_excess(ideal, screen.bent(ideal), shows, screen)
    turned = np.ascontiguousarray(ideal[:, ::-1])
    other = clipping.edge_excess(turned, screen.bent(turned), shows, screen)
    assert (one > 1.0).sum() > 100
    np.testing.assert_array_equal(one, other[:, [1, 0, 2]])


def test_cutting_without_end_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clipping, "MAX_PIECES", 100)
    with pytest.raises(gs.InputError, match=r"Camera 'camera' distortion; got \[-8.*straight"):
        look([half_plane(1.2, shift=22.0)], through(STRONG), lit=False)


def exact_cover(corner: Array, normal: Array) -> Array:
    """Share (33, 47) of each pixel's square where normal . (x - corner) >= 0, by clipping."""
    y, x = np.mgrid[:33, :47].astype(np.float64)
    distance = (x - corner[0]) * normal[0] + (y - corner[1]) * normal[1]
    reach = 0.5 * np.abs(normal).sum()
    result = np.asarray(distance >= reach, np.float64)
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    for j, i in np.argwhere(np.abs(distance) < reach):
        result[j, i] = shoelace(cut(square, normal, distance[j, i]))
    return result


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_half_a_plane_covers_its_exact_share(device: Device, backend: str) -> None:
    """100 positions and angles, among them edges along pixels' borders, centres and diagonals."""
    rng = np.random.default_rng(11)
    angles = np.r_[np.arange(8) * np.pi / 4, rng.uniform(0.0, 2.0 * np.pi, 84), 1e-3 * np.arange(8)]
    corners = np.array([23.0, 16.0]) + rng.uniform(-1.0, 1.0, (100, 2))
    corners[:4] = [23.5, 16.5]
    corners[4:8] = [23.0, 16.0]
    camera = gs.Camera(47, 33, np.array([[120.0, 0.7, 22.3], [0.0, 118.0, 15.1], [0.0, 0.0, 1.0]]))
    errors = []
    chosen = slice(None, None, 1 if backend == "gpu" else 4)
    for angle, corner in zip(angles[chosen], corners[chosen], strict=True):
        along, normal = (
            np.array([-np.sin(angle), np.cos(angle)]),
            np.array([np.cos(angle), np.sin(angle)]),
        )
        pixels = corner + np.array(
            [
                -70.0 * along,
                80.0 * along,
                80.0 * along + 90.0 * normal,
                90.0 * normal - 70.0 * along,
            ]
        )
        # a plate that leans away from the camera, so that perspective plays a part
        rays = np.c_[pixels, np.ones(4)] @ camera.ray_matrix().T
        depth = 3.0 / (1.0 + rays[:, :2] @ np.array([0.31, -0.17]))
        plate = gs.Surface(rays * depth[:, None], np.array([[0, 1, 2, 3]]), gs.paint.Plain(1.0))
        image = gs.render([plate], camera, device=device, backend=backend).radiance
        errors.append(np.abs(image - exact_cover(corner, normal)).ravel())
    error = np.array(errors)
    edge = error[error > 0.0].mean() if error.any() else 0.0
    print(f"{backend}: mean {error.mean():.1e}, of edge pixels {edge:.1e}, max {error.max():.1e}")
    assert error.mean() <= 0.002 and error.max() <= 1.0 / 255.0
