"""From surfaces to the triangles of a view: clipping, splitting, culling, extreme sizes."""

from __future__ import annotations

from functools import partial

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels, segment_pixels
from gpusim.optics.geometry.clipping import MAX_EDGE
from gpusim.optics.geometry.feature_edges import creases, feature_edges
from gpusim.optics.geometry.vertex_attributes import SurfaceNormals
from gpusim.optics.geometry.view import look
from tests.support.optics_reference import Array, Plate, flat, pattern, reference

QUAD = np.array([[0, 1, 2, 3]])


def camera(width: int = 81, height: int = 53, eye: Array | None = None) -> gs.Camera:
    place = np.array([0.0, -1.0, 0.0]) if eye is None else eye
    return gs.Camera.from_lens(
        (36.0, 36.0 * height / width),
        30.0,
        (width, height),
        place,
        place + np.array([0.03, 1.0, -0.02]),
    )


def plate(size: float, y: float = 0.0) -> Array:
    h = 0.5 * size
    return np.array([[-h, y, -h], [h, y, -h], [h, y, h], [-h, y, h]])


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_a_floor_that_runs_under_and_behind_the_camera(device: Device, backend: str) -> None:
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    paint = gs.paint.Checker(0.5, dark=0.2, light=0.8, ground=0.8, columns=30, rows=40)
    floor = Plate(np.array([-7.0, -9.0, -0.3]), x, y, (15.0, 20.0), pattern(paint))
    surface = gs.Surface(floor.corners(), QUAD, paint=paint)
    view = gs.Camera.from_lens(
        (36.0, 24.0), 24.0, (61, 41), (0.1, -1.0, 0.0), (0.2, 1.0, -0.35), up=(0.05, 0, 1)
    )
    want = reference(view, [floor], 0.5)
    got = gs.render([surface], view, background=0.5, device=device, backend=backend).radiance
    error = got - want
    print(f"floor {backend}: rms {np.sqrt(np.mean(error**2)):.1e} worst {np.abs(error).max():.1e}")
    assert (want == 0.5).any() and (np.abs(want - 0.2) < 1e-9).any()
    # at the horizon more than eight squares fall into a pixel: they are taken as grey
    assert np.sqrt(np.mean(error**2)) < 2.5e-3
    near = error[25:]
    assert np.sqrt(np.mean(near**2)) < 5e-4


def test_a_surface_around_the_camera_fills_the_image(device: Device) -> None:
    """An open tube along the view, from behind the camera to far ahead."""
    angle = 2 * np.pi * np.arange(12) / 12
    ring = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    points = np.concatenate([ring + np.array([0, y, 0]) for y in (-5.0, 30.0)])
    faces = np.array([[i, (i + 1) % 12, 12 + (i + 1) % 12, 12 + i] for i in range(12)])
    tube = gs.Surface(points, faces, paint=gs.paint.Plain(0.6))
    view = camera(61, 43, np.array([0.2, -1.0, 0.1]))
    frame = gs.render([tube], view, device=device)
    end = np.linalg.norm(np.mgrid[:43, :61][::-1].T - view.project((0, 30.0, 0)), axis=2).T
    radius = view.K[0, 0] / 31.0
    np.testing.assert_allclose(frame.radiance[end > radius + 2], 0.6, atol=1e-6)
    assert (frame.radiance[end < radius * np.cos(np.pi / 12) - 2] == 0.0).all()


def test_long_edges_are_split_without_cracks(device: Device) -> None:
    """A large fan with a vertex in view: every pixel is covered, no triangle is too long."""
    rng = np.random.default_rng(6)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
    rim = 40.0 * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    rim[:, 1] = rng.uniform(-0.6, 5.0, 9)
    points = np.concatenate([[[0.05, 0.0, 0.02]], rim])
    faces = np.array([[0, 1 + k, 1 + (k + 1) % 9] for k in range(9)])
    fan = gs.Surface(points, faces, paint=gs.paint.Plain(1.0), smooth_angle=np.pi)
    view = camera(1531, 37)
    prepared = look([fan], view, lit=False)
    sides = np.roll(prepared.screen, -1, axis=1) - prepared.screen
    assert np.linalg.norm(sides, axis=2).max() <= MAX_EDGE
    assert prepared.count > 10
    for backend in ("gpu", "numpy"):
        image = gs.render([fan], view, device=device, backend=backend).radiance
        assert np.abs(image - 1.0).max() < 1e-5


def cube(centre: tuple[float, float, float] = (0, 0, 0), size: float = 0.3) -> gs.Surface:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    faces = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    return gs.Surface(0.5 * size * corners + centre, np.array(faces))


def test_closed_surfaces_lose_their_backs() -> None:
    view = look([cube((0.2, 0.1, 0.2))], camera(), lit=False)
    assert set(view.face) == {0, 2, 4} and view.count == 6
    inside = look([cube((0.0, -1.0, 0.0), 2.0)], camera(), lit=False)
    assert inside.count == 0


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_open_surfaces_are_seen_and_lit_from_both_sides(device: Device, side: float) -> None:
    surface = gs.Surface(plate(0.4), QUAD, paint=gs.paint.Plain(0.6))
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), (0, side, 0), (0, 0, 0))
    lamp = [gs.PointLight((0.0, 3.0 * side, 0.0), 100.0)]
    frame = gs.render([surface], view, lamp, device=device)
    want = 0.6 / np.pi * 100.0 / (4 * np.pi * 9.0)
    assert frame.radiance[16, 28] == pytest.approx(want, rel=1e-5)
    normal = frame.truth().image("normal")[16, 28]
    np.testing.assert_allclose(normal, [0.0, side, 0.0], atol=1e-12)
    other = gs.render([surface], view, [gs.PointLight((0, -3.0 * side, 0), 100.0)], device=device)
    assert other.radiance.max() == 0.0


def test_views_of_nothing(device: Device) -> None:
    """Behind, beside, edge-on at zero area: background everywhere, empty truth."""
    view = camera()
    for points in (
        plate(0.4, y=-3.0),  # behind the camera
        plate(0.4) + np.array([50.0, 0, 0]),  # beside the image
        np.zeros((4, 3)) + np.array([0.0, 0.0, 0.1]),  # all in one point
    ):
        surface = gs.Surface(points, QUAD, reference=plate(0.4))
        for backend in ("gpu", "numpy"):
            frame = gs.render([surface], view, background=0.25, device=device, backend=backend)
            assert (frame.radiance == np.float32(0.25)).all()
            assert not frame.ids().any()
            assert len(frame.truth().row) == 0


def strip(count: int, width: float, rows: int = 2) -> gs.Surface:
    """A plane of count x rows narrow quadrilaterals before the camera."""
    xs = (np.arange(count + 1) - 0.5 * count) * width
    zs = np.linspace(-0.05, 0.05, rows + 1)
    grid = np.stack(np.meshgrid(xs, [0.0], zs, indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange((count + 1) * (rows + 1)).reshape(count + 1, rows + 1)
    faces = np.stack(
        [number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], axis=-1
    ).reshape(-1, 4)
    return gs.Surface(grid, faces, paint=gs.paint.Plain(0.7))


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_triangles_of_a_thousandth_of_a_pixel(device: Device, backend: str) -> None:
    """A strip of 400 faces, 0.001 px wide each: its outline is that of one rectangle.

    A pixel lies under 500 triangles: more than the device takes, so that the host resolves it.
    """
    view = camera(57, 33)
    width = 1e-3 / view.K[0, 0]
    surface = strip(400, width, 1)
    want = reference(
        view,
        [Plate(np.array([-200 * width, 0.0, -0.05]), np.array([1.0, 0, 0]),
               np.array([0, 0, 1.0]), (400 * width, 0.1), flat(0.7))],
    )  # fmt: skip
    got = gs.render([surface], view, device=device, backend=backend).radiance
    error = np.abs(got - want)
    print(f"400 slivers {backend}: worst {error.max():.1e}")
    assert find_edge_pixels(look([surface], view, lit=False)).depth.max() > 500
    assert 0.1 < want.max() < 0.3
    assert error.max() < 5e-3


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_triangles_of_a_hundred_thousand_pixels(device: Device, backend: str) -> None:
    """An edge of a plate that reaches 1e5 px beyond the image stays where it belongs."""
    view = camera(57, 33)
    size = 1e5 / view.K[0, 0]
    edge = np.array([0.05, 0.0, 0.02])
    s = np.array([0.8, 0.0, 0.6])
    t = np.array([-0.6, 0.0, 0.8])
    huge = Plate(edge - 0.4 * size * s, s, t, (size, size), flat(0.7))
    surface = gs.Surface(huge.corners(), QUAD, paint=gs.paint.Plain(0.7))
    want = reference(view, [huge])
    got = gs.render([surface], view, device=device, backend=backend).radiance
    assert ((want > 0.01) & (want < 0.69)).sum() > 20
    assert np.abs(got - want).max() < 3e-3


@pytest.mark.parametrize("degrees", [1.0, 0.1, 0.01])
def test_grazing_views(device: Device, degrees: float) -> None:
    """A lit, patterned plate seen almost edge-on stays within its own radiances."""
    paint = gs.paint.Checker(0.05, dark=0.2, light=0.8)
    surface = gs.Surface(plate(0.5), QUAD, paint=paint)
    turn = np.radians(degrees)
    eye = np.array([np.cos(turn), -np.sin(turn), 0.0])
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), eye, (0.0, 0, 0))
    lamp = [gs.PointLight((0.0, -50.0, 0.0), 4 * np.pi**2 * 2500.0)]
    s, t = np.array([1.0, 0, 0]), np.array([0.0, 0, 1])
    want = reference(view, [Plate(plate(0.5)[0], s, t, (0.5, 0.5), pattern(paint))])
    for backend in ("gpu", "numpy"):
        got = gs.render([surface], view, lamp, device=device, backend=backend).radiance
        error = np.abs(got - want)
        print(f"{degrees} degrees {backend}: worst {error.max():.1e}, brightest {got.max():.3f}")
        assert np.isfinite(got).all() and got.min() >= 0.0 and got.max() <= 0.81
        assert error.max() < 0.015


def test_a_plate_seen_exactly_edge_on(device: Device) -> None:
    """No radiance from a surface that has no area on the image, lit or not."""
    rng = np.random.default_rng(7)
    for _ in range(20):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        points = plate(0.5) @ turn.T
        eye = 1.3 * turn @ [0.8, 0.0, 0.6]  # in the plate's own plane
        surface = gs.Surface(points, QUAD, paint=gs.paint.Checker(0.05))
        view = gs.Camera.from_lens((36, 24), 30, (57, 33), eye, (0, 0, 0), up=turn[:, 1])
        for lights in (None, [gs.PointLight((3.0, 2.0, 4.0), 1e3)]):
            for backend in ("gpu", "numpy"):
                frame = gs.render([surface], view, lights, device=device, backend=backend)
                assert np.isfinite(frame.radiance).all()
                assert np.abs(frame.radiance).max() < 1e-3


def test_more_features_than_a_pixel_can_look_at_are_refused(device: Device) -> None:
    """A loop that long would end early on a software rasteriser, and nobody would know."""
    surface = gs.Surface(plate(0.5), QUAD, paint=gs.paint.Dots(0.001, 0.0018))
    turn = np.radians(2.0)
    eye = np.array([np.cos(turn), -np.sin(turn), 0.0])
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), eye, (0.0, 0, 0))
    with pytest.raises(InputError, match=r"got up to \d+ features .* expected at most 50000"):
        gs.render([surface], view, device=device)


def test_edges_of_a_dense_pattern_agree_with_the_twin(device: Device) -> None:
    """Hundreds of dots under each edge pixel: the host takes what the device can't."""
    surface = gs.Surface(plate(0.08), QUAD, paint=gs.paint.Dots(0.0012, 0.002))
    view = gs.Camera.from_lens((36, 24), 30, (37, 23), (0.4, -0.9, 0.1), (0.0, 0, 0))
    got = gs.render([surface], view, device=device).radiance
    twin = gs.render([surface], view, backend="numpy").radiance
    assert np.abs(got - twin).max() < 1e-4


def test_edge_lists_hold_every_pixel_that_a_segment_crosses() -> None:
    rng = np.random.default_rng(3)
    width, height = 23, 17
    segments = rng.uniform(-8.0, 30.0, (60, 2, 2))
    segments[:5, 1, 0] = segments[:5, 0, 0]  # vertical ones
    segments[5:9, 1, 1] = segments[5:9, 0, 1]  # and horizontal ones
    for segment in segments:
        got = set(segment_pixels(segment[None], width, height).tolist())
        t = np.linspace(0.0, 1.0, 20_001)[:, None]
        along = np.rint(segment[0] + t * (segment[1] - segment[0])).astype(int)
        inside = (along >= 0).all(axis=1) & (along < [width, height]).all(axis=1)
        crossed = set((along[inside, 1] * width + along[inside, 0]).tolist())
        assert crossed <= got
        assert len(got) <= len(crossed) + 4
    both = segment_pixels(segments, width, height)
    assert (np.diff(both) > 0).all()


def test_edge_pixels_list_their_triangles_from_near_to_far() -> None:
    surfaces = [gs.Surface(plate(0.2, y), QUAD) for y in (0.3, 0.0, 0.6)]
    view = look(surfaces, camera(), lit=False)
    edges = find_edge_pixels(view)
    depth = view.corners[:, :, 2].mean(axis=1)
    for first, last in zip(edges.start[:-1], edges.start[1:], strict=True):
        order: npt.NDArray[np.int64] = edges.triangle[first:last]
        assert (np.diff(depth[order]) > -0.03).all()
    assert len(edges.start) == len(edges.pixel) + 1 and edges.start[-1] == len(edges.triangle)


def test_which_edges_show() -> None:
    """A cube: 12 creases; those between two hidden faces are left out; diagonals never show."""
    surface = cube((0.2, 0.1, 0.2))
    topology = surface.topology
    eye = np.array([0.0, -1.0, 0.0])
    normal = SurfaceNormals(surface).area
    front = np.sum(normal.T * (surface.points[topology.triangles[:, 0]] - eye), axis=1) < 0.0

    def lengths(
        region: npt.NDArray[np.int32], smooth_angle: float, patterned: tuple[int, ...] = (0, 1)
    ) -> Array:
        """Of the edges that show without light."""
        turning = partial(creases, topology, normal, smooth_angle)
        shows = feature_edges(topology, front, region, turning, front, None, patterned)
        some = np.arange(1, len(shows), 2)
        np.testing.assert_array_equal(turning(some), turning(None)[some])
        owner = topology.first[shows]
        k = np.argmax(topology.edge[owner] == np.flatnonzero(shows)[:, None], axis=1)
        corners = topology.triangles[owner]
        rows = np.arange(len(k))
        ends = surface.points[corners[rows, k]] - surface.points[corners[rows, (k + 1) % 3]]
        result: Array = np.linalg.norm(ends, axis=1)
        return result

    region = np.zeros(6, np.int32)
    assert topology.closed and len(lengths(region, np.pi / 6)) == 9
    np.testing.assert_allclose(lengths(region, np.pi / 6), 0.3, atol=1e-12)
    # from the front alone, with creases allowed: only the silhouette; creases of plain paint don't
    # show
    assert len(lengths(region, np.pi)) == len(lengths(region, np.pi / 6, ())) == 6
    # a region border shows, whatever the angle
    region[2] = 1
    assert len(lengths(region, np.pi)) == 8
