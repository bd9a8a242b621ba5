"""Whole elements before a plane, with the numbers and the paint that they had."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.surface import Skin
from gpusim.view.content.cut import INSIDE, Cut, cut_body
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer


@pytest.mark.parametrize(("beyond", "cells"), [(False, [0, 1]), (True, [2, 3, 4])])
def test_what_is_left_of_a_bar(beyond: bool, cells: list[int]) -> None:
    bar = gs.mesh.box(size=(5.0, 2.0, 1.0), divisions=(5, 1, 1))
    skin = Skin(bar, gs.mesh.boundary_faces(bar))
    region = (skin.faces.centroids[:, 2] > 0.99).astype(np.int32)
    white, black = gs.paint.Plain(0.9), gs.paint.Plain(0.1)
    surface = skin.surface({"white": white, "black": black}, region, {}, "bar")
    kept = Cut(0, 0.4, beyond).kept(bar, bar.bounds)
    assert np.flatnonzero(kept).tolist() == cells
    part, shown = cut_body(skin, surface, kept)
    assert sorted(set(part.cell_of_piece.tolist())) == cells
    length = len(cells)
    assert part.faces.areas.sum() == pytest.approx(2 * 2.0 + length * (2 * 2.0 + 2 * 1.0))
    centre = part.faces.centroids[part.face_of_piece]
    names = np.array(list(shown.paints))[shown.regions]
    bare = np.abs(centre[:, 0] - 2.0) < 1e-9
    assert set(names[bare]) == {INSIDE} and INSIDE not in names[~bare]
    np.testing.assert_array_equal(names[~bare] == "black", centre[~bare, 2] > 0.99)
    outward = part.faces.centroids - bar.points[bar.cells["hex8"][part.faces.cell]].mean(axis=1)
    corners = part.faces.corners
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert ((normal * outward).sum(axis=1) > 0.0).all()


def test_quadratic_elements() -> None:
    bar = gs.mesh.quadratic(gs.mesh.box(size=(4.0, 1.0, 1.0), divisions=(4, 1, 1)))
    skin = Skin(bar, gs.mesh.boundary_faces(bar))
    surface = skin.surface({"": gs.paint.Plain()}, np.zeros(len(skin.faces), np.int32), {}, "bar")
    kept = Cut(0, 0.5).kept(bar, bar.bounds)
    part, shown = cut_body(skin, surface, kept)
    assert part.faces.is_quadratic.all() and 0 < kept.sum() < bar.cell_count
    np.testing.assert_allclose(part.at_vertices(bar.points), shown.points)
    assert shown.points[:, 0].max() < 3.01


def test_keys_cut_and_move(run_viewer: Viewer) -> None:
    """All fields, frames and selections go on; what isn't cut is as before."""
    viewer = run_viewer
    content = viewer.content
    assert content is not None
    viewer.show_field("von_mises")
    whole = screenshot(viewer)

    def reach() -> list[float]:
        along = content.surfaces(0)[0].points[:, 0]
        return [round(1e3 * float(one)) for one in (along.min(), along.max())]

    viewer.key("k")
    assert reach() == [0, 120] and "x = 120 mm" in content.cut.describe(content.bounds)  # type: ignore
    assert (screenshot(viewer) != whole).mean() > 0.01 and viewer.fault == ""
    viewer.key("PageUp")
    viewer.key("PageUp")
    assert reach() == [0, 140]  # elements are 20 mm long: whole ones
    viewer.key("j")
    assert reach() == [140, 240]
    x, y = viewer.place.window(viewer.camera()[0].project(np.array([0.14, 0.009, 0.008])))
    viewer.look(viewer.view.side("right").side("front"))
    for key in ("k", "PageUp", "m", "u", "o", "x", "g", "ArrowLeft", "ArrowRight"):
        viewer.key(key)
        screenshot(viewer)
        assert viewer.fault == "", key
    viewer.key("r")
    assert content.cut is None and reach() == [0, 240]
    assert np.isfinite([x, y]).all()


def test_a_body_beyond_the_plane_is_gone(run_viewer: Viewer) -> None:
    viewer = run_viewer
    viewer.cut_at(Cut(0, -0.5))
    screenshot(viewer)
    assert viewer.fault == "" and viewer.picture.base is not None
    assert not viewer.picture.base.ids().any()
