"""Views of one layer: told from their border, and drawn without looking for what is nearest."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry import single_layer, view
from gpusim.optics.geometry.single_layer import one_layer, winds_once
from gpusim.optics.geometry.view import look
from gpusim.optics.raster.compute_raster import Sight
from gpusim.optics.shading import looks
from gpusim.optics.shading.forward_pass import ShadePass
from gpusim.optics.shading.layer_pass import LayerPass
from gpusim.optics.shading.scene_buffers import Tables
from gpusim.optics.shading.setup import Setup
from gpusim.surface.paint import Checker, Paint, Plain

CAMERA = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), (0.07, -0.84, 0.05), (0.0, 0.0, 0.01))
LIGHTS = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]
ENDING = Checker(0.061, 7, 5, (-0.23, -0.13), 0.1, 0.7, 0.4)


def wavy(paint: Paint, height: float = 0.01, bend: float = 0.0) -> gs.Surface:
    """A sheet of 10,800 triangles; ``bend`` folds it about an upright line."""
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, 91), np.linspace(-0.2, 0.21, 61))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    points = flat + np.array([0.0, 1.0, 0.0]) * (height * np.sin(9.0 * x + 4.0 * z)).reshape(-1, 1)
    beyond = np.maximum(points[:, 0] - 0.1, 0.0)
    points[:, 0] -= (1.0 - np.cos(bend)) * beyond
    points[:, 1] += np.sin(bend) * beyond
    node = np.arange(len(points)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    return gs.Surface(points, faces.reshape(-1, 4), paint=paint, reference=flat)


def chain(*corners: tuple[float, float]) -> npt.NDArray[np.int64]:
    at = np.rint(256.0 * np.array(corners)).astype(np.int64)
    return np.stack([at, np.roll(at, -1, axis=0)], axis=1)


def square(x: float, y: float, size: float, turned: bool = False) -> npt.NDArray[np.int64]:
    corners = [(x, y), (x + size, y), (x + size, y + size), (x, y + size)]
    return chain(*(corners[::-1] if turned else corners))


def test_borders_that_wind_once() -> None:
    outer = square(1.3, 2.1, 9.0)
    assert winds_once(outer, 20) and winds_once(square(1.3, 2.1, 9.0, True), 20)
    # a hole, another piece beside it, one that touches; and one over it, or the other way round
    assert winds_once(np.concatenate([outer, square(4.0, 5.0, 3.0, True)]), 20)
    assert winds_once(np.concatenate([outer, square(14.0, 5.0, 3.0)]), 20)
    assert winds_once(np.concatenate([outer, square(10.3, 3.0, 5.0)]), 20)
    assert not winds_once(np.concatenate([outer, square(4.0, 5.0, 3.0)]), 20)
    assert not winds_once(np.concatenate([outer, square(9.0, 3.0, 5.0)]), 20)
    assert not winds_once(np.concatenate([outer, square(14.0, 5.0, 3.0, True)]), 20)
    # where no centre lies, or below the image, it doesn't matter
    assert winds_once(np.concatenate([outer, square(10.2, 3.2, 0.7)]), 20)
    assert winds_once(np.concatenate([outer, square(4.0, 5.0, 3.0)]), 4)
    assert not winds_once(chain((1.2, 1.4), (9.1, 8.2), (9.3, 1.1), (1.7, 8.9)), 20)


def told(surface: gs.Surface, monkeypatch: pytest.MonkeyPatch, lamp: bool = True) -> bool:
    monkeypatch.setattr(view, "FEWEST", 1000)
    return look([surface], CAMERA, lamp, lambda part: None).layer


def test_what_is_a_layer(monkeypatch: pytest.MonkeyPatch) -> None:
    assert told(wavy(ENDING), monkeypatch)
    # folded back, and half open, where part of it is seen from behind or through
    assert not told(wavy(ENDING, bend=2.8), monkeypatch)
    assert told(wavy(ENDING, bend=0.9), monkeypatch)
    # partly beside the image
    surface = wavy(ENDING)
    moved = gs.Surface(surface.points + np.array([0.3, 0.0, 0.1]), surface.faces, Plain())
    assert told(moved, monkeypatch)
    # sides that run the same way
    faces = surface.faces.copy()
    faces[77] = faces[77, ::-1]
    odd = gs.Surface(surface.points, faces, Plain())
    assert not odd.topology.oriented and not told(odd, monkeypatch)
    monkeypatch.setattr(view, "FEWEST", 20_000)
    assert not look([surface], CAMERA, True, lambda part: None).layer


def test_a_layer_by_its_triangles() -> None:
    """A spiral ramp, which covers itself though all of it looks up."""
    turn, across = np.meshgrid(np.linspace(0.0, 9.0, 60), np.linspace(4.3, 9.1, 9), indexing="ij")
    place = 12.0 + np.stack([across * np.cos(turn), across * np.sin(turn)], axis=-1).reshape(-1, 2)
    node = np.arange(len(place)).reshape(turn.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    points = np.concatenate([place, turn.reshape(-1, 1)], axis=1)
    topology = gs.Surface(points, faces.reshape(-1, 4), Plain()).topology
    front = np.ones(len(topology.triangles), bool)
    assert not one_layer(topology, front, front, place, 24)
    once = turn[:-1, :-1].reshape(-1) < 5.9
    assert one_layer(topology, front, once[topology.source], place, 24)
    assert not one_layer(topology, front, ~front, place, 24)
    front[3] = False
    assert not one_layer(topology, front, once[topology.source], place, 24)


@pytest.mark.parametrize("paint", [ENDING, Checker(0.07, None, 3, (0.0, -0.1)), Plain(0.3)])
@pytest.mark.parametrize("background,bands", [(0.0, 1), (0.3, 3)])
def test_a_picture_is_the_same_as_by_the_nearest(
    device: Device, monkeypatch: pytest.MonkeyPatch, paint: Paint, background: float, bands: int
) -> None:
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    rendering = sys.modules["gpusim.optics.rendering.renderer"]
    monkeypatch.setattr(rendering, "BAND_BYTES", 4 * 361 * (242 // bands))
    monkeypatch.setattr(looks, "FEWEST", 1000)
    # a lamp so near that light isn't even on some triangles
    lights = [*LIGHTS, gs.PointLight((0.1, -0.1, 0.1), 0.5, shadows=False)]
    made: list[LayerPass] = []

    class Noted(LayerPass):
        def __init__(self, tables: Tables, sight: Sight) -> None:
            super().__init__(tables, sight)
            made.append(self)

    monkeypatch.setattr(sys.modules["gpusim.optics.shading.forward_pass"], "LayerPass", Noted)

    def picture(fewest: int) -> npt.NDArray[np.float32]:
        monkeypatch.setattr(view, "FEWEST", fewest)
        options = {"background": background, "device": device}
        return gs.render([wavy(paint)], CAMERA, lights, **options).radiance  # type: ignore[arg-type]

    got = picture(1000)
    # lists are those of the last band
    assert len(made) == 1 and (len(made[0].refused()) > 0) == (bands == 1)
    want = picture(1_000_000)
    assert len(made) == 1 and np.isfinite(got).all()
    assert np.abs(got - want).max() <= 5e-7 * want.max()


def test_triangles_wound_the_other_way_are_noticed(device: Device) -> None:
    found = look([wavy(ENDING)], CAMERA, lit=True)
    guessed = replace(found, found=(found.paints, found.footprint), guessed=True, layer=True)
    for turned in (False, True):
        if turned:
            corner = guessed.corner.copy()
            corner[77] = corner[77, ::-1]
            guessed = replace(guessed, corner=corner)
        larger = tuple(replace(region, reach=1.1 * region.reach) for region in found.paints)
        guessed = replace(guessed, found=(larger, found.footprint))
        if not device.atomics64:
            pytest.skip("no 64-bit atomics")
        setup = Setup.build(guessed, LIGHTS, 0.0)
        sight = Sight(device, guessed, 242)
        tables = Tables(device, setup, sight)
        shading = ShadePass(tables, 242, True, sight)
        out = device.empty(4 * shading.stride * 242, "test.out")
        shading.begin(out, 0, 242)
        assert tables.looks is not None and tables.looks.surprised == turned


def test_what_is_found_to_be_no_layer_is_drawn_again(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not device.atomics64:
        pytest.skip("no 64-bit atomics")
    monkeypatch.setattr(looks, "FEWEST", 1000)
    want = gs.render([wavy(ENDING)], CAMERA, LIGHTS, device=device).radiance
    monkeypatch.setattr(view, "FEWEST", 1000)
    monkeypatch.setattr(looks.Looks, "surprised", True)
    got = gs.render([wavy(ENDING)], CAMERA, LIGHTS, device=device).radiance
    assert np.abs(got - want).max() <= 5e-7 * want.max()
    assert single_layer.FEWEST > 1000
