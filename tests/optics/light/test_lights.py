"""Light against brute-force integration and the textbook's laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.geometry.feature_edges import sharp_normals, smooth_normals
from gpusim.optics.geometry.vertex_attributes import SurfaceNormals
from gpusim.optics.light.lights import AmbientLight
from gpusim.optics.light.quadrature import emitter_light, emitters
from gpusim.optics.shading.lighting import ambient
from gpusim.surface.surface import triangulate

Array = npt.NDArray[np.float64]
QUAD = np.array([[0, 1, 2, 3]])


def brute_force(lamp: gs.AreaLight, points: Array, normals: Array, n: int = 400) -> Array:
    """Lambert emitter, n x n midpoints: E = L integral cos cos' / d^2 dA."""
    position, target = np.array(lamp.position), np.array(lamp.target)
    axis = (target - position) / np.linalg.norm(target - position)
    up = np.array([0.0, 0, 1]) if abs(axis[2]) < 0.9 else np.array([0.0, 1, 0])
    across = np.cross(axis, up)
    across /= np.linalg.norm(across)
    along = np.cross(across, axis)
    g = (np.arange(n) + 0.5) / n - 0.5
    x, y = np.meshgrid(g * lamp.size[0], g * lamp.size[1])
    at = position + x.reshape(-1, 1) * across + y.reshape(-1, 1) * along
    radiance = lamp.power / (np.pi * lamp.size[0] * lamp.size[1])
    cell = lamp.size[0] * lamp.size[1] / n**2
    result = np.zeros(len(points))
    for i, (point, normal) in enumerate(zip(points, normals, strict=True)):
        to = at - point
        square = np.sum(to**2, axis=1)
        cosines = np.maximum(to @ normal, 0.0) * np.maximum(-(to @ axis), 0.0) / square
        result[i] = radiance * cell * np.sum(cosines / square)
    return result


def irradiance(table: Array, points: Array, normals: Array) -> Array:
    """Of every emitter (N, E)."""
    return np.stack([emitter_light(row, points, normals)[0] for row in table], axis=1)


@pytest.mark.parametrize("size", [(0.02, 0.03), (0.2, 0.1), (0.5, 0.7), (1.2, 0.9)])
def test_area_lights_equal_brute_force(size: tuple[float, float]) -> None:
    lamp = gs.AreaLight((0.3, -1.0, 0.4), (0.1, 0.0, -0.1), size, 60.0)
    points = np.random.default_rng(4).uniform([-1, 0, -1], [1, 0.5, 1], (20, 3))
    normals = np.random.default_rng(5).normal(size=(20, 3)) * 0.3 + [0.0, -1.0, 0.0]
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    # the lamp must be above the horizon with all its face: a cut one has a kink
    to = np.array(lamp.position) - points
    above = np.sum(to * normals, axis=1) > 0.5 * np.hypot(*size)
    above &= to @ (np.array(lamp.target) - lamp.position) < -0.5 * np.hypot(*size)
    points, normals = points[above], normals[above]
    assert len(points) >= 10
    got = irradiance(emitters([lamp], points), points, normals).sum(axis=1)
    want = brute_force(lamp, points, normals)
    print(
        f"lamp {size}: {len(emitters([lamp], points))} emitters, {np.abs(got / want - 1).max():.1e}"
    )
    assert np.abs(got / want - 1.0).max() < 1e-4


def test_a_lamp_close_to_the_middle_of_a_wall() -> None:
    """The wall's corners are far away, but the wall isn't: its nearest point decides."""
    lamp = gs.AreaLight((0.0, -0.5, 0.0), (0.0, 0.0, 0.0), (0.4, 0.3), 60.0)
    wall = gs.Surface(
        np.array([[-4.0, 0, -4], [4, 0, -4], [4, 0, 4], [-4, 0, 4]]), QUAD, paint=gs.paint.Plain(1)
    )
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), (0.2, -3.0, 0.1), (0, 0, 0))
    frame = gs.render([wall], view, [lamp], backend="numpy")
    truth = frame.truth()
    middle = np.flatnonzero((truth.row == 17) & (np.abs(truth.column - 28) < 6))
    want = brute_force(lamp, truth.reference[middle], truth.normal[middle]) / np.pi
    got = frame.radiance[truth.row[middle], truth.column[middle]]
    print(f"near the wall: {np.abs(got / want - 1).max():.1e}")
    assert np.abs(got / want - 1.0).max() < 1e-4


def test_point_lights_inverse_square_and_cosine() -> None:
    table = emitters([gs.PointLight((0.0, 0.0, 0.0), 4.0 * np.pi)], np.ones((1, 3)))
    distance = np.array([0.5, 1.0, 2.0, 8.0])
    points = distance[:, None] * [0.0, 1.0, 0.0]
    facing = np.tile([0.0, -1.0, 0.0], (4, 1))
    np.testing.assert_allclose(irradiance(table, points, facing)[:, 0], distance**-2, rtol=1e-14)
    angles = np.radians([0.0, 30.0, 60.0, 89.0, 91.0, 180.0])
    normals = np.stack([np.sin(angles), -np.cos(angles), 0 * angles], axis=1)
    got = irradiance(table, np.tile([0.0, 2.0, 0.0], (6, 1)), normals).sum(axis=1)
    np.testing.assert_allclose(got, np.maximum(np.cos(angles), 0.0) / 4.0, atol=1e-16)


def test_an_area_light_emits_its_power_forwards_only() -> None:
    """Irradiance over a hemisphere around a small lamp adds up to its power."""
    lamp = gs.AreaLight((0.0, 0.0, 0.0), (1.0, 2.0, -1.0), (0.01, 0.02), 7.0)
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    mu, phi = np.meshgrid((np.arange(200) + 0.5) / 200, (np.arange(8) + 0.5) / 4 * np.pi)
    across = np.cross(axis, [0.0, 0, 1]) / np.linalg.norm(np.cross(axis, [0.0, 0, 1]))
    ring = np.sqrt(1 - mu**2)[..., None]
    points = 3.0 * (
        mu[..., None] * axis
        + ring * (np.cos(phi)[..., None] * across + np.sin(phi)[..., None] * np.cross(axis, across))
    ).reshape(-1, 3)
    table = emitters([lamp], points)
    total = irradiance(table, points, -points / 3.0).sum(axis=1).mean() * 2 * np.pi * 9.0
    assert total == pytest.approx(7.0, rel=1e-4)
    assert irradiance(table, -points, points / 3.0).max() == 0.0


def test_surroundings_light_every_face_alike(device: Device) -> None:
    assert ambient([AmbientLight(0.2), AmbientLight(0.1)]) == pytest.approx(0.3 * np.pi)
    surface = gs.Surface(
        np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]),
        QUAD,
        paint=gs.paint.Plain(0.4),
    )
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), (0.2, -1.0, 0.1), (0, 0, 0))
    for backend in ("gpu", "numpy"):
        image = gs.render([surface], view, [AmbientLight(0.5)], device=device, backend=backend)
        np.testing.assert_allclose(image.radiance, 0.4 * 0.5, rtol=1e-6)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_radiance_of_a_lit_plate(device: Device, backend: str) -> None:
    """albedo x irradiance / pi at every pixel; unlit it is the albedo itself."""
    surface = gs.Surface(
        np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]]),
        QUAD,
        paint=gs.paint.Plain(0.4),
    )
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), (0.2, -1.0, 0.1), (0, 0, 0))
    unlit = gs.render([surface], view, device=device, backend=backend)
    np.testing.assert_allclose(unlit.radiance, 0.4, rtol=1e-6)
    lamp = np.array([0.4, -0.9, 0.5])
    frame = gs.render([surface], view, [gs.PointLight(tuple(lamp), 30.0)], device=device,
                      backend=backend)  # fmt: skip
    truth = frame.truth()
    to = lamp - truth.reference
    square = np.sum(to**2, axis=1)
    want = 0.4 / np.pi * 30.0 / (4 * np.pi) * -to[:, 1] / square**1.5
    got = frame.radiance[truth.row, truth.column]
    assert len(got) == 57 * 33
    np.testing.assert_allclose(got, want, rtol=2e-5)


def prism(sides: int) -> gs.Surface:
    """A closed prism around z, radius 0.3, height 0.8."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = 0.3 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    points = np.concatenate([ring - np.array([0, 0, 0.4]), ring + np.array([0, 0, 0.4])])
    points = np.concatenate([points, [[0, 0, -0.4], [0, 0, 0.4]]])
    i = np.arange(sides)
    j = (i + 1) % sides
    mantle = np.stack([i, j, sides + j, sides + i], axis=1)
    caps = [np.stack([2 * sides + 0 * i, j, i, -1 + 0 * i], axis=1),
            np.stack([2 * sides + 1 + 0 * i, sides + i, sides + j, -1 + 0 * i], 1)]  # fmt: skip
    return gs.Surface(points, np.concatenate([mantle, *caps]), paint=gs.paint.Plain(0.5))


def test_normals_are_smooth_on_a_cylinder_and_sharp_on_a_box() -> None:
    for sides, smooth in ((24, True), (4, False)):
        surface = prism(sides)
        triangles, source = triangulate(surface.faces)
        area = SurfaceNormals(surface).area
        angle = surface.smooth_angle
        mean, sharp = smooth_normals(area, triangles, len(surface.points), angle)
        normals = mean.T[triangles]
        own, corner = np.nonzero(sharp[triangles])
        normals[own, corner] = sharp_normals(
            area, triangles, sharp, own, triangles[own, corner], angle
        )
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-12)
        mantle = source < sides
        at = surface.points[triangles[mantle]]
        radial = at * [1.0, 1.0, 0.0] / 0.3
        off = np.arccos(np.clip(np.sum(normals[mantle] * radial, axis=2), -1, 1))
        if smooth:  # the two triangles of a quadrilateral weigh alike: 1/6 of the angle at most
            assert np.degrees(off.max()) < 360 / sides / 5
        else:
            np.testing.assert_allclose(np.degrees(off), 45.0, atol=1e-6)
        np.testing.assert_allclose(normals[~mantle][..., 2] ** 2, 1.0, atol=1e-12)  # caps: flat


def test_a_coarse_cylinder_is_shaded_without_facets(device: Device) -> None:
    view = gs.Camera.from_lens((36, 24), 30, (121, 67), (0.0, -1.5, 0.0), (0, 0, 0))
    lamp = [gs.PointLight((40.0, -60.0, 0.0), 1e6)]

    def row(sides: int) -> Array:
        image = gs.render([prism(sides)], view, lamp, device=device).radiance
        return image[33, 45:76].astype(float)

    fine, coarse = row(240), row(24)
    boxes = gs.render([prism(4)], view, lamp, device=device).radiance[33]
    assert np.abs(coarse / fine - 1.0).max() < 0.035
    assert np.abs(np.diff(coarse, 2)).max() < 4.0 * np.abs(np.diff(fine, 2)).max() + 1e-4
    jumps = np.abs(np.diff(boxes[boxes > 0]))
    assert jumps.max() > 20 * np.median(jumps)


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: gs.PointLight((0, 0, 0), 0.0), "power"),
        (lambda: gs.PointLight((0, 0, 0), np.nan), "power"),
        (lambda: gs.PointLight((0, np.inf, 0), 1.0), "three finite"),
        (lambda: gs.PointLight((0, 0), 1.0), "three finite"),  # type: ignore[arg-type]
        (lambda: gs.AreaLight((0, 0, 0), (0, 0, 0), (1, 1), 1.0), "target"),
        (lambda: gs.AreaLight((0, 0, 0), (0, 0, 1), (1, 0), 1.0), "size"),
        (lambda: gs.AreaLight((0, 0, 0), (0, np.nan, 1), (1, 1), 1.0), "three finite"),
        (lambda: gs.AreaLight((0, 0, 0), (0, 0, 1), (1,), 1.0), "size"),  # type: ignore[arg-type]
        (lambda: gs.AreaLight((0, 0, 0), (0, 0, 1), (1, 1, 1), 1.0), "size"),  # type: ignore[arg-type]
        (lambda: AmbientLight(-0.1), "AmbientLight radiance; got -0.1"),
    ],
)
def test_lights_that_cannot_be(make: Callable[[], object], part: str) -> None:
    with pytest.raises(InputError, match=part):
        make()


def test_too_many_emitting_points_are_refused() -> None:
    surface = gs.Surface(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]), QUAD)
    view = gs.Camera.from_lens((36, 24), 30, (57, 33), (0.5, -1, 0.5), (0.5, 0, 0.5))
    lamps = [gs.AreaLight((0.5, -0.2 - 0.01 * k, 0.5), (0, 0, 0), (1, 1), 1.0) for k in range(5)]
    with pytest.raises(InputError, match=r"emitting points.*at most 256"):
        gs.render([surface], view, lamps, backend="numpy")


@pytest.mark.parametrize("backend", ["numpy", "auto"])
def test_lamps_without_shadows_count_as_none_that_cast_them(backend: str) -> None:
    surface = gs.Surface(np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]), QUAD)
    post = gs.Surface(surface.points * 0.2 + (0.4, -0.1, 0.4), QUAD)
    view = gs.Camera.from_lens((36, 24), 30, (19, 11), (0.5, -1, 0.5), (0.5, 0, 0.5))
    plain = [gs.PointLight((0.02 * k, -0.5, 0.9), 1.0, shadows=False) for k in range(40)]
    casting = [gs.PointLight((0.02 * k, -0.5, 0.9), 1.0) for k in range(33)]

    def radiance(lights: list[gs.PointLight]) -> Array:
        return np.asarray(gs.render([surface, post], view, lights, backend=backend).radiance)

    # each by itself, and all at once
    want = sum(radiance([light]) for light in (*plain[::8], *casting[::8]))
    np.testing.assert_allclose(radiance([*plain[::8], *casting[::8]]), want, rtol=2e-4)
    cast = radiance(casting[:32])
    lit = radiance([*plain, *casting[:32]])
    np.testing.assert_allclose(lit, radiance(plain) + cast, rtol=2e-4)
    assert cast.sum() < 0.99 * radiance(plain[:32]).sum()
    with pytest.raises(InputError, match=r"got 33 lamps that cast shadows; expected at most 32.*"
                                         r"shadows"):  # fmt: skip
        radiance([*plain, *casting])


def test_what_isnt_a_truth_value_is_refused() -> None:
    with pytest.raises(InputError, match="occlusion"):
        gs.AmbientLight(0.3, occlusion="yes")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="occlusion"):
        gs.EnvironmentLight(0.3, 0.1, occlusion=2)  # type: ignore[arg-type]
