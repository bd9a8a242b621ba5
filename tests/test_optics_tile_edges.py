"""How often edges of borders wind round samples, which is told modulo eight."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics import lamp_layer, lamp_shadow
from gpusim.optics.emitters import lamps_of
from gpusim.optics.lamp_view import LampView
from gpusim.optics.lighting import find_shadows
from gpusim.optics.tile_edges import most_turns
from gpusim.optics.view import look

Array = npt.NDArray[np.float64]

CAMERA = gs.Camera.from_lens((36.0, 24.0), 34.0, (240, 160), (0.9, -0.9, 0.3), (0.0, 0.1, 0.0))
MATTE = gs.paint.Plain(0.6)
AREA = gs.AreaLight((0.0, -2.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.1), 50.0)


def discs(count: int) -> gs.Surface:
    """Flat round bodies one behind the other, which are one surface."""
    around, across = 24, 12
    turn = np.arange(around) * (2.0 * np.pi / around)
    tilt = np.linspace(-0.5 * np.pi, 0.5 * np.pi, across + 2)[1:-1]
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rings = [np.insert(np.cos(a) * ring, 1, np.sin(a), axis=1) for a in tilt]
    ball = np.concatenate([*rings, [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]]]) * [0.15, 0.01, 0.15]
    k = np.arange(across - 1)[:, None] * around + np.arange(around)
    after = k - np.arange(around) + (np.arange(around) + 1) % around
    sides = np.stack([k, k + around, after + around, after], axis=-1).reshape(-1, 4)
    first, none = np.arange(around), np.full(around, -1)
    last, tip = first + (across - 1) * around, across * around
    ends = [
        np.stack([np.full(around, tip), first, np.roll(first, -1), none], axis=1),
        np.stack([np.full(around, tip + 1), np.roll(last, -1), last, none], axis=1),
    ]
    faces = np.concatenate([sides, *ends])
    place, apart = np.array([0.0, -0.5, 0.0]), np.array([0.004, 0.05, 0.003])
    points = [ball + place + n * apart for n in range(count)]
    used = [np.where(faces < 0, -1, faces + n * len(ball)) for n in range(count)]
    return gs.Surface(np.concatenate(points), np.concatenate(used), MATTE)


@pytest.mark.parametrize(
    "light",
    [AREA, pytest.param(gs.SunLight((0.0, 1.0, 0.0), 5.0, diameter=0.01), marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("count", [pytest.param(6, marks=pytest.mark.slow), 8,
                                   pytest.param(9, marks=pytest.mark.slow)])  # fmt: skip
def test_layers_over_each_other_are_no_hole(
    device: Device, monkeypatch: pytest.MonkeyPatch, count: int, light: gs.AreaLight
) -> None:
    monkeypatch.setattr(lamp_layer, "FEWEST", 500)
    monkeypatch.setattr(lamp_shadow, "MANY", 1)
    corners = [[-1.0, 0.4, -0.8], [1.0, 0.4, -0.8], [1.0, 0.4, 0.8], [-1.0, 0.4, 0.8]]
    wall = gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), MATTE)
    surfaces = [discs(count), wall]
    tiles = find_shadows(look(surfaces, CAMERA, lit=True), [light], surfaces)
    assert tiles is not None and len(tiles.chains.ends) > 0
    got = np.array(gs.render(surfaces, CAMERA, [light], device=device).radiance, np.float64)
    monkeypatch.setattr(
        "gpusim.optics.lighting.surfaces_alone", lambda lamps, *_: [[] for _ in lamps]
    )
    want = np.array(gs.render(surfaces, CAMERA, [light], device=device).radiance, np.float64)
    away = np.abs(got - want) / want.max()
    assert want.min() < 0.1 * want.max()
    # some samples of the lamp, where a row of them runs along an edge
    assert away.max() < 5.5 / 512 and away.mean() < 1e-4


def test_turns_of_edges_are_bounded() -> None:
    """A spiral by its turns, a square by two at most; edges that come to lie over each other."""
    (lamp,) = lamps_of([AREA])
    view = LampView.of(lamp)[0]

    def ends(p: Array, q: Array) -> Array:
        at = view.world(p, q, np.full(len(p), 0.8)).T
        return np.stack([at, np.roll(at, -1, axis=0)], axis=1)

    turn = np.linspace(0.0, 9 * 2.0 * np.pi, 200)
    spiral = ends((1.0 + turn) * np.cos(turn), (1.0 + turn) * np.sin(turn))
    square = ends(np.array([0.0, 1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0, 1.0]))
    box = np.repeat([0, 2], [len(square), len(spiral)])
    found = most_turns(view, box, np.concatenate([square, spiral]), 4)
    assert 1 <= found[0] <= 2 and 9 <= found[2] <= 11 and found[1] == found[3] == 0
    # of a list without a way back, either way
    for way in (1, -1):
        down = np.repeat(square[:1, ::way], 9, axis=0)
        assert most_turns(view, np.zeros(9, np.int64), down, 1)[0] == 9
    # at other depths than the first they may come to lie over each other
    deep = square.copy()
    deep[:, :, 1] += 0.3
    both = most_turns(view, np.zeros(8, np.int64), np.concatenate([square, deep]), 1)
    assert both[0] >= 2
    assert most_turns(view, box[:0], square[:0], 3).tolist() == [0, 0, 0]
