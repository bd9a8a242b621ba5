"""Receivers that others hide from the camera throughout a tile."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.binning import bin_edges
from gpusim.optics.receivers import Receivers
from gpusim.optics.setup import Setup
from gpusim.optics.shade import shade_twin
from gpusim.optics.tile_pairs import TILE, Pairs
from gpusim.optics.view import look
from gpusim.optics.visibility import visibility_twin
from tests.test_optics_merging import strip


def scene() -> tuple[list[gs.Surface], gs.Camera]:
    """A bent sheet of small faces before a ground, on which it throws its shadow."""
    points, faces = strip(48, 20, 0.05)
    turn = np.array([[0.96, 0.28, 0.0], [-0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    sheet = gs.Surface(points @ turn + [-0.4, -0.3, 0.8], faces, paint=gs.paint.Plain(0.4))
    ground = gs.Surface(
        np.array([[-1.5, -1.2, 0], [1.5, -1.2, 0], [1.5, 1.2, 0], [-1.5, 1.2, 0.0]]),
        np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.7),
    )  # fmt: skip
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 30.0, (384, 288), eye=(0.2, -1.3, 2.4), target=(0, 0, 0.1)
    )
    return [sheet, ground], camera


def test_what_is_left_out_is_seen_nowhere_in_its_tile() -> None:
    surfaces, camera = scene()
    view = look(surfaces, camera, lit=True)
    receivers = Receivers(view)
    ids = visibility_twin(view).astype(np.int64) - 1
    row, column = np.nonzero(ids >= 0)
    tile = row // TILE, column // TILE
    # each pixel shows a triangle that isn't left out
    seen = ids[row, column]
    filled = np.isfinite(receivers.behind)
    sheet = np.zeros(filled.shape, bool)
    sheet[tile[0][view.body[seen] == 0], tile[1][view.body[seen] == 0]] = True
    filled &= sheet
    assert 0.03 < filled.mean() < 0.5
    assert (receivers.nearest[seen] <= receivers.behind[tile]).all()
    assert (view.body[seen][filled[tile]] == 0).all()
    edge_row, edge_column = np.divmod(bin_edges(view).pixel, camera.width)
    assert not filled[edge_row // TILE, edge_column // TILE].any()
    # and the ground is
    ground = np.flatnonzero(view.body == 1)
    pairs = receivers.pairs(ground, TILE)
    left = receivers.seen(pairs, receivers.points(pairs))
    np.testing.assert_array_equal(left, ~filled[pairs.tile[:, 1], pairs.tile[:, 0]])


def staircase() -> gs.Surface:
    """Small squares, a smooth step down beside them, and large faces beyond it, in one surface."""
    x, y = np.r_[np.linspace(-1.0, 0.0, 60), 0.004], np.linspace(-1.0, 1.0, 121)
    height = np.r_[np.zeros(60), -0.03]
    at = [np.stack(np.broadcast_arrays(x, y[:, None], height), axis=-1).reshape(-1, 3)]
    for u, w in ((0.012, -0.25), (0.016, -0.28), (1.0, -0.28)):
        at.append(np.stack(np.broadcast_arrays(u, y[::30], w), axis=-1))
    k = (np.arange(120)[:, None] * 61 + np.arange(60)).reshape(-1)
    q, j = np.arange(4), np.arange(120)
    border, first = 61 * np.arange(121) + 60, 61 * 121
    # 30 squares at the border, one face beyond it
    fan = np.stack([border[:-1], first + j // 30, border[1:], np.full(120, -1)], axis=1)
    ends = np.stack([border[30 * q + 30], first + q, first + q + 1, np.full(4, -1)], axis=1)
    long = [np.stack([c, c + 5, c + 6, c + 1], axis=1) for c in (first + q, first + 5 + q)]
    faces = np.concatenate([np.stack([k, k + 1, k + 62, k + 61], axis=1), fan, ends, *long])
    return gs.Surface(np.concatenate(at), faces, smooth_angle=np.pi)


def test_large_faces_down_a_step_are_seen_beside_small_ones() -> None:
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 40.0, (400, 300), eye=(0.3, -0.1, 2.5), target=(0.1, 0, 0)
    )
    view = look([staircase()], camera, lit=True)
    receivers = Receivers(view)
    assert np.isfinite(receivers.behind).any()
    ids = visibility_twin(view).astype(np.int64) - 1
    row, column = np.nonzero(ids >= 0)
    shown = np.unique(np.stack([ids[row, column], column // TILE, row // TILE]), axis=1)
    pairs = Pairs(shown[0], shown[1:].T, TILE)
    pairs = pairs[receivers.large[pairs.triangle]]
    assert receivers.seen(pairs, receivers.points(pairs)).all()


def tube(around: int, along: int) -> gs.Surface:
    """An open tube of large faces, lying across the picture."""
    turn, x = np.arange(around) * (2.0 * np.pi / around), np.linspace(-0.6, 0.6, along + 1)
    ring = np.stack([0.3 * np.cos(turn), 0.3 * np.sin(turn)], axis=1)
    points = np.concatenate([np.insert(ring, 0, at, axis=1) for at in x])
    k = np.arange(along)[:, None] * around + np.arange(around)
    after = np.roll(k, -1, axis=1)
    faces = np.stack([k, after, after + around, k + around], axis=-1).reshape(-1, 4)
    return gs.Surface(points, faces, gs.paint.Plain(0.5))


@pytest.mark.parametrize(("around", "along"), [(24, 10), (90, 60)])
def test_the_inside_of_a_tube_is_left_out_behind_its_outside(
    around: int, along: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # most of it isn't in view at all
    monkeypatch.setattr("gpusim.optics.covered.FEWEST", 10**9)
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 40.0, (400, 300), eye=(0.2, -0.4, 2.5), target=(0.0, 0.0, 0.0)
    )
    view = look([tube(around, along)], camera, lit=True)
    receivers = Receivers(view)
    ids = visibility_twin(view).astype(np.int64) - 1
    row, column = np.nonzero(ids >= 0)
    shown = np.unique(np.stack([ids[row, column], column // TILE, row // TILE]), axis=1)
    pairs = Pairs(shown[0], shown[1:].T, TILE)
    assert receivers.seen(pairs, receivers.points(pairs)).all()
    every = receivers.pairs(np.arange(view.count), TILE)
    seen = receivers.seen(every, receivers.points(every))
    behind = view.table.position[view.corner[every.triangle], 2].min(axis=1) > 2.7
    assert behind.mean() > 0.2
    assert seen[behind].mean() < 0.25
    assert seen[~behind].mean() > 0.8


def test_a_wall_that_faces_the_camera_is_seen_where_its_triangles_meet() -> None:
    """It is as near there as it is far, but for rounding."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, 6), np.linspace(-0.8, 0.8, 5), indexing="ij")
    points = np.stack([x + 0.1, y + 0.2, np.full_like(x, 0.3)], axis=-1).reshape(-1, 3)
    k = np.arange(30).reshape(6, 5)
    faces = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], -1).reshape(-1, 4)
    for depth in np.linspace(1.1, 1.9, 9):
        eye = (0.13, 0.21, 0.3 + depth)
        camera = gs.Camera.from_lens(
            (36.0, 27.0), 24.0, (400, 300), eye, (0.13, 0.21, 0.3), up=(0.0, 1.0, 0.0)
        )
        view = look([gs.Surface(points, faces, gs.paint.Plain(0.5))], camera, lit=True)
        receivers = Receivers(view)
        assert np.isfinite(receivers.behind).any()
        pairs = receivers.pairs(np.arange(view.count), TILE)
        assert receivers.seen(pairs, receivers.points(pairs)).all()


def test_leaving_them_out_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    surfaces, camera = scene()
    lamp = gs.AreaLight((0.4, -0.5, 2.1), (0.0, 0.1, 0.0), size=(0.3, 0.2), power=40.0)
    view = look(surfaces, camera, lit=True)
    ids = visibility_twin(view)
    monkeypatch.setattr("gpusim.optics.half_shadow.FEWEST", 10**9)  # joined faces depend on them
    few = Setup.build(view, [lamp], 0.0, surfaces)
    monkeypatch.setattr(
        Receivers, "seen", lambda self, pairs, points=None: np.ones(len(pairs.tile), bool)
    )
    every = Setup.build(view, [lamp], 0.0, surfaces)
    assert few.lighting.shadows is not None and every.lighting.shadows is not None
    assert len(few.lighting.shadows.face) < 0.9 * len(every.lighting.shadows.face)
    np.testing.assert_allclose(shade_twin(few, ids), shade_twin(every, ids), atol=1e-6)
