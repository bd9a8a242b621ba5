"""Small triangles put together as receivers: the boxes hold them, the pictures stay the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import patches
from gpusim.optics.caster_sets import CasterSets
from gpusim.optics.light import Light
from gpusim.optics.patches import Small
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_pairs import TILE
from gpusim.optics.view import look
from tests.optics_skins import skin_of

Array = npt.NDArray[np.float64]

CAMERA = gs.Camera.from_lens((36.0, 24.0), 40.0, (247, 163), (0.1, -1.0, 0.3), (0.0, 0.0, 0.0))
BENT = replace(CAMERA, distortion=np.array([-0.12, 0.05, 1e-3, -2e-3]))
CLOSED = np.array([True])
LIGHTS: list[Light] = [
    gs.AreaLight((-0.8, -0.9, -0.5), (0.0, 0.0, 0.0), (0.3, 0.2), 50.0),
    gs.PointLight((-0.8, -0.9, -0.5), 50.0),
]


def angle(fine: int = 10) -> gs.Surface:
    """The skin of a bent L beam, closed: one leg's shadow falls on the other."""
    filled = np.zeros((6 * fine, 3 * fine, 3 * fine), bool)
    filled[:, fine:, :fine] = filled[:, -fine:] = True
    corners, quads = skin_of(filled)
    points = 0.1 * corners / fine - [0.3, 0.2, 0.15]
    points[:, 2] -= 0.2 * points[:, 0] ** 2
    return gs.Surface(points, quads, gs.paint.Plain(0.7))


def wall() -> gs.Surface:
    corners = [[-1.0, 0.4, -0.8], [1.0, 0.4, -0.8], [1.0, 0.4, 0.8], [-1.0, 0.4, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.8))


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["straight", "bent"])
def test_patches_hold_what_lies_in_their_tiles(
    monkeypatch: pytest.MonkeyPatch, camera: gs.Camera
) -> None:
    monkeypatch.setattr(patches, "FEWEST", 1000)
    monkeypatch.setattr(patches, "WORTH", 1.0)
    view = look([angle()], camera, lit=True)
    receivers = Receivers(view)
    spots = receivers.spots[receivers.seen(receivers.spots)]
    small = Small.of(receivers, CLOSED)
    # many fewer, in as many tiles
    assert len(small.triangle) < 0.6 * len(spots.triangle)
    assert {*map(tuple, small.pairs.tile)} == {*map(tuple, spots.tile)}
    # each point of a triangle that is seen in a tile lies in one of the tile's patches
    random = np.random.default_rng(2)
    low, high = small.points.min(axis=0).T, small.points.max(axis=0).T
    middle, size = 0.5 * (low + high), 0.5 * (high - low)
    patch = np.repeat(small.which, np.diff(small.begin, append=len(small.spots.triangle)))
    checked = 0
    for k in random.choice(len(spots.triangle), 400, replace=False):
        corners = receivers.columns[:, :, spots.triangle[k]]
        at = random.dirichlet((1.0, 1.0, 1.0), 20) @ corners
        pixel = camera.project(at)
        inside = (np.floor((pixel + 0.5) / TILE) == spots.tile[k]).all(axis=1)
        own = np.flatnonzero(small.spots.triangle == spots.triangle[k])
        own = patch[own[(small.spots.tile[own] == spots.tile[k]).all(axis=1)]]
        assert len(own) == 1
        assert (np.abs(at[inside] - middle[own]) <= size[own] + 1e-9).all()
        checked += int(inside.sum())
    assert checked > 1000


@pytest.mark.parametrize("light", LIGHTS, ids=["area", "point"])
def test_pictures_are_those_of_single_triangles(
    device: Device, monkeypatch: pytest.MonkeyPatch, light: Light
) -> None:
    """To the last bit, with fewer boxes that are asked about."""
    surfaces = [angle(), wall()]
    asked: list[int] = []
    original = CasterSets.may_hide

    def counting(self: CasterSets, points: Array, number: npt.NDArray[np.int64]) -> Array:
        asked.append(points.shape[2])
        return original(self, points, number)

    monkeypatch.setattr(CasterSets, "may_hide", counting)
    monkeypatch.setattr(patches, "FEWEST", 1000)
    monkeypatch.setattr(patches, "WORTH", 1.0)

    def picture() -> Array:
        return np.asarray(gs.render(surfaces, CAMERA, [light], device=device).radiance)

    together, first = picture(), sum(asked)
    asked.clear()
    monkeypatch.setattr(patches, "FEWEST", 10**9)
    alone = picture()
    assert first < 0.95 * sum(asked)
    np.testing.assert_array_equal(together, alone)
    # there are shadows on the beam and on the wall
    lit = gs.render(surfaces, CAMERA, [replace(light, shadows=False)], device=device).radiance
    assert (alone < 0.5 * lit).mean() > 0.02


def test_open_sheets_and_few_triangles_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    view = look([angle()], CAMERA, lit=True)
    receivers = Receivers(view)
    monkeypatch.setattr(patches, "WORTH", 1.0)
    monkeypatch.setattr(patches, "FEWEST", 1000)
    seen = receivers.spots[receivers.seen(receivers.spots)]
    for few, closed in ((1000, ~CLOSED), (len(seen.triangle) + 1, CLOSED)):
        monkeypatch.setattr(patches, "FEWEST", few)
        small = Small.of(receivers, closed)
        assert small.single
        np.testing.assert_array_equal(small.triangle, np.unique(seen.triangle))
        np.testing.assert_array_equal(small.triangle[small.which], seen.triangle)


def test_flags_of_patches_are_those_of_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patches, "WORTH", 1.0)
    monkeypatch.setattr(patches, "FEWEST", 1000)
    view = look([angle(), wall()], CAMERA, lit=True)
    small = Small.of(Receivers(view), np.array([True, False]))
    flags = np.random.default_rng(3).random(view.count) < 0.7
    assert not small.single
    every = np.arange(len(small.begin))
    for k in every:
        own = flags[small.parts(every[k : k + 1]).triangle]
        which = small.which[k]
        assert small.some(flags)[which] == own.any() and small.every(flags)[which] == own.all()
    parts = small.parts(every)
    np.testing.assert_array_equal(parts.triangle, small.spots.triangle)
    np.testing.assert_array_equal(parts.tile, small.spots.tile)
    seen = Receivers(view).spots
    assert len(parts.triangle) == len(seen.triangle) - np.count_nonzero(~Receivers(view).seen(seen))
    none = np.zeros(0, bool)
    empty = Small.of(Receivers(view.some(np.zeros(0, np.int64))), CLOSED)
    assert empty.some(none).shape == empty.every(none).shape == (0,)
