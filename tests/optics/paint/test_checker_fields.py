"""Triangles within one field of a chessboard are drawn plain: the same picture."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.geometry.view import look
from gpusim.optics.paint.checker_lines import field_of
from gpusim.optics.shading import triangle_traits
from gpusim.optics.shading.setup import Setup
from gpusim.surface.paint import Checker

CAMERA = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), (0.1, -1.1, 0.07), (0.0, 0.0, 0.01))
LIGHTS = [gs.PointLight((-1.0, -2.0, 1.0), 50.0, shadows=False)]


def wavy(paint: Checker, columns: int, rows: int) -> gs.Surface:
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, columns + 1), np.linspace(-0.2, 0.21, rows + 1))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    points = flat + np.array([0.0, 1.0, 0.0]) * (0.01 * np.sin(9.0 * x + 4.0 * z)).reshape(-1, 1)
    node = np.arange(len(points)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    return gs.Surface(points, faces.reshape(-1, 4), paint=paint, reference=flat)


@pytest.mark.parametrize("columns,rows", [(7, 5), (None, None), (None, 4)])
def test_fields_are_those_of_the_pattern(columns: int | None, rows: int | None) -> None:
    paint = Checker(0.061, columns, rows, (0.05, -0.03), 0.1, 0.7, 0.4)
    random = np.random.default_rng(4)
    low = random.uniform(-0.3, 0.6, (3000, 2))
    high = low + random.uniform(0.0, 0.03, (3000, 2))
    st = np.stack([low, np.c_[high[:, 0], low[:, 1]], high], axis=1).reshape(-1, 2)
    albedos = np.array([paint.dark, paint.light, paint.ground])
    near, albedo = field_of(paint, albedos, 0.002, st, np.arange(9000).reshape(-1, 3))
    assert 0.05 < near.mean() < 0.9
    # every point of a piece, and of all pixels on it, has the one albedo; near lines some haven't
    share = np.linspace(0.0, 1.0, 9)
    grid = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    at = (low - 0.002)[:, None] + grid * (high - low + 0.004)[:, None]
    index = np.floor((at - np.array(paint.origin)) / paint.size)
    want = np.where(index.sum(axis=2) % 2.0 == 0.0, 0.1, 0.7)
    for axis, many in enumerate((columns, rows)):
        if many is not None:
            outside = (index[..., axis] < 0) | (index[..., axis] >= many)
            want = np.where(outside, 0.4, want)
    assert (want[~near].astype(np.float32) == albedo[~near, None]).all()
    shades = np.array([0.1, 0.7] if rows is None else [0.1, 0.7, 0.4], np.float32)
    assert set(albedo[~near]) == set(shades)
    mixed = np.ptp(want, axis=1) > 0.0
    assert mixed[near].mean() > 0.85


@pytest.mark.parametrize("shape", [(9, 6), (90, 60)])
@pytest.mark.parametrize("lit", [True, False])
def test_a_picture_is_the_same_without(
    device: gs.Device, monkeypatch: pytest.MonkeyPatch, shape: tuple[int, int], lit: bool
) -> None:
    surface = wavy(Checker(0.061, 7, 5, (0.05, 0.03), 0.1, 0.7, 0.4), *shape)
    lights = LIGHTS if lit else None
    setup = Setup.build(look([surface], CAMERA, lit=lit), lights, 0.0, [surface])
    if shape[0] > 9:
        assert 0.05 < setup.traits.near_feature.mean() < 0.5
        assert {np.float32(0.1), np.float32(0.7)} <= set(setup.traits.albedo)
    got = gs.render([surface], CAMERA, lights, device=device).radiance
    monkeypatch.setattr(triangle_traits, "within_fields", lambda *given: None)
    want = gs.render([surface], CAMERA, lights, device=device).radiance
    assert np.abs(got - want).max() <= 1e-5 * want.max()
    twin = gs.render([surface], CAMERA, lights, backend="numpy").radiance
    assert np.abs(got - twin).max() <= 1e-3 * twin.max()


def test_glossy_boards_keep_their_prints() -> None:
    paint = Checker(0.061, 7, 5, (0.05, 0.03), 0.1, 0.7, 0.4, roughness=0.3)
    view = look([wavy(paint, 90, 60)], CAMERA, lit=True)
    setup = Setup.build(view, LIGHTS, 0.0)
    np.testing.assert_array_equal(setup.traits.near_feature, setup.table.near_features(view))
    assert set(setup.traits.albedo) == {np.float32(0.4)}
