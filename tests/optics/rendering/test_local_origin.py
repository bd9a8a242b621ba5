"""Pictures and truth don't depend on where the world's zero is, nor on the unit of length."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.light.lights import AreaLight, Light, PointLight, SpotLight
from gpusim.optics.rendering.local_origin import origin_near
from gpusim.optics.truth import seen_in
from gpusim.twin_checks.scenes import shadow_scene

Array = npt.NDArray[np.float64]

UTM = np.array([5e5, 5.2e6, 300.0])
K = [[150.0, 0, 19.5], [0, 150.0, 19.5], [0, 0, 1]]
CUBE = np.array(
    [[-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
     [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]], float,
)  # fmt: skip
SIDES = [[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]]


def moved(
    surfaces: list[gs.Surface], camera: gs.Camera, lights: list[Light] | None, by: Array
) -> tuple[list[gs.Surface], gs.Camera, list[Light] | None]:
    """The same scene elsewhere; paint frames are found anew where none were given."""

    def at(place: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = np.asarray(place) + by
        return float(x), float(y), float(z)

    def light(one: Light) -> Light:
        if isinstance(one, PointLight):
            return replace(one, position=at(one.position))
        if isinstance(one, SpotLight | AreaLight):
            return replace(one, position=at(one.position), target=at(one.target))
        return one

    pose = camera.camera_from_world.copy()
    pose[:3, 3] -= pose[:3, :3] @ by
    return (
        [replace(s, points=s.points + by, reference=s.rest + by) for s in surfaces],
        replace(camera, camera_from_world=pose),
        None if lights is None else [light(one) for one in lights],
    )


def thin_box(
    thick: float, unit: float = 1.0, at: Array | None = None
) -> tuple[list[gs.Surface], gs.Camera]:
    """A box of 0.2 x 0.2 units 1 unit before the camera."""
    points = unit * (CUBE * [0.1, 0.1, 0.5 * thick] + [0.0, 0.0, 1.0 + 0.5 * thick])
    camera = gs.Camera(40, 40, K)
    return moved([gs.Surface(points, SIDES, gs.paint.Plain(0.8))], camera, None,
                 np.zeros(3) if at is None else at)[:2]  # fmt: skip


def lit_by(lamp: Array, power: float, unit: float) -> Array:
    """(28, 28): radiance of the box's front under a point lamp, at the pixels' centres."""
    y, x = (np.mgrid[6:34, 6:34] - 19.5) / 150.0
    way = lamp - np.stack([x, y, np.ones_like(x)], axis=-1)
    square = np.sum(way**2, axis=-1)
    cosine = -way[..., 2] / np.sqrt(square)
    result: Array = 0.8 / np.pi * power / (4.0 * np.pi) * cosine / (square * unit**2)
    return result


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), (1e4, 0.0, 0.0), tuple(UTM)])
def test_shadows_are_the_same_anywhere(offset: tuple[float, ...], backend: str) -> None:
    at, lamp = np.array(offset), np.array([0.5, -0.2, 0.1])
    (box,), camera = thin_box(1e-3, at=at)
    light = PointLight(position=tuple(float(v) for v in lamp + at), power=40.0)
    image = gs.render([box], camera, [light], backend=backend).radiance
    np.testing.assert_allclose(image[6:34, 6:34], lit_by(lamp, 40.0, 1.0), rtol=2e-6)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
@pytest.mark.parametrize(
    ("thick", "unit", "far"),
    [(1e-7, 1.0, 1.0), (1e-8, 1.0, 1.0), (1e-7, 1e-6, 1.0), (1e-7, 1e4, 1.0), (1e-7, 1.0, 1e6),
     (1e-3, 1.0, 1e-2)],
)  # fmt: skip
def test_a_thin_body_does_not_hide_its_own_lamp(
    thick: float, unit: float, far: float, backend: str
) -> None:
    """In mum and 10 km as in m; by a lamp nearly on it and one beyond the moon."""
    lamp = np.array([0.3, 0.0, 0.0])
    lamp[2] = 1.0 - far
    surfaces, camera = thin_box(thick, unit)
    power = 40.0 * unit**2 * max(far, 1e-2) ** 2
    light = PointLight(position=tuple(float(v) for v in unit * lamp), power=power)
    image = gs.render(surfaces, camera, [light], backend=backend).radiance
    np.testing.assert_allclose(image[6:34, 6:34], lit_by(lamp, power, unit), rtol=1e-4)
    if far == 1.0 and thick == 1e-7:
        assert image[20, 20] == pytest.approx(0.7125, abs=2e-3)


@pytest.mark.parametrize("lit", [True, False])
def test_a_scene_with_every_kind_of_lamp_is_the_same_anywhere(lit: bool, device: Device) -> None:
    """Its picture, its truth, and which points are seen."""
    surfaces, camera, lamps = shadow_scene()
    lights: list[Light] | None = list(lamps) if lit else None
    here = gs.render(surfaces, camera, lights, device=device)
    there = gs.render(*moved(surfaces, camera, lights, UTM), device=device)
    off = np.abs(there.radiance - here.radiance)
    # a sample of a lamp's 512 may be told the other way
    assert np.quantile(off, 0.999) <= 1e-5 * here.radiance.max()
    assert off.max() <= 2e-3 * here.radiance.max()
    a, b = here.truth(), there.truth()
    assert np.array_equal(a.row, b.row) and np.array_equal(a.face, b.face)
    np.testing.assert_allclose(b.reference - UTM, a.reference, atol=2e-8)
    np.testing.assert_allclose(b.displacement, a.displacement, atol=5e-9)
    np.testing.assert_allclose(b.depth, a.depth, atol=2e-8)
    np.testing.assert_allclose(b.flow, a.flow, atol=1e-5)
    np.testing.assert_allclose(b.normal, a.normal, atol=1e-8)
    some = slice(None, None, 41)
    assert seen_in(there.view, there.ids(), b.reference[some]).all()


def test_depth_of_field_and_a_moving_scene_are_the_same_anywhere(device: Device) -> None:
    surfaces, camera = thin_box(0.05)
    lens = gs.Lens(f_number=2.0, focal_length=0.02, focus_distance=0.7, positions=8)
    shutter = gs.Shutter(exposure_time=1e-3, line_time=1e-5, samples=2)
    images = []
    for by in (np.zeros(3), UTM):
        (box,), whence, _ = moved(surfaces, camera, None, by)

        def at(time: float, box: gs.Surface = box) -> list[gs.Surface]:
            return [box.moved(box.rest + time * np.array([0.5, 2.0, 0.0]))]

        frame = gs.photograph(at, whence, lens=lens, shutter=shutter, device=device)
        images.append(frame.radiance)
        assert np.nanmin(frame.truth().depth) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(images[1], images[0], atol=1e-5)


def test_ambient_light_under_a_body_is_the_same_anywhere() -> None:
    floor = gs.Surface(
        np.array([[-1.0, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]]), [[0, 3, 2, 1]],
        gs.paint.Plain(0.7),
    )  # fmt: skip
    box = gs.Surface(CUBE * 0.2 + [0.1, 0.0, 1.8], SIDES, gs.paint.Plain(0.4))
    lights: list[Light] = [gs.AmbientLight(1.0, occlusion=True)]
    camera = gs.Camera(16, 16, [[12.0, 0, 7.5], [0, 12.0, 7.5], [0, 0, 1]])
    scenes = ([floor, box], camera, lights), moved([floor, box], camera, lights, UTM)
    here, there = (gs.render(*scene, backend="numpy").radiance for scene in scenes)
    assert np.ptp(here[6:10, 3:13]) > 0.1
    np.testing.assert_allclose(there, here, atol=1e-5)


def test_a_lone_triangle_casts_a_shadow() -> None:
    """It has no fourth edge, and no other face of its own to tell of one."""
    floor = gs.Surface(
        np.array([[-1.0, -1, 2], [1, -1, 2], [1, 1, 2], [-1, 1, 2]]), [[0, 3, 2, 1]],
        gs.paint.Plain(0.7),
    )  # fmt: skip
    sail = gs.Surface(
        np.array([[-0.1, -0.1, 1.5], [0.15, -0.1, 1.5], [0.0, 0.2, 1.5]]), [[0, 2, 1]],
        gs.paint.Plain(0.2),
    )  # fmt: skip
    camera = gs.Camera(40, 40, [[30.0, 0, 19.5], [0, 30.0, 19.5], [0, 0, 1]])
    light = PointLight(position=(0.6, 0.0, 0.5), power=40.0)
    image = gs.render([floor, sail], camera, [light], backend="numpy").radiance
    # the ray from the lamp through the middle of the sail meets the floor at x = -0.28
    assert image[20, round(19.5 - 30.0 * 0.28 / 2.0)] <= 1e-6
    assert image[20, 30] > 0.1


def test_an_origin_is_near_what_it_is_of() -> None:
    """And exact: nothing is rounded where it is subtracted."""
    points = CUBE * [0.3, 0.2, 0.1] + [3.0, -1.0, 0.5]
    assert not origin_near([CUBE * 0.5]).any()
    far = points + UTM
    origin = origin_near([far])
    assert np.abs(far - origin).max() <= 9.0 * np.ptp(far, axis=0).max()
    exact = [[float.fromhex(v.hex()) for v in row] for row in far - origin]
    assert np.array_equal(np.array(exact) + origin, far)
