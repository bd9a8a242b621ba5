"""Large triangles cut near the few features on them: the same picture, less of it patterned."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics.geometry import view as view_module
from gpusim.optics.geometry.sparse import SPARSE_EDGE, Sparse
from gpusim.optics.geometry.view import look
from gpusim.optics.shading.setup import Setup

Array = npt.NDArray[np.float64]
CENTRES = np.array([[-0.31, 0.12], [0.22, -0.17], [0.4, 0.21]])


def wall(paint: gs.paint.Markers) -> gs.Surface:
    """A wall of 1.2 x 0.8, seen at an angle."""
    points = np.array([[-0.6, 0.1, -0.4], [0.6, -0.05, -0.4], [0.6, -0.05, 0.4], [-0.6, 0.1, 0.4]])
    s = points[1] - points[0]
    frame = gs.PaintFrame(np.array([0.0, 0.025, 0.0]), s / np.linalg.norm(s), np.eye(3)[2])
    faces = np.array([[0, 1, 2, 3]])
    return gs.Surface(points, faces, {"wall": paint}, frames={"wall": frame})


def camera(distortion: list[float] | None) -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (615, 411), (0.1, -1.0, 0.05), (0.0, 0.0, 0.0), distortion=distortion
    )


@pytest.mark.parametrize("distortion", [None, [-0.08, 0.02, 0.0, 0.0]])
def test_picture_stays_the_same(
    distortion: list[float] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = wall(gs.paint.Markers(CENTRES, 0.03, 0.1, 0.9, 0.5))
    lights = [gs.AreaLight((-0.7, -1.4, 0.9), (0.0, 0.0, 0.0), (0.25, 0.2), 30.0)]
    cut = gs.render([surface], camera(distortion), lights, background=7.0)
    monkeypatch.setattr(view_module, "sparse_excess", lambda surface, st: None)
    whole = gs.render([surface], camera(distortion), lights, background=7.0)
    assert cut.view.count > whole.view.count + 50
    difference = np.abs(cut.radiance - whole.radiance)
    # no cracks, which would show the background; float32 rounds 0.0003 px of the edges
    assert difference.max() <= 5e-4 * whole.radiance[5:-5, 5:-5].max()
    assert np.sqrt((difference**2).mean()) <= 1e-5


def test_most_of_the_wall_is_plain() -> None:
    view = look([wall(gs.paint.Markers(CENTRES, 0.03, 0.1, 0.9, 0.5))], camera(None), lit=False)
    setup = Setup.build(view, None, 0.0)
    a, b = view.screen[:, 1] - view.screen[:, 0], view.screen[:, 2] - view.screen[:, 0]
    area = 0.5 * np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    assert area[setup.near_feature].sum() < area.sum() / 3.0
    sides = np.linalg.norm(np.roll(view.screen, -1, axis=1) - view.screen, axis=2)
    assert sides[setup.near_feature].max() <= 2.1 * SPARSE_EDGE
    assert view.count < 800


def test_dense_patterns_are_left_whole() -> None:
    grid = np.stack(np.meshgrid(np.linspace(-0.55, 0.55, 23), np.linspace(-0.35, 0.35, 15)), -1)
    paint = gs.paint.Markers(grid.reshape(-1, 2), 0.03, 0.1, 0.9, 0.5)
    low, high = np.array([-0.6, -0.4]), np.array([0.6, 0.4])
    assert Sparse.of(paint, low, high) is None
    assert Sparse.of(gs.paint.Plain(0.4), low, high) is None
    assert Sparse.of(gs.paint.Markers(CENTRES, 0.03), low, high) is not None


def test_edges_near_features_are_found() -> None:
    grid = Sparse.of(gs.paint.Markers(CENTRES, 0.03), np.array([-0.6, -0.4]), np.array([0.6, 0.4]))
    assert grid is not None
    start = np.array([[-0.4, 0.1], [-0.59, -0.39], [0.1, 0.05], [0.1, 0.05]])
    end = np.array([[-0.2, 0.15], [-0.5, -0.3], [0.12, 0.06], [0.3, -0.1]])
    assert grid.near(start, end).tolist() == [True, False, False, True]
    assert grid.near(end, start).tolist() == [True, False, False, True]
