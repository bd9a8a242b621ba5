"""Pixels in which several layers meet, against areas by inclusion and exclusion."""

from __future__ import annotations

from functools import reduce
from itertools import combinations, pairwise

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import TwinMismatch
from gpusim.gpu import Device, compare
from gpusim.optics.edge_pixels.visible_polygons import visible_polygons
from gpusim.optics.geometry.polygon_clipping import _crossed, clip_square, half_planes, moments
from tests.support.optics_reference import Plate, flat, pattern, reference

Array = npt.NDArray[np.float64]
SIZE = 7
K = np.array([[40.0, 0.0, 3.0], [0.0, 40.0, 3.0], [0.0, 0.0, 1.0]])
CAMERA = gs.Camera(SIZE, SIZE, K)
BACKGROUND = 0.37
SQUARE = [np.array(p) for p in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))]


def stack(seed: int, layers: int) -> tuple[list[gs.Surface], list[Array], list[float]]:
    """Triangles one behind the other, each with a side through the middle pixel or near it."""
    rng = np.random.default_rng(seed)
    surfaces, shapes, albedos = [], [], []
    for layer in range(layers):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        across = np.array([np.cos(angle), np.sin(angle)])
        along = np.array([-across[1], across[0]])
        middle = 3.0 + rng.uniform(-0.6, 0.6, 2)
        shape = np.stack([
            middle - rng.uniform(0.5, 6.0) * along, middle + rng.uniform(0.5, 6.0) * along,
            middle + rng.uniform(0.3, 7.0) * across,
        ])  # fmt: skip
        # on the grid of screen positions, so that both sides mean the same triangle
        shape = np.rint(shape * 65536) / 65536
        depth = 1.0 + 0.5 * layer
        points = depth * np.column_stack([(shape - 3.0) / 40.0, np.ones(3)])
        albedo = float(rng.uniform(0.05, 0.95))
        face = np.array([[0, 1, 2, -1]])
        surfaces.append(gs.Surface(points, face, gs.paint.Plain(albedo)))
        shapes.append(shape)
        albedos.append(albedo)
    return surfaces, shapes, albedos


def area(shapes: list[Array], column: int, row: int) -> float:
    """Area that a pixel and all triangles have in common."""
    polygon = [p + np.array([column, row]) for p in SQUARE]
    for shape in shapes:
        u, v = shape[1] - shape[0], shape[2] - shape[0]
        turn = np.sign(u[0] * v[1] - u[1] * v[0])
        for k in range(3):
            a, side = shape[k], shape[(k + 1) % 3] - shape[k]
            inside = [turn * (side[0] * (p - a)[1] - side[1] * (p - a)[0]) for p in polygon]
            cut = []
            for i, p in enumerate(polygon):
                d, e = inside[i - 1], inside[i]
                if (d < 0.0) != (e < 0.0):
                    cut.append(polygon[i - 1] + d / (d - e) * (p - polygon[i - 1]))
                if e >= 0.0:
                    cut.append(p)
            polygon = cut
    origin = polygon[0] if polygon else np.zeros(2)
    corners = [p - origin for p in polygon]
    twice = [a[0] * b[1] - a[1] * b[0] for a, b in pairwise(corners)]
    return 0.5 * sum(twice)


def exact(shapes: list[Array], albedos: list[float], column: int, row: int) -> float:
    """Radiance: what one layer shows is its area less that of the union of those before it."""
    total, seen = 0.0, 0.0
    for k, shape in enumerate(shapes):
        visible = 0.0
        for many in range(k + 1):
            for some in combinations(shapes[:k], many):
                visible += (-1) ** many * area([shape, *some], column, row)
        total += visible * albedos[k]
        seen += visible
    return total + (1.0 - seen) * BACKGROUND


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_three_to_six_layers_through_one_pixel(device: Device, backend: str) -> None:
    worst, crossed = 0.0, 0
    for seed in range(8):
        surfaces, shapes, albedos = stack(seed, 3 + seed % 4)
        image = gs.render(surfaces, CAMERA, background=BACKGROUND, device=device, backend=backend)
        for row, column in ((3, 3), (3, 4), (2, 3), (3, 2)):
            want = exact(shapes, albedos, column, row)
            parts = [area([shape], column, row) for shape in shapes]
            crossed += sum(0.01 < part < 0.99 for part in parts) >= 3
            worst = max(worst, abs(float(image.radiance[row, column]) - want))
    print(f"{backend}: worst of {crossed} pixels with three edges or more {worst:.1e}")
    assert crossed >= 12
    assert worst < 5e-6


def test_sampled_shares_would_be_seen() -> None:
    """The reference tells 16 x 32 samples a pixel, as good as they are, from areas."""
    _, shapes, albedos = stack(3, 6)
    y, x = np.mgrid[:16, :32]
    points = np.stack([(x + 0.5) / 32 + 2.5, (y + 0.5) / 16 + 2.5], axis=-1)
    image = np.full((16, 32), BACKGROUND)
    for shape, albedo in reversed(list(zip(shapes, albedos, strict=True))):
        u, v = shape[1] - shape[0], shape[2] - shape[0]
        turn = np.sign(u[0] * v[1] - u[1] * v[0])
        inside = [
            turn * (s[0] * (points - a)[..., 1] - s[1] * (points - a)[..., 0]) >= 0.0
            for a, s in ((shape[k], shape[(k + 1) % 3] - shape[k]) for k in range(3))
        ]
        image[reduce(np.logical_and, inside)] = albedo
    error = abs(image.mean() - exact(shapes, albedos, 3, 3))
    assert 5e-6 < error < 0.02


def test_pieces_are_disjoint_and_add_up() -> None:
    """Many triangles over a pixel: visible areas sum to that of their union, by fine sampling."""
    rng = np.random.default_rng(2)
    corners = rng.uniform(-0.9, 0.9, (60, 3, 2))
    corners[::3] *= 0.4
    planes = half_planes(corners)
    polygon, count = clip_square(planes)
    row, piece = visible_polygons(polygon, count, planes, corners, np.zeros(60, np.int64))
    size, centre = moments(piece)
    assert (size > 0.0).all() and len(row) > 60
    at = (np.arange(400) + 0.5) / 400 - 0.5
    points = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 2)
    inside = (points @ np.swapaxes(planes[..., :2], 1, 2) + planes[:, None, :, 2] >= 0).all(axis=2)
    first = np.where(inside.any(axis=0), inside.argmax(axis=0), 60)
    shares = np.bincount(first, minlength=61)[:60] / len(points)
    np.testing.assert_allclose(np.bincount(row, size, 60), shares, atol=3e-4)
    # the middle of each piece shows the triangle that it belongs to
    sides = np.einsum("tkd,nd->ntk", planes[..., :2], centre[size > 1e-6]) + planes[:, :, 2]
    front = (sides >= 0.0).all(axis=2).argmax(axis=1)
    np.testing.assert_array_equal(front, row[size > 1e-6])


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_a_hidden_pattern_shows_only_what_is_seen_of_it(device: Device, backend: str) -> None:
    """A board behind a bar: the mean of the paint is that of the visible part of the pixel."""
    x, y = np.eye(3)[0], np.eye(3)[1]
    paint = gs.paint.Checker(0.0811, dark=0.05, light=0.95, origin=(0.011, 0.007))
    across, along = np.cos(0.23) * x - np.sin(0.23) * y, np.cos(0.23) * y + np.sin(0.23) * x
    back = Plate(np.array([-0.5, -0.4, 2.0]), across, along, (1.0, 1.0), pattern(paint))
    turned = np.cos(0.3) * x + np.sin(0.3) * y, np.cos(0.3) * y - np.sin(0.3) * x
    front = Plate(np.array([-0.06, -0.08, 1.0]), *turned, (0.2, 0.0711), flat(0.5))
    quad = np.array([[0, 3, 2, 1]])
    frame = gs.PaintFrame(back.origin, across, along)
    surfaces = [
        gs.Surface(back.corners(), quad, {"p": paint}, frames={"p": frame}),
        gs.Surface(front.corners(), quad, paint=gs.paint.Plain(0.5)),
    ]
    want = reference(CAMERA, [back, front])
    got = gs.render(surfaces, CAMERA, device=device, backend=backend).radiance
    error = np.abs(got - want)
    print(f"{backend}: worst {error.max():.1e}")
    assert np.ptp(want) > 0.5 and error.max() < 1e-3


def test_device_and_twin_agree_on_deep_stacks(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    surfaces = [surface for seed in range(3) for surface in stack(seed + 20, 7)[0]]
    for number, surface in enumerate(surfaces):
        surfaces[number] = surface.moved(surface.points * (1.0 + number % 7))
    got = gs.render(surfaces, CAMERA, background=BACKGROUND, device=device).radiance
    twin = gs.render(surfaces, CAMERA, background=BACKGROUND, backend="numpy").radiance
    compare("optics/edge_pixels/resolve", got, twin, "pixel")
    # a triangle that hides nothing any more is seen
    monkeypatch.setattr("gpusim.optics.edge_pixels.visible_polygons.TOUCH", 0.05)
    wrong = gs.render(surfaces, CAMERA, background=BACKGROUND, backend="numpy").radiance
    with pytest.raises(TwinMismatch):
        compare("optics/edge_pixels/resolve", got, wrong, "pixel")


def test_slivers_whose_corners_go_in_and_out_stay_where_they_are() -> None:
    """Of corners on a line, rounding leaves some on either side of it."""
    line = np.array([[-0.4, -0.1], [-0.1, 0.05], [0.1, 0.15], [0.3, 0.25], [0.4, 0.3]])
    corners = np.concatenate([line, np.repeat(line[-1:], 3, axis=0)]).T[:, :, None]
    for turn in range(5):
        own = np.roll([0.0, -3e-17, -3e-17, 1e-17, -2e-17], turn)
        own = np.concatenate([own, own[-1:].repeat(3)])[:, None]
        piece, _ = _crossed(corners, np.array([5]), own)
        assert np.isfinite(piece).all()
        assert (piece.min(axis=1) >= line.min(axis=0)[:, None] - 1e-15).all()
        assert (piece.max(axis=1) <= line.max(axis=0)[:, None] + 1e-15).all()
