"""Flat parts of meshes joined for shadows: what is joined, what isn't, and that shadows stay."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics import faces_before, lamp_merging
from gpusim.optics.casters import Casters
from gpusim.optics.merging import merge_flat
from gpusim.optics.setup import Setup
from gpusim.optics.shade import shade_twin
from gpusim.optics.view import look
from gpusim.optics.visibility import visibility_twin


def strip(columns: int, rows: int, sag: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and quads of a sheet 1.2 x 0.5, bent by ``sag`` along x."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = np.stack([1.2 * u, 0.5 * v, 4 * sag * u * (1 - u)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(columns), np.arange(rows))
    a = (j * (columns + 1) + i).reshape(-1)
    return points, np.stack([a, a + 1, a + columns + 2, a + columns + 1], axis=1)


def test_a_flat_sheet_becomes_one_face() -> None:
    points, faces = strip(7, 3, 0.0)
    merged = merge_flat(points, faces, np.full(len(points), 1e-9))
    assert len(merged.faces) == 1 and set(merged.owner) == {0}
    corners = points[merged.faces[0]]
    np.testing.assert_allclose(
        np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1), [1.2, 0.5, 1.2, 0.5]
    )
    # what is left are the 2 * (7 + 3) edges of the border, each on its side of the joined face
    face, place = np.nonzero(~merged.inner)
    assert len(face) == 20
    np.testing.assert_array_equal(np.bincount(place), [7, 3, 7, 3])
    ends = points[faces[face, (place + 1) % 4]] - points[faces[face, place]]
    sides = np.roll(corners, -1, axis=0) - corners
    turned = np.linalg.norm(np.cross(ends, sides[place]), axis=1)
    np.testing.assert_allclose(turned, 0.0, atol=1e-12)


@pytest.mark.parametrize("tolerance", [1e-5, 1e-4, 1e-3])
def test_a_bent_sheet_keeps_to_its_tolerance(tolerance: float) -> None:
    points, faces = strip(64, 3, 0.02)
    merged = merge_flat(points, faces, np.full(len(points), tolerance))
    assert 4 <= len(merged.faces) <= 64
    for number, quad in enumerate(points[merged.faces]):
        inside = points[faces[merged.owner == number]].reshape(-1, 3)
        normal = np.cross(quad[2] - quad[0], quad[3] - quad[1])
        gap = np.abs((inside - quad.mean(axis=0)) @ normal) / np.linalg.norm(normal)
        assert gap.max() <= 2.0 * tolerance


def test_without_tolerance_and_triangles_nothing_is_joined() -> None:
    points, faces = strip(5, 2, 0.0)
    assert len(merge_flat(points, faces, None).faces) == 10
    triangles = np.concatenate([faces[:, [0, 1, 2, 2]], faces[:, [0, 2, 3, 3]]])
    merged = merge_flat(points, triangles, np.full(len(points), 1e-6))
    np.testing.assert_array_equal(merged.faces, triangles)
    assert not merged.inner.any()


def test_joined_faces_cast_the_same_shadow(monkeypatch: pytest.MonkeyPatch) -> None:
    points, faces = strip(24, 6, 0.004)
    turn = np.array([[0.96, 0.28, 0.0], [-0.28, 0.96, 0.0], [0.0, 0.0, 1.0]])
    placed = points @ turn + np.array([-0.4, -0.3, 0.3])
    sheet = gs.Surface(placed, faces, paint=gs.paint.Plain(0.4))
    ground = gs.Surface(
        np.array([[-1.5, -1.2, 0], [1.5, -1.2, 0], [1.5, 1.2, 0], [-1.5, 1.2, 0.0]]),
        np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.7),
    )  # fmt: skip
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 30.0, (96, 72), eye=(0.2, -2.0, 2.4), target=(0, 0, 0.1)
    )
    lamp = gs.AreaLight((0.9, -0.4, 2.1), (0.0, 0.1, 0.0), size=(0.3, 0.2), power=40.0)
    view = look([sheet, ground], camera, lit=True)
    ids = visibility_twin(view)
    setup = Setup.build(view, [lamp], 0.0, [sheet, ground])
    joined = setup.lighting.shadows
    got = shade_twin(setup, ids)
    alone = Casters.of
    monkeypatch.setattr(Casters, "of", staticmethod(lambda surfaces, *_: alone(surfaces)))
    setup = Setup.build(view, [lamp], 0.0, [sheet, ground])
    single = setup.lighting.shadows
    want = shade_twin(setup, ids)
    assert joined is not None and single is not None
    assert len(joined.corners) < 0.5 * len(single.corners)
    assert len(joined.face) < 0.6 * len(single.face)
    changed = np.abs(got - want)
    assert (changed <= 3.0 / 512 * want.max()).all() and (changed > 0).mean() < 0.05


def test_wide_penumbrae_take_more_faces_joined(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bent sheet that stands on the ground: exact faces near its foot, joined ones farther."""
    points, faces = strip(160, 4, 0.004)
    upright = np.stack([points[:, 1] - 0.2, points[:, 2] + 0.1, points[:, 0]], axis=1)
    sheet = gs.Surface(upright, faces, paint=gs.paint.Plain(0.4))
    ground = gs.Surface(
        np.array([[-1.5, -1.2, 0], [1.5, -1.2, 0], [1.5, 2.5, 0], [-1.5, 2.5, 0.0]]),
        np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.7),
    )  # fmt: skip
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 30.0, (512, 384), eye=(1.9, -1.4, 2.4), target=(0, 0.7, 0.3)
    )
    lamp = gs.AreaLight((0.4, -2.4, 2.1), (0.0, 0.1, 0.0), size=(0.3, 0.2), power=40.0)
    view = look([sheet, ground], camera, lit=True)
    ids = visibility_twin(view)
    setup = Setup.build(view, [lamp], 0.0, [sheet, ground])
    joined, got = setup.lighting.shadows, shade_twin(setup, ids)
    monkeypatch.setattr(lamp_merging, "WORTH", 0.0)
    setup = Setup.build(view, [lamp], 0.0, [sheet, ground])
    single, want = setup.lighting.shadows, shade_twin(setup, ids)
    assert joined is not None and single is not None
    assert len(joined.face) < 0.6 * len(single.face)
    lists = {
        tuple(place): set(map(bytes, tiles.corners[tiles.face[a : a + n]]))
        for tiles in (joined,)
        for place, a, n in zip(tiles.place, tiles.start[:, 0], tiles.count[:, 0], strict=True)
    }
    exact = {
        tuple(place): set(map(bytes, single.corners[single.face[a : a + n]]))
        for place, a, n in zip(single.place, single.start[:, 0], single.count[:, 0], strict=True)
    }
    same = [place for place in exact if lists.get(place) == exact[place]]
    assert 0 < len(same) < 0.5 * len(exact)
    changed = np.abs(got - want)
    assert (changed <= 1.5 / 512 * want.max()).all() and (changed > 0).mean() < 0.05


def test_a_ray_between_faces_lights_no_tile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Joined faces needn't meet corner by corner; a tile in the umbra has one ray."""
    points, faces = strip(24, 6, 0.004)
    sheet = gs.Surface(points + np.array([-0.4, -0.3, 0.7]), faces, paint=gs.paint.Plain(0.4))
    ground = gs.Surface(
        np.array([[-1.5, -1.2, 0], [1.5, -1.2, 0], [1.5, 1.2, 0], [-1.5, 1.2, 0.0]]),
        np.array([[0, 1, 2, 3]]), paint=gs.paint.Plain(0.7),
    )  # fmt: skip
    camera = gs.Camera.from_lens(
        (36.0, 27.0), 30.0, (256, 192), eye=(0.2, -2.6, 2.4), target=(0.2, -0.3, 0)
    )
    lamp = gs.AreaLight((0.3, 0.9, 2.9), (0.1, 0.0, 0.0), size=(0.1, 0.05), power=40.0)
    view = look([sheet, ground], camera, lit=True)
    ids = visibility_twin(view)
    setup = Setup.build(view, [lamp], 0.0, [sheet, ground])
    before, want = setup.lighting.shadows, shade_twin(setup, ids)
    monkeypatch.setattr(faces_before, "meets_middle", lambda lamp, at, *_: np.zeros(len(at), bool))
    setup = Setup.build(view, [lamp], 0.0, [sheet, ground])
    after, got = setup.lighting.shadows, shade_twin(setup, ids)
    assert before is not None and after is not None
    assert ((before.lit & 1) == 0).any()  # tiles in the umbra
    assert len(after.place) > len(before.place)
    assert np.abs(got - want).max() <= 1e-6 * want.max()
