"""Small triangles put together as receivers: the boxes hold them, the pictures stay the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import half_shadow, patches
from gpusim.optics.light import Light
from gpusim.optics.patches import Small
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_pairs import TILE
from gpusim.optics.view import look

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
    padded, quads = np.pad(filled, 1), []
    for axis in range(3):
        for way in (1, -1):
            corner = np.argwhere(padded & ~np.roll(padded, -way, axis=axis)) - 1
            corner[:, axis] += way == 1
            own = np.repeat(corner[:, None], 4, axis=1)
            own[:, [1, 2], (axis + 1) % 3] += 1
            own[:, [2, 3], (axis + 2) % 3] += 1
            quads.append(own[:, ::way])
    every = np.concatenate(quads).reshape(-1, 3)
    corners, number = np.unique(every, axis=0, return_inverse=True)
    points = 0.1 * corners / fine - [0.3, 0.2, 0.15]
    points[:, 2] -= 0.2 * points[:, 0] ** 2
    return gs.Surface(points, number.reshape(-1, 4), gs.paint.Plain(0.7))


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
    assert sorted(small.members) == sorted(spots.triangle)
    # each point of a triangle that is seen in a tile lies in one of the tile's patches
    random = np.random.default_rng(2)
    low, high = small.boxes.points.min(axis=0).T, small.boxes.points.max(axis=0).T
    middle, size = 0.5 * (low + high), 0.5 * (high - low)
    count = np.diff(small.begin, append=len(small.members))
    box = np.repeat(np.arange(len(small.begin)), count)
    checked = 0
    for k in random.choice(len(spots.triangle), 400, replace=False):
        corners = receivers.columns[:, :, spots.triangle[k]]
        at = random.dirichlet((1.0, 1.0, 1.0), 20) @ corners
        pixel = camera.project(at)
        inside = (np.floor((pixel + 0.5) / TILE) == spots.tile[k]).all(axis=1)
        own = box[small.members == spots.triangle[k]]
        own = own[(small.pairs.tile[own] == spots.tile[k]).all(axis=1)]
        assert len(own) == 1
        assert (np.abs(at[inside] - middle[own]) <= size[own] + 1e-9).all()
        checked += int(inside.sum())
    assert checked > 1000


@pytest.mark.parametrize("leaning", [False, True], ids=["slabs", "all"])
def test_patches_lie_above_their_plane(monkeypatch: pytest.MonkeyPatch, leaning: bool) -> None:
    """What `receiver_planes.lies_low` takes for granted of the first three points and lean."""
    monkeypatch.setattr(patches, "FEWEST", 1000)
    monkeypatch.setattr(patches, "WORTH", 1.0)
    receivers = Receivers(look([angle()], CAMERA, lit=True))
    small = Small.of(receivers, CLOSED)
    boxes = small.boxes
    slabs = np.flatnonzero(boxes.lean < patches.ANY)
    assert 0.5 * boxes.count < len(slabs)
    some = np.arange(boxes.count) if leaning else slabs
    first, *others = boxes.points[:3].transpose(0, 2, 1)
    normal = np.cross(others[0] - first, others[1] - first)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    side = np.sign(np.sum(normal * (boxes.points[-1].T - first), axis=1))
    normal *= side[:, None]
    box = np.repeat(np.arange(boxes.count), np.diff(small.begin, append=len(small.members)))
    corners = receivers.columns[:, :, small.members].transpose(2, 0, 1)
    height = np.einsum("mka,ma->mk", corners - first[box][:, None], normal[box]).min(axis=1)
    assert (height[np.isin(box, some)] >= -1e-12).all()
    turned = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    away = np.minimum(*(np.linalg.norm(turned - end * normal[box], axis=1) for end in (-1, 1)))
    assert (away <= boxes.lean[box] + 1e-6).all()


@pytest.mark.parametrize("light", LIGHTS, ids=["area", "point"])
def test_pictures_are_those_of_single_triangles(
    device: Device, monkeypatch: pytest.MonkeyPatch, light: Light
) -> None:
    surfaces = [angle(), wall()]
    asked: list[int] = []
    original = half_shadow._found_by

    def counting(*args: object) -> object:
        asked.append(args[2].count)  # type: ignore[attr-defined]
        return original(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(half_shadow, "_found_by", counting)
    monkeypatch.setattr(patches, "FEWEST", 1000)
    monkeypatch.setattr(patches, "WORTH", 1.0)

    def picture() -> Array:
        return np.asarray(gs.render(surfaces, CAMERA, [light], device=device).radiance, float)

    together, first = picture(), sum(asked)
    asked.clear()
    monkeypatch.setattr(patches, "FEWEST", 10**9)
    alone = picture()
    assert first < 0.7 * sum(asked)
    away = np.abs(together - alone) / alone.max()
    # one sample of 512, where a list has an edge that cuts nothing
    assert away.max() <= 2.5 / 512 and (away > 1e-5).mean() < 1e-2
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
        assert small.boxes.single.all()
        np.testing.assert_array_equal(small.triangle, np.unique(seen.triangle))
        np.testing.assert_array_equal(small.triangle[small.which], seen.triangle)


def test_flags_of_patches_are_those_of_triangles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(patches, "WORTH", 1.0)
    monkeypatch.setattr(patches, "FEWEST", 1000)
    view = look([angle(), wall()], CAMERA, lit=True)
    small = Small.of(Receivers(view), np.array([True, False]))
    flags = np.random.default_rng(3).random(view.count) < 0.7
    parts = np.split(flags[small.members], small.begin[1:])
    np.testing.assert_array_equal(small.some(flags), [part.any() for part in parts])
    np.testing.assert_array_equal(small.every(flags), [part.all() for part in parts])
    none = np.zeros(0, bool)
    empty = Small.of(Receivers(view.some(np.zeros(0, np.int64))), CLOSED)
    assert empty.some(none).shape == empty.every(none).shape == (0,)
