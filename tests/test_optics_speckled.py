"""Speckle on fine meshes: the same pictures, however little is looked at for them."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry import pattern_seams, pixel_footprint
from gpusim.optics.geometry.pattern_seams import speckle_jumps
from gpusim.optics.geometry.view import look
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.series import late, speckled_layer
from gpusim.optics.shading import speckled
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.speckled import all_speckled
from gpusim.surface.speckle import Speckle

Array = npt.NDArray[np.float64]

EYE = (0.07, -0.84, 0.05)
CAMERA = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), EYE, (0.0, 0.0, 0.01))
LIGHTS = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]
HARD = Speckle(0.021, seed=3)
SOFT = Speckle(0.021, 0.4, 0.003, seed=3)


def sheet(paint: Speckle = HARD, height: float = 0.01) -> gs.Surface:
    """A wavy sheet of 10,800 triangles."""
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, 91), np.linspace(-0.2, 0.21, 61))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    node = np.arange(len(flat)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    points = flat.copy()
    points[:, 1] += height * np.sin(9.0 * flat[:, 0] + 4.0 * flat[:, 2])
    return gs.Surface(points, faces.reshape(-1, 4), paint, reference=flat)


def cosines(surface: gs.Surface) -> Array:
    """Between the triangles' normals and the line of sight to their middles."""
    corners = surface.points[surface.topology.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = corners.mean(axis=1) - EYE
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(away, axis=1)
    result: Array = np.abs((normal * away).sum(axis=1)) / size
    return result


@pytest.fixture
def series(device: Device, monkeypatch: pytest.MonkeyPatch) -> Device:
    """A device that looks at surfaces of a thousand triangles itself from the second image on."""
    monkeypatch.setattr(late, "FEWEST", 1000)
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    device.pool.notes.clear()
    return device


def third(
    device: Device, surface: gs.Surface, background: float = 0.0
) -> tuple[bool, npt.NDArray[np.float32]]:
    """Whether the device looked at a surface's vertices to the end in its third image, and that."""
    for _ in range(3):
        frame = gs.render([surface], CAMERA, LIGHTS, background=background, device=device)
    return isinstance(frame.view.table, late.LateVertices), frame.radiance.copy()


@pytest.mark.parametrize("paint", [HARD, SOFT])
@pytest.mark.parametrize("background", [0.0, 0.3])
def test_the_device_s_look_at_a_series_changes_nothing(
    series: Device, monkeypatch: pytest.MonkeyPatch, paint: Speckle, background: float
) -> None:
    surface = sheet(paint)
    seen, got = third(series, surface, background)
    assert seen
    moved = surface.moved(surface.points + np.array([0.003, 0.01, -0.002]))
    frame = gs.render([moved], CAMERA, LIGHTS, background=background, device=series)
    assert isinstance(frame.view.table, late.LateVertices)
    pictures = got, frame.radiance.copy()
    monkeypatch.setattr(late, "FEWEST", 10**9)
    for one, picture in zip((surface, moved), pictures, strict=True):
        want = gs.render([one], CAMERA, LIGHTS, background=background, device=series).radiance
        assert np.abs(picture - want).max() <= 1e-6 * want.max()
        assert np.abs(want - want.mean()).max() > 0.3 * want.max()


def test_a_series_under_uneven_light(series: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    """A lamp so near that most triangles' light isn't even: pixels read records, made for all."""
    lamp = gs.AreaLight((0.0, -0.06, 0.0), (0.0, 0.0, 0.0), (0.1, 0.1), 5.0, shadows=False)
    surface = sheet(HARD, 0.02)

    def shown() -> npt.NDArray[np.float32]:
        return gs.render([surface], CAMERA, [lamp], device=series).radiance.copy()

    got = [shown() for _ in range(3)]
    monkeypatch.setattr(late, "FEWEST", 10**9)
    want = shown()
    assert all(np.abs(picture - want).max() <= 1e-6 * want.max() for picture in got)


def test_bands_of_a_series_join(series: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    _, want = third(series, sheet())
    monkeypatch.setattr(
        import_module("gpusim.optics.rendering.renderer"), "BAND_BYTES", 4 * 361 * 61
    )
    seen, got = third(series, sheet())
    assert seen
    assert np.array_equal(got, want)


@pytest.mark.parametrize("more", [-2e-3, 2e-3])
def test_the_device_tells_triangles_that_turn_away(
    series: Device, monkeypatch: pytest.MonkeyPatch, more: float
) -> None:
    surface = sheet(height=0.03)
    visible = cosines(surface)
    monkeypatch.setattr(speckled_layer, "LEAST_COSINE", float(visible.min()) + more)
    seen, got = third(series, surface)
    assert seen == (more < 0.0)
    monkeypatch.setattr(late, "FEWEST", 10**9)
    want = gs.render([surface], CAMERA, LIGHTS, device=series).radiance
    assert np.abs(got - want).max() <= 1e-6 * want.max()


def test_the_device_tells_larger_pixels(series: Device, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speckled_layer, "LARGER", 1.0)
    seen, _ = third(series, sheet())
    assert not seen


def test_pixels_too_large_for_usual_tables_are_left_to_the_host(series: Device) -> None:
    seen, _ = third(series, sheet(Speckle(0.0021, 0.4, 0.0005, seed=3)))
    assert not seen


def test_edges_that_bend_are_those_that_a_look_at_all_finds() -> None:
    surface = sheet(height=0.15)
    topology, kept = surface.topology, np.arange(len(surface.topology.triangles))
    st = surface.rest[topology.triangles][:, :, [0, 2]]
    points = surface.points @ CAMERA.camera_from_world[:3, :3].T + CAMERA.camera_from_world[:3, 3]
    ideal = points @ CAMERA.K.T
    ideal = ideal[:, :2] / ideal[:, 2:]
    own = np.ones(len(kept), bool)
    own[::7] = False
    found = [
        speckle_jumps(topology, kept, own, lambda rows: st[rows], points, ideal, HARD, whole)
        for whole in (False, True)
    ]
    assert np.array_equal(*(np.sort(edges) for edges in found))
    steep = cosines(surface) < pattern_seams.STEEP
    assert len(found[0]) and steep.any() and not steep.all()


def test_largest_pixels_are_the_same_by_a_look_at_few(monkeypatch: pytest.MonkeyPatch) -> None:
    reaches = []
    for many in (pixel_footprint.MANY, 10**9):
        monkeypatch.setattr(pixel_footprint, "MANY", many)
        view = look([sheet(height=0.03)], CAMERA, lit=True)
        reaches.append(view.paints[0].reach)
    assert reaches[0] == reaches[1] > 0.0


def test_only_even_light_and_one_speckle_are_for_it(
    series: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    def suits(surfaces: list[gs.Surface], lamp: gs.PointLight) -> bool:
        view = look(surfaces, CAMERA, lit=True)
        sight = Sight(series, view, CAMERA.height)
        return all_speckled(Setup.build(view, [lamp], 0.0, surfaces), sight)

    near = gs.PointLight((0.0, -0.04, 0.0), 50.0, shadows=False)
    assert suits([sheet()], LIGHTS[0])
    assert not suits([sheet()], near)
    assert not suits([sheet(), sheet(SOFT)], LIGHTS[0])
    monkeypatch.setattr(speckled, "MOST_CELLS", 20)
    assert not suits([sheet()], LIGHTS[0])
