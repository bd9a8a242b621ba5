"""Surroundings that surfaces hide: against form factors, rays, and looking from every pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.ambient.hemisphere_mask import (
    directions,
    hemisphere_masks,
    hemisphere_masks_twin,
)
from gpusim.optics.ambient.silhouette_bvh import EdgeAdjacency, SamplePoints, tangent
from gpusim.optics.ambient.silhouette_search import SilhouetteBuffers, in_groups
from gpusim.optics.ambient.sky_occluders import JoinedFaces
from gpusim.optics.camera.undistortion_table import undistorted
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light
from gpusim.optics.shading.setup import Setup
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.twin_checks.scenes import block

Array = npt.NDArray[np.float64]
UP = np.array([[0.0, 0.0, 1.0]])
QUAD = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])
AHEAD = np.array([0.0, 1.0, 0.0])
FACE = np.array([[0, 1, 2, 3]])
EVEN: list[Light] = [gs.AmbientLight(1.0 / np.pi, occlusion=True)]


def share(corners: Array, at: Array, normal: Array = UP) -> Array:
    """What single faces (F, 4, 3), hiding on both sides, leave of the light of points (N, 3)."""
    sizes = np.full((2, len(at)), [[1e-9], [1e-3]])
    points = SamplePoints(at, np.broadcast_to(normal, at.shape), *sizes)
    edges = EdgeAdjacency.apart(corners, np.ones(len(corners), bool))
    return hemisphere_masks_twin(points, edges).open_share


def turned(points: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def form_factor(corners: Array) -> float:
    """Lambert's, of a polygon (K, 3) over the horizon, as seen from the origin looking up."""
    d = corners / np.linalg.norm(corners, axis=1)[:, None]
    following = np.roll(d, -1, axis=0)
    across = np.cross(d, following)
    normal = across / np.linalg.norm(across, axis=1)[:, None]
    angle = np.arccos(np.clip(np.sum(d * following, axis=1), -1.0, 1.0))
    return float(abs(np.sum(angle * normal[:, 2])) / (2.0 * np.pi))


def plain(points: Array, faces: npt.NDArray[np.int64] = FACE) -> gs.Surface:
    return gs.Surface(points, faces, paint=gs.paint.Plain(1.0))


def white(surface: gs.Surface) -> gs.Surface:
    return plain(surface.points, surface.faces)


def camera(width: int = 160, position: tuple[float, float, float] = (1.6, -2.4, 1.9)) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 27.0), 40.0, (width, 3 * width // 4), position, (0.1, 0.0, 0.15)
    )


def tube(radius: float, height: float, count: int = 40) -> gs.Surface:
    """A closed upright cylinder."""
    angle = np.arange(count) * 2.0 * np.pi / count
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.c_[ring, np.zeros(count)], np.c_[ring, np.full(count, height)]])
    points = np.concatenate([points, [[0.0, 0.0, 0.0], [0.0, 0.0, height]]])
    i, none = np.arange(count), np.full(count, -1)
    j = (i + 1) % count
    low, high = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    faces = [
        np.stack([i, j, count + j, count + i], axis=1),
        np.stack([j, i, low, none], axis=1),
        np.stack([count + i, count + j, high, none], axis=1),
    ]
    return plain(points, np.concatenate(faces))


def ball(radius: float, middle: tuple[float, float, float]) -> gs.Surface:
    """Of 288 faces."""
    angle, count = np.linspace(0.0, np.pi, 13)[1:-1], 24
    turn = np.arange(count) * 2.0 * np.pi / count
    rings = np.stack(
        [np.outer(np.sin(angle), np.cos(turn)), np.outer(np.sin(angle), np.sin(turn)),
         np.repeat(-np.cos(angle)[:, None], count, axis=1)], axis=2,
    ).reshape(-1, 3)  # fmt: skip
    points = radius * np.concatenate([rings, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]]) + middle
    i = np.arange(count)
    j, none, top = (i + 1) % count, np.full(count, -1), len(rings) - count
    faces = [np.stack([k + i, k + j, k + j + count, k + i + count], axis=1)
             for k in range(0, top, count)]  # fmt: skip
    faces.append(np.stack([j, i, np.full(count, len(rings)), none], axis=1))
    faces.append(np.stack([top + i, top + j, np.full(count, len(rings) + 1), none], axis=1))
    return plain(points, np.concatenate(faces))


def from_pixels(setup: Setup, surfaces: list[gs.Surface]) -> tuple[Array, Array]:
    """Shares that the tables have at all pixels' centres, and that looking from there gives."""
    view = setup.view
    ids = visibility_twin(view)
    y, x = np.nonzero(ids)
    triangle = ids[y, x].astype(np.int64) - 1
    ideal, _ = undistorted(setup.view.camera, np.stack([x, y], axis=1).astype(np.float64))
    of = setup.coefficients.of(triangle)
    planes, d = of.planes, ideal - of.anchor
    values = planes[:, 2:, 0] * d[:, :1] + planes[:, 2:, 1] * d[:, 1:] + planes[:, 2:, 2]
    depth = 1.0 / (values[:, 0] * of.mean_inverse)
    at = depth[:, None] * (np.c_[ideal, np.ones(len(x))] @ setup.view.rays().T)
    normal = values[:, 1:] / np.linalg.norm(values[:, 1:], axis=1)[:, None]
    joined = JoinedFaces.of(view, surfaces)
    count = len(at)
    points = SamplePoints(
        at, normal, np.full(count, 2.0 * joined.sag), np.full(count, 20.0 * joined.sag)
    )
    hemisphere_masks = hemisphere_masks_twin(points, joined.contours.facets)
    assert setup.lighting.openness is not None
    got = setup.lighting.openness.at(triangle, at)
    return got[~hemisphere_masks.inside], hemisphere_masks.open_share[~hemisphere_masks.inside]


def test_samples_count_by_the_cosine() -> None:
    sine = 1.0 - directions()[..., 2] ** 2
    # equal shares of the squared sine, and no direction preferred
    np.testing.assert_allclose(np.sort(sine.reshape(-1)), (np.arange(2048) + 0.5) / 2048, atol=0.02)
    assert np.abs(directions()[..., :2].mean(axis=(0, 1))).max() < 2e-4
    normals = np.random.default_rng(1).normal(size=(100, 3))
    normals[:3] = [[0, 0, -1], [0, 0, 1], [1e-9, 0, -1]]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    u = tangent(normals)
    np.testing.assert_allclose(np.sum(u * normals, axis=1), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(u, axis=1), 1.0, atol=1e-12)


def test_an_endless_wall_leaves_half_and_half_the_cosine() -> None:
    errors = []
    for angle in np.linspace(0.05, 1.5, 25):
        for way in np.linspace(0.0, 6.0, 23):
            wall = np.array([[1.0, -1e4, 0], [1, 1e4, 0], [1, 1e4, 1], [1, -1e4, 1]])
            wall[:, 2] *= np.tan(angle)
            got = share(turned(wall, way)[None], np.zeros((1, 3)))[0]
            errors.append(got - 0.5 * (1.0 + np.cos(angle)))
    assert np.std(errors) < 1.2e-3
    assert np.abs(errors).max() < 6e-3


def test_a_sphere_over_a_plane_hides_the_square_of_its_sine() -> None:
    # a sphere seen as its outline: a disc square to the way to its middle
    angle = np.arange(128) * 2.0 * np.pi / 128
    errors = []
    for distance in np.linspace(1.1, 6.0, 20):
        sine = 1.0 / distance
        r = sine / np.sqrt(1.0 - sine * sine)
        ring = np.c_[r * np.cos(angle), r * np.sin(angle), np.ones(128)]
        middle = np.tile([0.0, 0.0, 1.0], (128, 1))
        faces = np.stack([middle, ring, np.roll(ring, -1, axis=0), middle], axis=1)
        errors.append(share(faces, np.zeros((1, 3)))[0] - (1.0 - sine * sine))
    assert np.abs(errors).max() < 1.5e-3


def test_plates_above_and_beside_hide_their_form_factor() -> None:
    random = np.random.default_rng(5)
    errors = []
    for k in range(200):
        size, height = random.uniform(0.2, 2.0, 2), random.uniform(0.3, 2.0)
        plate = QUAD * [*size, 0.0] + [*random.uniform(-0.5, 0.5, 2), height]
        if k % 2:  # upright, foot on the plane
            plate = np.array([[height, -size[0], 0], [height, size[0], 0],
                              [height, size[0], size[1]], [height, -size[0], size[1]]])  # fmt: skip
        plate = turned(plate, random.uniform(0.0, 6.3))
        errors.append(share(plate[None], np.zeros((1, 3)))[0] - (1.0 - form_factor(plate)))
    assert np.std(errors) < 1.3e-3
    assert np.abs(errors).max() < 6e-3


def test_faces_that_hide_each_other_count_once() -> None:
    """Against 40,000 rays a point through a heap of faces."""
    random = np.random.default_rng(2)
    middle = random.uniform(-1.0, 1.0, (60, 1, 3)) + np.array([0.0, 0.0, 1.2])
    corners = middle + random.normal(size=(60, 4, 3)) * 0.25
    corners[:, 3] = corners[:, 2]
    at = np.c_[random.uniform(-1.0, 1.0, (12, 2)), np.zeros(12)]
    got = share(corners, at)
    side = (np.arange(200) + 0.5) / 200
    s, azimuth = np.meshgrid(side, 2.0 * np.pi * side)
    ray = np.stack([np.sqrt(s) * np.cos(azimuth), np.sqrt(s) * np.sin(azimuth), np.sqrt(1.0 - s)])
    ray = ray.reshape(3, -1)
    want = []
    for point in at:
        hit = np.zeros(ray.shape[1], bool)
        for a, b, c in (corners - point)[:, :3]:
            sides = np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a)]) @ ray
            height = np.dot(np.cross(b - a, c - a), a)
            hit |= ((sides * np.sign(height)) >= 0.0).all(axis=0)
        want.append(1.0 - hit.mean())
    assert np.sqrt(np.mean((got - want) ** 2)) < 4e-3
    assert np.abs(got - want).max() < 8e-3


def test_only_contours_count_and_no_list_leaves_one_out(device: Device) -> None:
    """Of round bodies, faces one by one, their contours, and lists for points that lie together."""
    surfaces = [plain(QUAD * 1.5), ball(0.4, (0.3, 0.2, 0.5)), ball(0.2, (-0.4, 0.3, 0.15))]
    view = look(surfaces, camera(64), lit=True)
    joined = JoinedFaces.of(view, surfaces)
    random = np.random.default_rng(4)
    at = surfaces[1].points[random.integers(0, len(surfaces[1].points), 90)]
    normal = at - [0.3, 0.2, 0.5]
    at = np.concatenate(
        [np.c_[random.uniform(-1.0, 1.0, (90, 2)), np.zeros(90)], at + 0.05 * normal]
    )
    normal = np.concatenate([np.repeat(UP, 90, axis=0), normal])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    count = len(at)
    points = SamplePoints(
        at - view.camera.eye, normal, np.full(count, 2.0 * joined.sag), np.full(count, 1e-3)
    )
    points = points.part(in_groups(points))
    facets = joined.contours.facets
    corners = facets.ends[np.maximum(facets.edges, 0) // 2, facets.edges % 2]
    corners[:, 2] = np.where(facets.edges[:, 2:3] < 0, corners[:, 3], corners[:, 2])
    apart = EdgeAdjacency.apart(corners, facets.both_sides)
    want = hemisphere_masks_twin(points, apart)
    for got in (
        hemisphere_masks_twin(points, facets),
        hemisphere_masks(SilhouetteBuffers(device, joined.contours), points),
    ):
        # rounding moves a few of all samples over an edge
        wrong = np.bitwise_count(got.hidden ^ want.hidden).sum(axis=1)
        assert wrong.max() <= 3
        assert wrong.mean() < 0.02
        np.testing.assert_array_equal(got.inside, want.inside)
    assert want.open_share.min() < 0.1
    assert want.open_share.max() > 0.9


def floor_errors(frame: gs.Frame) -> tuple[Array, Array]:
    """Of a floor's pixels before an endless wall at x = 1 of height 1.5: shares less those of the
    closed form, and how far away the wall is."""
    view = frame.view
    ids = visibility_twin(view)
    y, x = np.nonzero((ids > 0) & (view.face[ids.astype(np.int64) - 1] == 0))
    ray = np.c_[x, y, np.ones(len(x))] @ view.rays().T
    eye = view.camera.eye
    place = eye - ray * (eye[2] / ray[:, 2])[:, None]
    away = 1.0 - place[:, 0]
    inner = (away > 0.0) & (np.abs(place) < 2.8).all(axis=1)
    inner[np.isin(y * view.camera.width + x, find_edge_pixels(view).pixel)] = False
    error = np.pi * frame.radiance[y, x] - 0.5 * (1.0 + away / np.hypot(away, 1.5))
    return error[inner], away[inner]


def test_a_floor_before_a_wall_is_lit_by_the_closed_form() -> None:
    floor = plain(QUAD * 3.0)
    wall = plain(np.array([[1.0, -300, 0], [1, 300, 0], [1, 300, 1.5], [1, -300, 1.5]]))
    frame = gs.render([floor, wall], camera(), EVEN, backend="numpy")
    error, away = floor_errors(frame)
    error = error[away > 0.1]
    assert len(error) > 2000
    assert error.std() < 1e-3
    assert np.abs(error).max() < 4e-3


@pytest.mark.parametrize(
    "foot", [-0.6, pytest.param(0.0, marks=pytest.mark.slow)], ids=["through", "on"]
)
def test_no_light_or_shadow_leaks_through_a_wall_in_a_floor(foot: float, device: Device) -> None:
    """Between two walls it is dark; up to the first one the floor is lit by the closed form."""
    corners = np.array([[1.0, -300, foot], [1, 300, foot], [1, 300, 1.5], [1, -300, 1.5]])
    walls = [plain(corners), plain(corners + np.array([0.12, 0.0, 0.0]))]
    surfaces = [plain(QUAD * 3.0), *walls]
    frame = gs.render(surfaces, camera(320, (-1.4, -1.6, 1.6)), EVEN, device=device)
    error, away = floor_errors(frame)
    near = away < 0.1
    print(f"{near.sum()} pixels near the wall: worst {np.abs(error[near]).max():.1e}")
    assert near.sum() > 1000
    # as with one wall; 0.37 where what is interpolated knows of the other side
    assert np.abs(error).max() < 0.015


@pytest.mark.parametrize("sunk", [0.0, 0.07])
def test_the_line_of_contact_on_one_large_face_stays_sharp(sunk: float) -> None:
    box = block((0.013, 0.008, 0.25 - sunk), (0.31, 0.22, 0.25), 0.5)
    surfaces = [plain(QUAD * 1.5), white(box)]
    setup = Setup.build(look(surfaces, camera(112), lit=True), EVEN, 0.0, surfaces)
    got, want = from_pixels(setup, surfaces)
    error = np.abs(got - want)
    assert want.min() < 0.62
    assert np.sqrt(np.mean(error**2)) < 3e-3
    assert np.quantile(error, 0.99) < 8e-3
    assert error.max() < 0.1  # at the corners of the box, where the share jumps


def test_round_bodies_and_bent_sheets_dont_hide_themselves() -> None:
    body = tube(0.4, 0.8)
    frame = gs.render([body], camera(72), EVEN, backend="numpy")
    lit = frame.radiance[visibility_twin(frame.view) > 0] * np.pi
    np.testing.assert_allclose(np.median(lit), 1.0, atol=1e-6)
    alone, _ = from_pixels(Setup.build(frame.view, EVEN, 0.0, [body]), [body])
    np.testing.assert_allclose(alone, 1.0, atol=3e-3)
    # an open sheet, bent: the hollow side sees less the deeper it is
    angle = np.linspace(-1.2, 1.2, 25)
    arc = np.stack([np.sin(angle), 0.0 * angle, 1.0 - np.cos(angle)], axis=1)
    points = np.concatenate([arc - AHEAD, arc + AHEAD])
    i = np.arange(24)
    sheet = plain(points, np.stack([i, i + 1, 26 + i, 25 + i], axis=1))
    above = look([sheet], camera(72, (0.3, -0.4, 4.0)), lit=True)
    hollow, want = from_pixels(Setup.build(above, EVEN, 0.0, [sheet]), [sheet])
    assert 0.5 < hollow.min() < 0.97
    np.testing.assert_allclose(hollow, want, atol=0.02)
    below = look([sheet], camera(72, (0.3, -0.4, -4.0)), lit=True)
    domed, _ = from_pixels(Setup.build(below, EVEN, 0.0, [sheet]), [sheet])
    np.testing.assert_allclose(domed, 1.0, atol=3e-3)


@pytest.mark.slow
def test_the_floor_under_a_ball_is_dark_but_not_black() -> None:
    """A gap thinner than the pieces isn't the inside of the body over it."""
    surfaces = [plain(QUAD * 1.5), ball(0.4, (0.0, 0.0, 0.4))]
    view = look(surfaces, camera(160, (0.2, -3.0, 0.5)), lit=True)
    got, want = from_pixels(Setup.build(view, EVEN, 0.0, surfaces), surfaces)
    error = np.abs(got - want)
    assert np.sqrt(np.mean(error**2)) < 5e-3
    assert np.quantile(error, 0.99) < 0.02


def test_surroundings_bring_what_their_visible_part_sends() -> None:
    """An upright face over an endless floor loses the ground's light and keeps the sky's."""
    floor = plain(QUAD * 400.0)
    wall = plain(QUAD[:, [0, 2, 1]] * 0.2 + [0.0, 0.0, 0.3])
    at = camera(64, (0.1, -2.4, 0.5))
    for sky, ground in ((1.0, 1.0), (1.0, 0.0), (0.4, 0.8)):
        lights: list[Light] = [gs.EnvironmentLight(sky, ground, occlusion=True)]
        setup = Setup.build(look([wall, floor], at, lit=True), lights, 0.0, [wall, floor])
        openness = setup.lighting.openness
        assert openness is not None
        middle = np.array([[0.02, 0.0, 0.31]]) - at.eye
        own = np.flatnonzero(setup.view.face == 0)[:1]
        got = openness.at(own, middle)
        np.testing.assert_allclose(got, sky / (sky + ground), atol=4e-3)
    # the same from a picture, and beside light that nothing hides
    image = np.repeat([[1.0], [0.0]], 24, axis=0).repeat(96, axis=1)
    lights = [gs.EnvironmentLight(image=image, occlusion=True), gs.AmbientLight(0.5)]
    setup = Setup.build(look([wall, floor], at, lit=True), lights, 0.0, [wall, floor])
    assert setup.lighting.openness is not None
    np.testing.assert_allclose(setup.lighting.openness.at(own, middle), 1.0, atol=0.015)


def test_both_backends_agree_through_a_lens_and_with_lamps() -> None:
    box = block((0.0, 0.0, 0.15), (0.3, 0.2, 0.15), 0.5)
    surfaces = [
        gs.Surface(QUAD * 1.5, FACE, paint=gs.paint.Checker(0.2)), box,
        gs.Surface(0.2 * QUAD + [0.5, -0.5, 0.4], FACE, paint=gs.paint.Plain(0.7, 0.5)),
    ]  # fmt: skip
    lights: list[Light] = [
        gs.AreaLight((-0.9, -1.4, 1.9), (0.0, 0.0, 0.1), (0.4, 0.4), 8.0),
        gs.EnvironmentLight(0.6, 0.2, occlusion=True),
        gs.AmbientLight(0.1, occlusion=True),
    ]
    bent = gs.Camera.from_lens(
        (36.0, 27.0), 40.0, (64, 48), (1.6, -2.4, 1.9), (0.1, 0.0, 0.1),
        distortion=[0.06, -0.02, 1e-3, 0.0],
    )  # fmt: skip
    for view in (camera(64), bent):
        device = gs.render(surfaces, view, lights).radiance
        twin = gs.render(surfaces, view, lights, backend="numpy").radiance
        # one of 2048 samples of a node may fall to the other side of an edge
        assert np.abs(device - twin).max() < 4e-3 * twin.max()
        assert np.sqrt(np.mean((device - twin) ** 2)) < 2e-4 * twin.max()


def test_it_is_absent_unless_asked_for_and_changes_nothing_in_the_open() -> None:
    surfaces = [plain(QUAD), white(block((0.0, 0.0, 0.2), (0.2, 0.2, 0.2), 0.5))]
    view = look(surfaces, camera(64), lit=True)
    off: list[Light] = [gs.AmbientLight(0.3), gs.EnvironmentLight(0.2, 0.1)]
    setup = Setup.build(view, off, 0.0, surfaces)
    assert setup.lighting.openness is None
    assert setup.lighting.constants(False)["sheltered"] == 0.0
    on: list[Light] = [gs.AmbientLight(0.3, occlusion=True), gs.EnvironmentLight(0.2, 0.1)]
    alone = surfaces[:1]
    one, two = (gs.render(alone, camera(64), lights).radiance for lights in (off, on))
    np.testing.assert_allclose(one, two, rtol=1e-6, atol=1e-8)
