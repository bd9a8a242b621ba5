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
from gpusim.optics.patches import Patches
from gpusim.optics.receivers import Receivers
from gpusim.optics.tile_pairs import TILE
from gpusim.optics.view import look

Array = npt.NDArray[np.float64]

CAMERA = gs.Camera.from_lens((36.0, 24.0), 40.0, (247, 163), (0.1, -1.0, 0.3), (0.0, 0.0, 0.0))
BENT = replace(CAMERA, distortion=np.array([-0.12, 0.05, 1e-3, -2e-3]))
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
    spots = receivers.spots
    found = patches.patches(receivers, spots, np.zeros(view.count, np.int64))
    assert found is not None and found.taken.all()
    # many fewer, in as many tiles
    assert len(found.pairs.triangle) < 0.6 * len(spots.triangle)
    assert {*map(tuple, found.pairs.tile)} == {*map(tuple, spots.tile)}
    # each point of a triangle that is seen in a tile lies in one of the tile's boxes
    random = np.random.default_rng(2)
    middle, size = _boxes(found)
    checked = 0
    for k in random.choice(len(spots.triangle), 400, replace=False):
        corners = receivers.columns[:, :, spots.triangle[k]]
        at = random.dirichlet((1.0, 1.0, 1.0), 20) @ corners
        pixel = camera.project(at)
        inside = (np.floor((pixel + 0.5) / TILE) == spots.tile[k]).all(axis=1)
        own = np.flatnonzero((found.pairs.tile == spots.tile[k]).all(axis=1))
        away = np.abs(at[inside][:, None] - middle[own]) - size[own]
        assert (away.max(axis=2).min(axis=1) <= 1e-9).all()
        checked += int(inside.sum())
    assert checked > 1000


def _boxes(found: Patches) -> tuple[Array, Array]:
    """Middle and half the size (P, 3) of boxes around patches."""
    low, high = found.boxes.points.min(axis=0).T, found.boxes.points.max(axis=0).T
    return 0.5 * (low + high), 0.5 * (high - low)


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
    monkeypatch.setattr(half_shadow, "patches", lambda *args: None)
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
    none = np.full(view.count, -1)
    assert patches.patches(receivers, receivers.spots, none) is None
    monkeypatch.setattr(patches, "FEWEST", len(receivers.spots.triangle) + 1)
    assert patches.patches(receivers, receivers.spots, none + 1) is None
