"""Areas inside convex polygons against exact formulas and dense sampling."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import ConvexHull

from gpusim.optics.geometry import polygon_clipping

Array = npt.NDArray[np.float64]


def polygons(count: int, vertices: int = 8, seed: int = 4) -> Array:
    """Convex polygons (count, vertices, 2), counter-clockwise, padded by repeating the last."""
    rng = np.random.default_rng(seed)
    result = np.zeros((count, vertices, 2))
    for polygon in result:
        points = rng.normal(size=(rng.integers(3, 9), 2)) + rng.normal(size=2) * 0.7
        hull = points[ConvexHull(points).vertices][:vertices]
        polygon[: len(hull)] = hull
        polygon[len(hull) :] = hull[-1]
    return result


def cut(polygon: Array, normal: Array, offset: float) -> Array:
    """The part of one polygon where normal . x + offset >= 0 (written apart from gpusim's)."""
    kept: list[Array] = []
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        da, db = normal @ a + offset, normal @ b + offset
        if da >= 0.0:
            kept.append(a)
        if (da >= 0.0) != (db >= 0.0):
            kept.append(a + da / (da - db) * (b - a))
    return np.array(kept) if kept else np.zeros((1, 2))


def shoelace(polygon: Array) -> float:
    x, y = polygon.T
    return float(0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def test_polygon_area_and_its_sign() -> None:
    square = np.array([[1.0, 1.0], [4.0, 1.0], [4.0, 3.0], [1.0, 3.0]])
    assert polygon_clipping.polygon_area(square) == 6.0
    assert polygon_clipping.polygon_area(square[::-1]) == -6.0
    many = polygons(50)
    want = [shoelace(p) for p in many]
    np.testing.assert_allclose(polygon_clipping.polygon_area(many), want, rtol=1e-12)
    # far from the origin nothing cancels
    np.testing.assert_allclose(
        polygon_clipping.polygon_area(square / 64 + 2.0**20), 6.0 / 4096, rtol=1e-12
    )


def test_half_planes_and_quadrants_equal_clipped_areas() -> None:
    many = polygons(200)
    x_axis, y_axis = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    half = polygon_clipping.half_plane_area(many)
    quadrant = polygon_clipping.quadrant_area(many)
    right = [cut(p, x_axis, 0.0) for p in many]
    np.testing.assert_allclose(half, [shoelace(p) for p in right], atol=1e-13)
    np.testing.assert_allclose(quadrant, [shoelace(cut(p, y_axis, 0.0)) for p in right], atol=1e-13)
    assert (quadrant > 0).sum() > 50 and (quadrant < half).sum() > 50


@pytest.mark.parametrize("turned", [False, True])
def test_quadrants_with_edges_through_the_corner(turned: bool) -> None:
    """Edges along the axes, through the origin, vertices on it, no area at all."""
    cases = {
        0.25: [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]],
        1.0: [[0, 0], [1, 0], [1, 1], [0, 1]],
        0.0: [[-1, -1], [0, -1], [0, 0], [-1, 0]],
        0.5: [[-1, -1], [1, -1], [1, 1], [1, 1]],  # its long edge runs through the origin
    }
    for area, points in cases.items():
        polygon = np.array(points, np.float64)
        if turned:
            polygon = polygon[::-1]
        sign = -1.0 if turned else 1.0
        assert abs(polygon_clipping.quadrant_area(polygon) - sign * area) < 1e-15
    line = np.array([[-1.0, -0.3], [2.0, 0.6], [2.0, 0.6], [2.0, 0.6]])
    for function in (
        polygon_clipping.polygon_area,
        polygon_clipping.half_plane_area,
        polygon_clipping.quadrant_area,
    ):
        assert abs(function(line)) < 1e-15
    assert abs(polygon_clipping.disc_area(line, np.array(0.7))) < 1e-15


def pixel_share(d: float, gx: float, gy: float) -> float:
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return shoelace(cut(square, np.array([gx, gy]), d))


def test_half_plane_share_over_positions_and_angles() -> None:
    """100 x 100 positions and angles, axis-parallel and diagonal ones included."""
    angle = np.linspace(0.0, 2.0 * np.pi, 100, endpoint=False)
    d = np.linspace(-0.75, 0.75, 100)
    gx, gy = np.cos(angle), np.sin(angle)
    got = polygon_clipping.half_plane_share(d[:, None], gx, gy)
    want = np.array([[pixel_share(x, a, b) for a, b in zip(gx, gy, strict=True)] for x in d])
    error = np.abs(got - want)
    print(f"half-plane coverage: mean {error.mean():.1e}, max {error.max():.1e}")
    assert error.max() < 1e-12
    # the slope's length cancels
    scaled = polygon_clipping.half_plane_share(7e3 * d[:, None], 7e3 * gx, 7e3 * gy)
    assert np.abs(scaled - want).max() < 1e-12


def test_half_plane_share_of_a_constant() -> None:
    zero = np.zeros(1)
    assert polygon_clipping.half_plane_share(np.array([0.2]), zero, zero) == 1.0
    assert polygon_clipping.half_plane_share(np.array([-0.2]), zero, zero) == 0.0


def chord_area(polygon: Array, radius: float) -> float:
    """Area in a disc by integrating over horizontal chords, 200 000 of them."""
    low, high = np.maximum(polygon[:, 1].min(), -radius), np.minimum(polygon[:, 1].max(), radius)
    if not high > low:
        return 0.0
    n = 200_000
    y = low + (np.arange(n) + 0.5) / n * (high - low)
    left, right = np.full(n, -np.inf), np.full(n, np.inf)
    for a, b in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        if a[1] == b[1]:
            continue
        x = a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1])
        if b[1] > a[1]:  # counter-clockwise: the inside lies left of a rising edge
            right = np.minimum(right, x)
        else:
            left = np.maximum(left, x)
    reach = np.sqrt(np.maximum(radius**2 - y**2, 0.0))
    inside = np.maximum(np.minimum(right, reach) - np.maximum(left, -reach), 0.0)
    return float(inside.mean() * (high - low))


def test_disc_areas_against_chords() -> None:
    many = polygons(25, seed=8)
    for radius in (0.05, 0.4, 1.0, 3.0):
        got = polygon_clipping.disc_area(many, np.full(len(many), radius))
        want = np.array([chord_area(p, radius) for p in many])
        assert np.abs(got - want).max() < 1e-7
        assert got.max() > 0.0


def test_disc_inside_outside_and_at_the_centre() -> None:
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    assert abs(polygon_clipping.disc_area(square, np.array(0.3)) - np.pi * 0.09) < 1e-15
    assert abs(polygon_clipping.disc_area(square, np.array(1e-9)) - np.pi * 1e-18) < 1e-30
    assert abs(polygon_clipping.disc_area(square, np.array(5.0)) - 4.0) < 1e-14
    quarter = square + 1.0  # one vertex on the centre
    assert abs(polygon_clipping.disc_area(quarter, np.array(1.0)) - np.pi / 4) < 1e-15
    assert abs(polygon_clipping.disc_area(square + 9.0, np.array(1.0))) < 1e-15


def test_a_huge_disc_is_a_half_plane() -> None:
    """The bow of the circle within a pixel is 1 / (8 radius); rounding grows by its square."""
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    for radius in (1e3, 1e6):
        normal = np.array([np.cos(0.6), np.sin(0.6)])
        shifted = square + (radius - 0.1) * normal
        got = float(polygon_clipping.disc_area(shifted, np.array(radius)))
        want = pixel_share(0.1, -normal[0], -normal[1])
        assert abs(got - want) < 0.1 / radius + 1e-16 * radius**2


def test_padding_and_rotating_vertices_change_nothing() -> None:
    triangle = np.array([[0.2, -0.7], [1.3, 0.4], [-0.6, 0.9]])
    padded = np.concatenate([triangle, np.repeat(triangle[-1:], 5, axis=0)])
    turned = np.roll(triangle, 1, axis=0)
    for other in (padded, turned):
        for function in (
            polygon_clipping.polygon_area,
            polygon_clipping.half_plane_area,
            polygon_clipping.quadrant_area,
        ):
            assert abs(function(other) - function(triangle)) < 1e-15
        r = np.array(0.5)
        assert (
            abs(polygon_clipping.disc_area(other, r) - polygon_clipping.disc_area(triangle, r))
            < 1e-15
        )


def test_relu_mean_is_the_mean() -> None:
    a, b = np.array([-1.0, 2.0, -3.0, 0.0, 1.0]), np.array([3.0, 4.0, -1.0, 0.0, 1.0])
    t = (np.arange(100_000) + 0.5) / 100_000
    want = np.maximum(a[:, None] * (1 - t) + b[:, None] * t, 0.0).mean(axis=1)
    np.testing.assert_allclose(polygon_clipping.relu_mean(a, b), want, atol=1e-8)
