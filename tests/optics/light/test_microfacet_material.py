"""Glossy paint against its definition: hemispheres and lamps integrated by brute force."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.light.environment import Environment
from gpusim.optics.light.microfacet_material import SAMPLES, reflectance_table
from gpusim.optics.shadow import sample_mask
from gpusim.twin_checks.scenes import shadow_scene

Array = npt.NDArray[np.float64]
QUAD = np.array([[0, 1, 2, 3]])


def ggx(roughness: float, albedo: float, metallic: float, n: Array, v: Array, w: Array) -> Array:
    """The coat's BRDF for light directions w (k, 3), from the papers' formulas."""
    a2 = roughness**4
    h = w + v
    h = h / np.linalg.norm(h, axis=1)[:, None]
    nh, nl, nv, vh = h @ n, w @ n, v @ n, h @ v
    d = a2 / (np.pi * ((a2 - 1.0) * nh**2 + 1.0) ** 2)

    def smith(c: Array) -> Array:
        return 0.5 * (np.sqrt(1.0 + a2 * (1.0 / c**2 - 1.0)) - 1.0)

    g = 1.0 / (1.0 + smith(nl) + smith(np.full_like(nl, nv)))
    f0 = 0.04 * (1.0 - metallic) + albedo * metallic
    f = f0 + (1.0 - f0) * (1.0 - vh) ** 5
    return np.asarray(d * g * f / (4.0 * nl * nv))


def hemisphere(n: int) -> tuple[Array, Array]:
    """Directions with z > 0 and their solid angles."""
    z = (np.arange(n) + 0.5) / n
    phi = 2.0 * np.pi * (np.arange(2 * n) + 0.5) / (2 * n)
    zz, pp = (q.reshape(-1) for q in np.meshgrid(z, phi))
    s = np.sqrt(1.0 - zz**2)
    return np.stack([s * np.cos(pp), s * np.sin(pp), zz], 1), np.full(len(zz), np.pi / n**2)


@pytest.mark.parametrize("roughness", [0.35, 0.6, 0.95])
def test_reflectance_tables_equal_integrals(roughness: float) -> None:
    directions, weight = hemisphere(400)
    table = reflectance_table(roughness**2)
    normal = np.array([0.0, 0.0, 1.0])
    for k in (4, 20, 55):
        mu = (k + 0.5) / SAMPLES
        view = np.array([np.sqrt(1.0 - mu * mu), 0.0, mu])
        for f0 in (0.0, 1.0):
            brdf = ggx(roughness, f0, 1.0, normal, view, directions)
            want = np.sum(brdf * directions[:, 2] * weight)
            assert f0 * table[k, 0] + table[k, 1] == pytest.approx(want, abs=4e-3)
    assert (table.sum(axis=1) <= 1.0).all()  # never more than what falls on it


def plate(paint: gs.paint.Plain) -> gs.Surface:
    points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return gs.Surface(points, QUAD, paint=paint)


@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_highlights_of_an_area_lamp(device: Device, metallic: float, backend: str) -> None:
    """Radiance of a glossy plate under a lamp: its face divided into 120 x 120 pieces."""
    roughness, albedo = 0.4, 0.6
    camera = gs.Camera.from_lens((36, 24), 30, (37, 25), (0.3, -1.2, 0.7), (0, 0, 0))
    lamp = gs.AreaLight((-0.3, 0.9, 0.7), (0, 0, 0), (0.3, 0.2), 10.0)
    frame = gs.render([plate(gs.paint.Plain(albedo, roughness, metallic))], camera, [lamp],
                      device=device, backend=backend)  # fmt: skip
    truth = frame.truth()
    axis = -np.array([-0.3, 0.9, 0.7])
    axis /= np.linalg.norm(axis)
    across = np.cross(axis, [0, 0, 1])
    across /= np.linalg.norm(across)
    along = np.cross(across, axis)
    g = (np.arange(120) + 0.5) / 120 - 0.5
    x, y = (q.reshape(-1, 1) for q in np.meshgrid(0.3 * g, 0.2 * g))
    face = np.array([-0.3, 0.9, 0.7]) + x * across + y * along
    n = np.array([0.0, 0.0, 1.0])
    inner = np.flatnonzero((np.abs(truth.reference[:, :2]) < 0.7).all(axis=1))[::31]
    table = reflectance_table(roughness**2)
    worst = 0.0
    for i in inner:
        at = truth.reference[i]
        to = face - at
        far = np.linalg.norm(to, axis=1)
        w = to / far[:, None]
        light = 10.0 / (np.pi * len(face)) * np.maximum(-(w @ axis), 0.0) * (w @ n) / far**2
        v = camera.eye - at
        v /= np.linalg.norm(v)
        want = np.sum(ggx(roughness, albedo, metallic, n, v, w) * light)
        nodes = (np.arange(SAMPLES) + 0.5) / SAMPLES
        a, b = (np.interp(v[2], nodes, table[:, k]) for k in (0, 1))
        want += (1 - metallic) * albedo / np.pi * np.sum(light) * (1.0 - 0.04 * a - b)
        got = float(frame.radiance[truth.row[i], truth.column[i]])
        worst = max(worst, abs(got / want - 1.0))
    print(f"metallic {metallic}, {backend}: {len(inner)} pixels, worst {worst:.1e}")
    assert len(inner) > 10 and worst < 3e-3


def test_even_surroundings_are_mirrored_by_metal() -> None:
    """In a room of radiance 1 everywhere, metal of albedo 1 sends back its reflectance."""
    camera = gs.Camera.from_lens((36, 24), 30, (37, 25), (0.3, -1.2, 0.5), (0, 0, 0))
    metal = plate(gs.paint.Plain(1.0, 0.4, 1.0))
    frames = [
        gs.render([metal], camera, [light], backend="numpy")
        for light in (gs.AmbientLight(1.0), gs.EnvironmentLight(1.0, 1.0),
                      gs.EnvironmentLight(image=np.ones((6, 10))))
    ]  # fmt: skip
    truth = frames[0].truth()
    v = camera.eye - truth.reference
    mu = v[:, 2] / np.linalg.norm(v, axis=1)
    table = reflectance_table(0.16).sum(axis=1)
    want = np.interp(mu, (np.arange(SAMPLES) + 0.5) / SAMPLES, table)
    inner = (np.abs(truth.reference[:, :2]) < 0.7).all(axis=1)
    for frame in frames:
        got = frame.radiance[truth.row, truth.column]
        np.testing.assert_allclose(got[inner], want[inner], rtol=1e-5)


def test_irradiance_of_surroundings() -> None:
    """Sky and ground in closed form, an image by integration over all directions."""
    up = np.array([0.2, -0.4, 1.0]) / np.linalg.norm([0.2, -0.4, 1.0])
    normal = np.random.default_rng(3).normal(size=(40, 3))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    sky = Environment.of([gs.EnvironmentLight(0.8, 0.3, up=tuple(up))])
    assert sky is not None
    c = normal @ up
    np.testing.assert_allclose(
        sky.diffuse(normal), 0.5 * np.pi * (0.8 * (1 + c) + 0.3 * (1 - c)), rtol=1e-12
    )
    rows, columns = (np.arange(64) + 0.5) / 64 * np.pi, (np.arange(128) + 0.5) / 64 * np.pi
    theta, phi = np.meshgrid(rows, columns, indexing="ij")
    # azimuth 0 is the middle column, forward; columns run to the right
    d = np.stack([-np.sin(theta) * np.sin(phi), -np.sin(theta) * np.cos(phi), np.cos(theta)], -1)
    image = 1.0 + 0.5 * d[..., 0] + 0.3 * d[..., 1] + 0.4 * d[..., 2] ** 2
    around = Environment.of([gs.EnvironmentLight(image=image)])
    assert around is not None
    weight = (np.pi / 64) ** 2 * np.sin(theta)
    flat = d.reshape(-1, 3)
    want = np.maximum(normal @ flat.T, 0.0) @ (image * weight).reshape(-1)
    np.testing.assert_allclose(around.diffuse(normal), want, rtol=5e-3)
    # and a mirror shows what lies in its direction
    maps = around.blurred(0.02)[None]
    seen = around.mirrored(maps, np.zeros(40, np.int32), normal)
    wanted = 1.0 + 0.5 * normal[:, 0] + 0.3 * normal[:, 1] + 0.4 * normal[:, 2] ** 2
    np.testing.assert_allclose(seen, wanted, atol=0.03)


def test_prints_on_metal_stay_matte(device: Device) -> None:
    """A marker on steel: its squares are those on matte paint, the steel around it mirrors."""
    camera = gs.Camera.from_lens((36, 24), 30, (75, 51), (0.3, -0.9, 1.4), (0, 0, 0))
    lights = [gs.AreaLight((-0.3, 1.2, 0.9), (0, 0, 0), (0.3, 0.2), 10.0), gs.AmbientLight(0.4)]
    images = {}
    for finish in ((1.0, 0.0), (0.4, 1.0)):
        paint = gs.paint.Markers(np.array([[1.0, 1.0]]), 0.6, ground=0.5, roughness=finish[0],
                                 metallic=finish[1])  # fmt: skip
        points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
        surface = gs.Surface(points, QUAD, paint=paint)
        images[finish] = [
            gs.render([surface], camera, lights, device=device, backend=backend)
            for backend in ("gpu", "numpy")
        ]
        np.testing.assert_allclose(
            images[finish][0].radiance, images[finish][1].radiance, atol=3e-4
        )
    truth = images[1.0, 0.0][0].truth()
    matte, steel = (images[k][1].radiance[truth.row, truth.column] for k in images)
    inside = (np.abs(truth.reference[:, :2]) < 0.27).all(axis=1)
    outside = (np.abs(truth.reference[:, :2]) > 0.33).any(axis=1)
    assert inside.sum() > 30 and outside.sum() > 300
    np.testing.assert_allclose(steel[inside], matte[inside], rtol=1e-6)
    assert np.abs(steel[outside] / matte[outside] - 1.0).min() > 1e-4


def test_a_scene_of_every_kind_on_both_backends(device: Device) -> None:
    surfaces, full, lights = shadow_scene()
    # half of the resolution
    K = np.diag([0.5, 0.5, 1.0]) @ full.K
    K[:2, 2] -= 0.25
    size = full.width // 2, full.height // 2
    camera = gs.Camera(*size, K, full.distortion, full.camera_from_world)
    image = np.random.default_rng(0).uniform(0.0, 1.0, (5, 9))
    point = lights[2]
    for lit_by in (
        lights,
        [point, gs.EnvironmentLight(0.8, 0.2)],
        [point, gs.EnvironmentLight(image=image)],
    ):
        both = [
            gs.render(surfaces, camera, lit_by, device=device, backend=backend).radiance
            for backend in ("gpu", "numpy")
        ]
        # float32, and now and then a sample that falls to the other side of an edge
        np.testing.assert_allclose(
            both[0], both[1], atol=2.5 / sample_mask.SAMPLES * float(both[1].max())
        )
        assert np.abs(both[0] - both[1]).mean() < 2e-5


@pytest.mark.parametrize(
    ("make", "part"),
    [
        (lambda: gs.paint.Plain(0.5, roughness=1.2), "roughness; got 1.2"),
        (lambda: gs.paint.Plain(0.5, metallic=np.nan), "metallic; got nan"),
        (lambda: gs.paint.Checker(0.1, roughness=-0.1), "Checker roughness"),
        (lambda: gs.EnvironmentLight(-1.0), "sky; got -1.0"),
        (lambda: gs.EnvironmentLight(image=np.zeros(3)), "image; got shape"),
        (lambda: gs.EnvironmentLight(image=-np.ones((2, 2))), "image; got -1.0"),
        (lambda: gs.EnvironmentLight(1.0, forward=(0, 0, 2)), "up; got"),
        (lambda: gs.SpotLight((0, 0, 0), (0, 0, 1), 1.0, cone=4.0), "cone; got 4.0"),
        (lambda: gs.SpotLight((0, 0, 0), (0, 0, 1), 1.0, penumbra=2.0), "penumbra; got 2.0"),
        (lambda: gs.SunLight((0, 0, 0), 1.0), "direction; got"),
        (lambda: gs.SunLight((0, 0, 1), 1.0, diameter=1.0), "diameter; got 1.0"),
        (
            lambda: gs.AreaLight((0, 0, 0), (0, 0, 1), (1, 1), 1.0, shape="star"),
            "shape; got 'star'",
        ),
    ],
)
def test_what_cannot_be(make: Callable[[], object], part: str) -> None:
    with pytest.raises(InputError, match=part):
        make()


def test_two_environments_are_refused() -> None:
    camera = gs.Camera.from_lens((36, 24), 30, (7, 5), (0.3, -1.2, 0.5), (0, 0, 0))
    lights = [gs.EnvironmentLight(1.0), gs.EnvironmentLight(0.5)]
    with pytest.raises(InputError, match="at most one"):
        gs.render([plate(gs.paint.Plain(0.5))], camera, lights, backend="numpy")
