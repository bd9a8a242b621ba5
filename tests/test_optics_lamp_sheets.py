"""What sheets of casters hide altogether, and what nothing hides: never wrong, by rays."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics import caster_sets
from gpusim.optics.caster_sets import CasterSets
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import Lamp, lamps_of
from gpusim.optics.lamp_view import LampView
from gpusim.optics.light import Light
from gpusim.optics.receivers import Receivers
from gpusim.optics.sheet_blocks import SheetBlocks
from gpusim.optics.view import look
from tests.optics_rays import brute_share, triangles_of

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]

EYE = np.array([0.1, -1.0, 0.1])
CAMERA = gs.Camera.from_lens((36.0, 24.0), 45.0, (240, 160), tuple(EYE), (0.0, 0.0, 0.0))
LIGHTS: dict[str, Light] = {
    "point": gs.PointLight((-1.5, -0.35, 0.4), 50.0),
    "area": gs.AreaLight((-1.5, -0.35, 0.4), (0.0, 0.0, 0.0), (0.2, 0.1), 50.0),
    "disc": gs.AreaLight((-1.5, -0.6, 0.4), (0.0, 0.0, 0.0), (0.1, 0.1), 50.0, shape="ellipse"),
    "sun": gs.SunLight((1.0, 0.4, -0.3), 5.0, diameter=0.05),
    "sharp sun": gs.SunLight((1.0, 0.4, -0.3), 5.0, diameter=0.0),
}


def eggs(columns: int = 54, rows: int = 36) -> gs.Surface:
    """Bumps that a low lamp's light doesn't get behind."""
    x, z = np.linspace(-0.33, 0.33, columns + 1), np.linspace(-0.22, 0.22, rows + 1)
    X, Z = np.meshgrid(x, z, indexing="ij")
    y = 0.03 * np.sin(25.0 * X + 0.3) * np.sin(23.0 * Z)
    number = np.arange(X.size).reshape(X.shape)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    points = np.stack([X, y, Z], axis=-1).reshape(-1, 3)
    return gs.Surface(points, quads.reshape(-1, 4), gs.paint.Plain(0.8))


def told(light: Light, monkeypatch: pytest.MonkeyPatch) -> tuple[Lamp, Array, Flags, Flags, Array]:
    """Triangles in view that face the lamp, what is told of them, and the surface's triangles."""
    monkeypatch.setattr(caster_sets, "MANY", 0)
    surfaces = [eggs()]
    receivers = Receivers(look(surfaces, CAMERA, lit=True))
    (lamp,) = lamps_of([light])
    casters = Casters.of(surfaces, lambda points: None)
    sets = CasterSets(receivers, lamp, casters, np.zeros(receivers.view.count, bool))
    rows = np.flatnonzero(~receivers.turned_away(lamp))
    points = np.take(receivers.columns, rows, axis=2)[[0, 1, 2, 2]]
    dark, lit = sets.plain(points, rows)
    return lamp, points, dark, lit, triangles_of(surfaces)


@pytest.mark.parametrize("name", LIGHTS)
def test_what_is_told_is_so_by_rays(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lamp, points, dark, lit, triangles = told(LIGHTS[name], monkeypatch)
    assert not (dark & lit).any()
    # it tells of many, or it would be of no use
    assert dark.mean() > 0.02 and lit.mean() > 0.02
    random = np.random.default_rng(3)
    for flags, want in ((dark, 0.0), (lit, 1.0)):
        some = random.choice(np.flatnonzero(flags), min(60, int(flags.sum())), replace=False)
        weights = random.dirichlet((1.0, 1.0, 1.0), len(some))
        at = np.einsum("nk,kan->na", weights, points[:3, :, some])
        share = brute_share(lamp, at, triangles, 5)
        assert np.abs(share - want).max() == 0.0


def test_lamps_without_size_look_at_what_casts_shadows() -> None:
    middle = np.array([0.5, -0.2, 0.8])
    faces = middle[:, None, None] + np.random.default_rng(4).uniform(-0.1, 0.1, (3, 50, 4))
    (lamp,) = lamps_of([gs.PointLight((0.0, 0.0, -1.0), 1.0)])
    one, other = LampView.of(lamp, faces)
    way = faces.mean(axis=(1, 2)) - lamp.centre
    assert one.axis @ way > 0.99 * np.linalg.norm(way)
    np.testing.assert_allclose(other.axis, -one.axis)
    for view in (one, other):
        frame = np.stack([view.across, view.along, view.axis])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-12)


def test_blocks_of_cells_against_a_loop() -> None:
    """Sheets over a map of cells, some of which two sheets lie over, with gaps between."""
    random = np.random.default_rng(8)
    rows, columns, layers = 9, 13, 2
    node = np.arange(rows * columns * layers).reshape(layers, rows, columns)
    low, high = np.sort(random.uniform(0.0, 1.0, (2, node.size)), axis=0)
    there = random.uniform(size=node.shape) > 0.06
    right, below = np.full(node.size, -1), np.full(node.size, -1)
    goes_on = there[:, :, :-1] & there[:, :, 1:]
    right[node[:, :, :-1][goes_on]] = node[:, :, 1:][goes_on]
    goes_down = there[:, :-1] & there[:, 1:]
    below[node[:, :-1][goes_down]] = node[:, 1:][goes_down]
    blocks = SheetBlocks(right, below, low, high[None])
    sheet = random.integers(0, layers, 400)
    row, column = random.integers(0, rows - 1, 400), random.integers(0, columns - 1, 400)
    tall, wide = random.integers(2, 6, 400), random.integers(2, 8, 400)
    start = node[sheet, row, column]
    least, most = blocks.over(start, wide, tall)
    known = 0
    for k in range(400):
        rect = (sheet[k], slice(row[k], row[k] + tall[k]), slice(column[k], column[k] + wide[k]))
        fits = row[k] + tall[k] <= rows and column[k] + wide[k] <= columns
        if fits and there[rect].all():
            known += 1
            assert least[k] == low[node[rect]].min() and most[0, k] == high[node[rect]].max()
        else:
            assert least[k] == -np.inf and most[0, k] == np.inf
    assert 50 < known < 350
    # ways back end where they began
    far = blocks.moved(start, np.minimum(wide, columns - 1 - column), np.zeros(400, np.int64))
    back = blocks.moved(far, -np.minimum(wide, columns - 1 - column), np.zeros(400, np.int64))
    arrived = far < node.size
    assert arrived.any() and (back[arrived] == start[arrived]).all()
