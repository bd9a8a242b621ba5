"""What is under a pixel is what the ground truth says, to the element."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.optics.rendering.local_origin import local_view
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.view.content.picking import pick
from tests.support.view_bodies import camera_before, small_crane


@pytest.mark.parametrize("distortion", [None, [-0.2, 0.05, 1e-3, -2e-3]])
def test_every_pixel_is_told_as_the_truth_has_it(distortion: list[float] | None) -> None:
    crane = small_crane()
    surfaces = [crane.moved, crane.wall]
    frame = gs.render(surfaces, camera_before(distortion), backend="numpy")
    ids, truth = frame.ids(), frame.truth()
    bodies = len(crane.surface.faces)
    own = np.flatnonzero(truth.face < bodies)
    rng = np.random.default_rng(3)
    # silhouettes among them: pixels of the crane beside others
    chosen = np.concatenate([rng.choice(own, 150, False), rng.choice(len(truth.face), 50, False)])
    for k in chosen:
        found = pick(frame.view, ids, surfaces, truth.column[k], truth.row[k], [crane.skin])
        assert found is not None
        face = int(truth.face[k])
        assert found.reference == pytest.approx(truth.reference[k], abs=1e-9)
        surface = surfaces[found.surface]
        now = found.weights @ surface.points[found.vertices]
        assert frame.view.camera.to_camera(now)[2] == pytest.approx(truth.depth[k], rel=1e-9)
        assert now - found.reference == pytest.approx(truth.displacement[k], abs=1e-9)
        if face >= bodies:
            assert (found.name, found.surface, found.face) == ("wall", 1, face - bodies)
            assert found.element is found.node is None and found.sets == ()
            continue
        assert (found.name, found.surface, found.face) == ("crane", 0, face)
        assert found.paint == ("side" if truth.normal[k, 1] < -0.9 else "steel")
        assert found.element == crane.skin.cell_of_piece[face]
        pairs = crane.model.mesh.face_sets
        skin_face = crane.skin.face_of_piece[face]
        own = [crane.skin.faces.cell[skin_face], crane.skin.faces.local[skin_face]]
        assert found.sets == tuple(name for name in pairs if own in pairs[name].tolist())
        cells = crane.model.mesh.cells["hex8"][found.element]
        assert found.node in cells
        near = crane.model.mesh.points[crane.skin.faces.nodes[face]] - truth.reference[k]
        best = np.linalg.norm(near, axis=1).min()
        gap = float(np.linalg.norm(crane.model.mesh.points[found.node] - truth.reference[k]))
        assert gap == pytest.approx(best, abs=1e-9)


def test_between_pixels_the_place_goes_on() -> None:
    crane = small_crane()
    frame = gs.render([crane.moved, crane.wall], camera_before(), backend="numpy")
    ids = frame.ids()
    row, column = (int(v) for v in np.argwhere(ids == ids[ids > 0].max())[40])
    at = (column + 0.3, row - 0.4)
    found = pick(frame.view, ids, [crane.moved, crane.wall], *at)
    assert found is not None
    surface = [crane.moved, crane.wall][found.surface]
    now = found.weights @ surface.points[found.vertices]
    assert frame.view.camera.project(now) == pytest.approx(at, abs=1e-9)


def test_nothing_and_outside() -> None:
    crane = small_crane()
    frame = gs.render([crane.moved], camera_before(), backend="numpy")
    ids = frame.ids()
    assert ids[2, 2] == 0 and pick(frame.view, ids, [crane.moved], 2, 2) is None
    for column, row in ((-1, 5), (231, 5), (5, 154), (5, -0.51)):
        assert pick(frame.view, ids, [crane.moved], column, row) is None


def test_far_from_zero_as_well() -> None:
    crane, far = small_crane(), np.array([3.1e6, -2.2e5, 140.0])
    surface = gs.Surface(crane.moved.points + far, crane.moved.faces, name="far")
    T = camera_before().camera_from_world.copy()
    T[:3, 3] -= T[:3, :3] @ far
    there = gs.Camera(231, 154, camera_before().K, camera_from_world=T)
    view = local_view([surface], there, lit=False)
    assert view.origin.any()
    ids = visibility_twin(view)
    row, column = (int(v) for v in np.argwhere(ids)[17])
    found = pick(view, ids, [surface], column, row)
    assert found is not None
    assert there.project(found.reference) == pytest.approx([column, row], abs=1e-4)
    now = found.weights @ surface.points[found.vertices]
    assert now == pytest.approx(found.reference, abs=1e-6)
