"""Edges of casters that receivers look at, and casters joined in a lamp's view."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.casters import Casters
from gpusim.optics.emitters import lamps_of
from gpusim.optics.lamp_grid import LampGrid
from gpusim.optics.lamp_merging import joined_grids
from gpusim.optics.lamp_view import LampView
from gpusim.optics.light import AreaLight, PointLight, SunLight
from tests.test_optics_merging import strip

LIGHTS = {
    "area": AreaLight((0.3, -1.5, 1.2), (0.0, 0.0, 0.0), (0.3, 0.2), 10.0),
    "point": PointLight((0.3, -1.5, 1.2), 10.0),
    "sun": SunLight((-0.2, 1.0, -0.8), 1.0, diameter=0.1),
}


@pytest.mark.parametrize("light", LIGHTS)
def test_all_of_the_lamp_lies_inside_of_edges_that_arent_needed(light: str) -> None:
    """Against the outlines themselves: receivers in small boxes, points of the lamp's face."""
    rng = np.random.default_rng(3)
    (lamp,) = lamps_of([LIGHTS[light]])
    quads = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [0.3, 0.2, 1.0]
    turns = np.linalg.qr(rng.normal(size=(60, 3, 3)))[0]
    corners = quads @ turns + rng.uniform(-0.2, 0.2, (60, 1, 3))
    surface = gs.Surface(corners.reshape(-1, 3), np.arange(240).reshape(-1, 4))
    casters = Casters.of([surface])
    faces = casters.seen_by(lamp, np.array([[0.0], [9.0], [-9.0]]))
    checked = some = 0
    for view in LampView.of(lamp):
        grid = LampGrid(view, casters, faces, -np.inf)
        known = np.flatnonzero(grid.edges.known)
        caster = np.repeat(known, 40)
        middle = rng.uniform(-1.0, 1.0, (len(caster), 3)) + np.array([0.1, 1.5, -1.2])
        points = np.moveaxis(middle + rng.uniform(-0.02, 0.02, (4, len(caster), 3)), 1, 2)
        needed = grid.edges.needed(view.reach(points), np.arange(len(caster)), caster)
        weight = rng.dirichlet(np.ones(4), len(caster)).T
        at = np.einsum("kn,kan->na", weight, points)
        ab = rng.choice([-1.0, 1.0], (2, len(caster), 1))
        to = lamp.centre + ab[0] * lamp.u + ab[1] * lamp.v - (0.0 if lamp.far else 1.0) * at
        D = casters.corners[grid.face[caster]] - at[:, None]
        planes = np.cross(D, np.roll(D, -1, axis=1))
        # of what is on the lamp's side of a face it hides nothing
        height = np.sum(planes.sum(axis=1) * D.mean(axis=1), axis=1)
        hides = height * grid.side[caster] > 1e-9
        inside = np.sign(height)[:, None] * np.einsum("nka,na->nk", planes, to) >= 0.0
        asked = (needed[:, None] >> np.arange(4) & 1).astype(bool)
        assert (inside | asked)[hides].all()
        checked += int(hides.sum())
        some += int((~asked & inside)[hides].sum())
    assert checked > 300 and some > 0.2 * checked


def test_a_sheet_bent_towards_its_lamp_is_joined_in_its_view() -> None:
    """In space nothing of it is flat enough; the lamp sees it from the front."""
    points, quads = strip(200, 4, 0.03)
    sheet = gs.Surface(points + np.array([-0.6, -0.25, 0.5]), quads)
    (lamp,) = lamps_of([AreaLight((0.0, 0.0, 2.5), (0.0, 0.0, 0.0), (0.2, 0.2), 5.0)])
    casters = Casters.of([sheet], lambda at: np.full(len(at), 1e-7))
    faces = casters.seen_by(lamp, np.zeros((3, 1)))
    assert len(faces.face) >= 200
    (view,) = LampView.of(lamp)
    rise = 1.0 / 2.0 - 1.0 / 2.5
    grid = LampGrid(view, casters, faces, 1.0 / 2.5)
    ((joined, own),) = joined_grids(grid, casters, faces, [0.5 * rise])
    assert own.count < 0.15 * len(faces.face)
    np.testing.assert_allclose(joined.normal.sum(axis=0), casters.normal.sum(axis=0), atol=1e-12)
    # its outline is that of the sheet, and all of it is a rim
    p, q, _ = view.place(*np.moveaxis(joined.corners, 2, 0))
    every = view.place(*sheet.points.T)
    for found, want in ((p, every[0]), (q, every[1])):
        assert np.ptp(found) == pytest.approx(np.ptp(want), rel=1e-3)
    length = np.linalg.norm(np.roll(joined.corners, -1, axis=1) - joined.corners, axis=2)
    assert length[own.rim].sum() == pytest.approx(2 * (1.2 + 0.5), rel=0.01)
    # a receiver too near to it is told apart
    near = view.reach(np.array([[0.0, 0.0, 0.45], [0.0, 0.0, 0.0]]).T[None].repeat(4, axis=0))
    box, caster = np.repeat([0, 1], own.count), np.tile(np.arange(own.count), 2)
    assert set(own.near(near, box, caster)) == {0}
