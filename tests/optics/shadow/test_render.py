"""Frames lit by `gpusim.optics.shadow`, the device's against NumPy's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.camera.pinhole import Camera
from gpusim.optics.light.lights import AreaLight, Light, PointLight, SpotLight, SunLight
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.twin_checks.scenes import shadow_scene
from tests.support.shadow_rays import box, sheet

Image = npt.NDArray[np.float32]

LAMPS: dict[str, Light] = {
    "area": AreaLight((-0.9, -0.4, 0.9), (0.0, 0.0, 0.1), (0.22, 0.13), 8.0),
    "disc": AreaLight((0.2, 0.9, 0.8), (0.0, 0.0, 0.0), (0.2, 0.2), 4.0, shape="ellipse"),
    "point": PointLight((0.8, -0.6, 0.9), 6.0),
    "spot": SpotLight((-0.2, -0.8, 1.1), (0.0, 0.1, 0.0), 3.0, cone=0.6),
    "sun": SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.05),
}

TOLERANCE = 2.5 / SAMPLES
"""One or two samples of a lamp may fall to the other side of an outline."""


def shown(
    surfaces: Sequence[gs.Surface],
    camera: Camera,
    lights: Sequence[Light],
    device: Device | None = None,
) -> Image:
    """A frame by the device, or by NumPy without one."""
    backend = "numpy" if device is None else "gpu"
    return gs.render(surfaces, camera, lights, device=device, backend=backend).radiance


def differ(got: Image, want: Image, most: float = TOLERANCE, rms: float = 1e-3) -> None:
    """Both are alike relative to white."""
    difference = np.abs(got.astype(np.float64) - want) / float(want.max())
    assert np.isfinite(difference).all()
    assert difference.max() <= most
    assert np.sqrt(np.mean(difference**2)) <= rms


def matte(surfaces: Sequence[gs.Surface]) -> list[gs.Surface]:
    return [surfaces[0], *(replace(own, paint=gs.paint.Plain(0.6)) for own in surfaces[1:])]


SMALL = Camera.from_lens((36.0, 24.0), 30.0, (79, 55), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))


@pytest.mark.parametrize("kind", LAMPS)
@pytest.mark.parametrize("size", ["small", pytest.param("large", marks=pytest.mark.slow)])
def test_lamp_of_each_kind(device: Device, size: str, kind: str) -> None:
    surfaces, camera, _ = shadow_scene()
    camera = SMALL if size == "small" else camera
    scene = matte(surfaces), camera, [LAMPS[kind]]
    want = shown(*scene)
    differ(shown(*scene, device), want)
    assert want.min() < 0.1 * want.max()


@pytest.mark.slow
def test_gloss_through_a_bent_lens(device: Device) -> None:
    surfaces, camera, _ = shadow_scene()
    lens, turned = (-0.2, 0.1, 0.003, -0.002), camera.camera_from_world
    camera = Camera(camera.width, camera.height, camera.K, lens, turned, pixel_side=0.8)
    scene = surfaces, camera, [LAMPS["disc"], LAMPS["spot"]]
    want = shown(*scene)
    differ(shown(*scene, device), want)


def round_bar(count: int = 24) -> gs.Surface:
    """A closed bar with smooth sides."""
    turn = 2.0 * np.pi * np.arange(count) / count
    ring = np.stack([0.12 * np.cos(turn), 0.0 * turn, 0.2 + 0.12 * np.sin(turn)], axis=1)
    ends = [ring + np.array([0.0, y, 0.0]) for y in (-0.4, 0.0, 0.4)]
    points = np.concatenate([*ends, [[0.0, -0.4, 0.2], [0.0, 0.4, 0.2]]])
    k, after = np.arange(count), (np.arange(count) + 1) % count
    none = np.full(count, -1)
    sides = [
        np.stack([k + n, k + count + n, after + count + n, after + n], axis=1) for n in (0, count)
    ]
    caps = [
        np.stack([k, after, np.full(count, 3 * count), none], axis=1),
        np.stack([after + 2 * count, k + 2 * count, np.full(count, 3 * count + 1), none], axis=1),
    ]
    faces = np.concatenate([*sides, *caps]).astype(np.int32)
    return gs.Surface(points, faces, gs.paint.Plain(0.6), name="bar")


def test_smooth_normals(device: Device) -> None:
    floor = sheet((-1.1, -1.1), (1.1, 1.1), 0.0)
    scene = [floor, round_bar()], SMALL, [LAMPS["point"], LAMPS["area"]]
    want = shown(*scene)
    differ(shown(*scene, device), want, 0.02)


@pytest.mark.parametrize("part", [0.5, pytest.param(1.0, marks=pytest.mark.slow)])
def test_fine_open_sheet(device: Device, part: float) -> None:
    (table, *_), _, lights = shadow_scene()
    x, y = np.meshgrid(
        np.linspace(-0.4, 0.35, 41)[: round(41 * part)],
        np.linspace(-0.3, 0.3, 31)[: round(31 * part)], indexing="ij",
    )  # fmt: skip
    z = 0.25 + 0.02 * np.sin(9.0 * x) * np.cos(7.0 * y)
    number = np.arange(x.size).reshape(x.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    faces = quads.reshape(-1, 4).astype(np.int32)
    fine = gs.Surface(points, faces, gs.paint.Plain(0.6), name="sheet")
    # what is about the sheet, with pixels as large as its faces
    sensor, pixels = (21.6 * part, 14.4 * part), (round(71 * part), round(50 * part))
    middle = tuple(float(v) for v in points.mean(axis=0))
    camera = Camera.from_lens(sensor, 30.0, pixels, (0.3, -1.4, 0.95), middle)
    scene = [table, fine], camera, lights
    want = shown(*scene)
    differ(shown(*scene, device), want, 0.03)


def test_several_bands_have_the_same_bits(monkeypatch: pytest.MonkeyPatch, device: Device) -> None:
    surfaces, camera, _ = shadow_scene()
    scene = matte(surfaces), camera, [LAMPS["area"], LAMPS["sun"]]
    want = shown(*scene, device)
    assert (shown(*scene, device) == want).all()
    monkeypatch.setattr(
        import_module("gpusim.optics.rendering.frame_plan"), "BAND_BYTES", 4 * camera.width * 40
    )
    assert (shown(*scene, device) == want).all()


def test_another_body_in_a_small_picture(device: Device) -> None:
    surfaces, _, _ = shadow_scene()
    lights = [LAMPS["disc"], LAMPS["spot"]]
    small = Camera.from_lens((36.0, 24.0), 30.0, (61, 43), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05))
    more = [*surfaces, box((-0.55, 0.3, 0.2), (0.1, 0.07, 0.1), 3)]
    differ(shown(more, small, lights, device), shown(more, small, lights), 2 * TOLERANCE)


def test_moving_and_with_too_small_a_pool(device: Device) -> None:
    surfaces, _, _ = shadow_scene()
    lights = [LAMPS["area"], LAMPS["sun"]]
    device.pool.notes["shadow.capacity"] = 4
    for step in (0.0, 0.05):
        block = surfaces[2].moved(surfaces[2].points + np.array([step, 0.0, step]))
        scene = matte([surfaces[0], surfaces[1], block]), SMALL, lights
        want = shown(*scene)
        differ(shown(*scene, device), want)
    assert device.pool.notes["shadow.capacity"] != 4
