"""The grid in which receivers look for what hides a lamp from them."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import lamps_of
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_view import LampView

LIGHTS = {
    "point": gs.PointLight((0.3, -1.5, 1.2), 10.0),
    "area": gs.AreaLight((0.3, -1.5, 1.2), (0.0, 0.0, 0.0), (0.3, 0.2), 10.0),
    "sun": gs.SunLight((0.3, 0.8, -1.0), 1.0),
}


def strips(rng: np.random.Generator, count: int) -> gs.Surface:
    """Long thin quads that lie aslant, the corners of every other one not in a plane."""
    middle = rng.uniform(-0.4, 0.4, (count, 1, 3))
    way = rng.normal(size=(count, 1, 3))
    way *= 0.5 / np.linalg.norm(way, axis=2, keepdims=True)
    across = 0.03 * rng.normal(size=(count, 1, 3))
    sign = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])[None, :, :, None]
    points = middle + sign[:, :, 0] * way + sign[:, :, 1] * across
    points[::2] += 0.01 * rng.normal(size=points[::2].shape)
    return gs.Surface(points.reshape(-1, 3), np.arange(4 * count).reshape(-1, 4))


def grids(light: str, casters: Casters) -> list[LampGrid]:
    (lamp,) = lamps_of([LIGHTS[light]])
    faces = casters.seen_by(lamp, np.array([[0.0], [9.0], [-9.0]]))
    return [LampGrid(view, casters, faces, -np.inf) for view in LampView.of(lamp)]


@pytest.mark.parametrize("light", LIGHTS)
def test_nothing_of_a_caster_lies_above_the_heights_of_its_cells(light: str) -> None:
    rng = np.random.default_rng(5)
    casters = Casters.of([strips(rng, 40)])
    checked = 0
    for grid in grids(light, casters):
        corners = casters.corners[grid.face]
        share = rng.dirichlet(np.ones(4), (300, len(corners)))
        points = np.concatenate([np.einsum("nfk,fka->nfa", share, corners).reshape(-1, 3),
                                 corners.reshape(-1, 3)])  # fmt: skip
        p, q, s = grid.view.place(*points.T)
        known = np.isfinite(s)
        size = np.array(grid.shape)
        column = np.floor((grid._mapped(p[known]) - grid.origin[0]) / grid.size[0]).astype(int)
        row = np.floor((grid._mapped(q[known]) - grid.origin[1]) / grid.size[1]).astype(int)
        assert (row >= 0).all() and (row < size[0]).all()
        top = grid.pyramid[row * size[1] + column]
        assert (s[known] <= top + 1e-12 * np.abs(top)).all()
        checked += int(known.sum())
    assert checked > 10_000


@pytest.mark.parametrize("light", LIGHTS)
def test_a_strip_aslant_leaves_the_cells_beside_it_empty(light: str) -> None:
    casters = Casters.of([strips(np.random.default_rng(8), 1)])
    (grid, *_) = (grid for grid in grids(light, casters) if grid.count)
    top = grid.pyramid[: int(np.prod(grid.shape))]
    assert 0.0 < np.isfinite(top).mean() < 0.7  # the rectangle around it fills all of them
    assert np.ptp(top[np.isfinite(top)]) > 0.05 * np.abs(grid.highest[0])  # and it isn't level


def wall_and_cells(light: str = "area") -> LampGrid:
    """Small faces before a wall that runs far past the lamp."""
    rng = np.random.default_rng(3)
    wall = np.array([[-9.0, 0.3, -9.0], [9.0, 0.3, -9.0], [9.0, 0.3, 1.15], [-9.0, 0.3, 1.15]])
    surfaces = [strips(rng, 300), gs.Surface(wall, np.array([[0, 1, 2, 3]]))]
    casters = Casters.of(surfaces)
    (lamp,) = lamps_of([LIGHTS[light]])
    faces = casters.seen_by(lamp, np.array([[0.0], [9.0], [-9.0]]))
    (view,) = LampView.of(lamp)
    return LampGrid(view, casters, faces, -np.inf)


def test_windows_hold_every_caster_that_may_hide() -> None:
    """And they are narrow in spite of a wall that is near the lamp somewhere."""
    grid, rng = wall_and_cells(), np.random.default_rng(4)
    points = rng.uniform([-0.5, 0.25, -0.5], [0.5, 0.3, 0.5], (400, 3)).T[None] * np.ones((4, 1, 1))
    reach = grid.view.reach(points)
    box, caster = grid.candidates(reach)
    found = set(zip(box.tolist(), caster.tolist(), strict=True))
    rise = grid.highest[None] - reach.s[0][:, None]
    near = rise > 0.0
    for half, own, other in zip(
        grid.view.half, (reach.p, reach.q), (grid.reach.p, grid.reach.q), strict=True
    ):
        near &= other[0] - half * rise <= own[1][:, None]
        near &= other[1] + half * rise >= own[0][:, None]
    # a long face's cells tell more than the box around it
    wall = len(grid.highest) - 1
    want = {pair for pair in zip(*(v.tolist() for v in np.nonzero(near)), strict=True)}
    assert {pair for pair in want - found if pair[1] != wall} == set()
    first, last = grid._window(reach, grid.top(reach))
    own = (last - first)[:, grid.top(reach) > -np.inf]
    first, last = grid._window(reach, np.full(len(reach.s[0]), grid.pyramid[-1]))
    assert own.shape[1] > 100 and np.median(own) < 0.1 * np.median(last - first)
