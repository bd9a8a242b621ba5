"""Speckle on fine meshes: the same pictures, however little is looked at for them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics.geometry import pattern_seams, pixel_footprint
from gpusim.optics.geometry.pattern_seams import speckle_jumps
from gpusim.optics.geometry.view import look
from gpusim.surface.speckle import Speckle

Array = npt.NDArray[np.float64]

EYE = (0.07, -0.84, 0.05)
CAMERA = gs.Camera.from_lens((36.0, 24.0), 46.0, (361, 242), EYE, (0.0, 0.0, 0.01))
HARD = Speckle(0.021, seed=3)


def sheet(paint: Speckle = HARD, height: float = 0.01) -> gs.Surface:
    """A wavy sheet of 10,800 triangles."""
    x, z = np.meshgrid(np.linspace(-0.31, 0.29, 91), np.linspace(-0.2, 0.21, 61))
    flat = np.stack([x, 0.0 * x, z], axis=-1).reshape(-1, 3)
    node = np.arange(len(flat)).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    points = flat.copy()
    points[:, 1] += height * np.sin(9.0 * flat[:, 0] + 4.0 * flat[:, 2])
    return gs.Surface(points, faces.reshape(-1, 4), paint, reference=flat)


def cosines(surface: gs.Surface) -> Array:
    """Between the triangles' normals and the line of sight to their middles."""
    corners = surface.points[surface.topology.triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    away = corners.mean(axis=1) - EYE
    size = np.linalg.norm(normal, axis=1) * np.linalg.norm(away, axis=1)
    result: Array = np.abs((normal * away).sum(axis=1)) / size
    return result


def test_edges_that_bend_are_those_that_a_look_at_all_finds() -> None:
    surface = sheet(height=0.15)
    topology, kept = surface.topology, np.arange(len(surface.topology.triangles))
    st = surface.rest[topology.triangles][:, :, [0, 2]]
    points = surface.points @ CAMERA.camera_from_world[:3, :3].T + CAMERA.camera_from_world[:3, 3]
    ideal = points @ CAMERA.K.T
    ideal = ideal[:, :2] / ideal[:, 2:]
    own = np.ones(len(kept), bool)
    own[::7] = False
    found = [
        speckle_jumps(
            topology, kept, own, lambda rows: st[rows], points, ideal, HARD.diameter, whole
        )
        for whole in (False, True)
    ]
    assert np.array_equal(*(np.sort(edges) for edges in found))
    steep = cosines(surface) < pattern_seams.STEEP
    assert len(found[0]) and steep.any() and not steep.all()


def test_largest_pixels_are_the_same_by_a_look_at_few(monkeypatch: pytest.MonkeyPatch) -> None:
    reaches = []
    for many in (pixel_footprint.MIN_TRIANGLES_FOR_BOUNDS, 10**9):
        monkeypatch.setattr(pixel_footprint, "MIN_TRIANGLES_FOR_BOUNDS", many)
        view = look([sheet(height=0.03)], CAMERA, lit=True)
        reaches.append(view.paints[0].reach)
    assert reaches[0] == reaches[1] > 0.0
