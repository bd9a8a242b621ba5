"""Which lines of a mesh are drawn: borders of elements, creases, silhouettes."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.visualization.mesh_edges import crease_edges, element_edges
from gpusim.visualization.overlay import Overlay
from gpusim.visualization.symbols import Symbols
from tests.support.view_bodies import small_crane


def skin_of(mesh: gs.Mesh) -> tuple[gs.Skin, gs.Surface]:
    faces = gs.mesh.boundary_faces(mesh)
    skin = gs.Skin(mesh, faces)
    surface = skin.surface({"": gs.paint.Plain()}, np.zeros(len(faces), np.int32), {}, "body")
    return skin, surface


def lengths(ends: np.ndarray) -> np.ndarray:
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def test_borders_of_bricks() -> None:
    a, b, c = 3, 2, 4
    skin, surface = skin_of(gs.mesh.box(size=(3, 2, 4), divisions=(a, b, c)))
    found = element_edges(surface, skin)
    # two sheets of each kind, less what two of them share
    count = 2 * (2 * a * b + 2 * b * c + 2 * c * a)
    assert len(found) == count and lengths(found) == pytest.approx(1.0)
    assert len(crease_edges(surface)) == 4 * (a + b + c)


def test_borders_of_curved_elements_come_in_pieces() -> None:
    mesh = gs.mesh.quadratic(gs.mesh.box(size=(1, 1, 1), divisions=(2, 2, 2)))
    skin, surface = skin_of(mesh)
    found = element_edges(surface, skin)
    assert lengths(found).sum() == pytest.approx(48 * 0.5)
    off = np.abs(found - 0.5).max(axis=2)
    assert off == pytest.approx(0.5)  # all on the surface
    grid = np.abs(2.0 * found - np.rint(2.0 * found)) < 1e-9
    assert (grid.sum(axis=2) >= 2).all()  # along the elements' borders, not across their faces


def test_lines_follow_the_body() -> None:
    crane = small_crane()
    rest, now = (element_edges(s, crane.skin) for s in (crane.surface, crane.moved))
    moved = now - rest
    nodes = crane.skin.mesh.points
    first = [int(np.argmin(((nodes - place) ** 2).sum(axis=1))) for place in rest[:50, 0]]
    assert moved[:50, 0] == pytest.approx(20.0 * crane.solution.u[first], abs=1e-12)


def test_dense_borders_are_pale_or_not_there(device: Device) -> None:
    crane, counts = small_crane(), []
    ends = element_edges(crane.surface, crane.skin)
    for distance in (0.6, 1.2, 12.0):
        camera = gs.Camera.from_lens(
            (36, 24), 30, (900, 600), (0.27, -distance, 0.4), (0.27, 0.0, 0.27)
        )
        overlay = Overlay(device)
        Symbols(overlay, camera).elements(ends, "black")
        counts.append(float(overlay.quads()["color"][:, 3].max(initial=0.0)))
    assert counts[0] == 1.0 and 0.0 < counts[1] < 1.0 and counts[2] == 0.0


def test_where_a_smooth_body_turns_away_from_an_eye() -> None:
    """A ball has no creases; seen from a distance d its outline is a circle at r²/d."""
    turn, up = np.meshgrid(np.linspace(0, 2 * np.pi, 73)[:-1], np.linspace(0.04, 3.1, 41))
    points = np.stack([np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), np.cos(up)], axis=2)
    number = np.arange(41 * 72).reshape(41, 72)
    a, b = number[:-1], number[1:]
    faces = np.stack([a, b, np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)], axis=2)
    surface = gs.Surface(points.reshape(-1, 3), faces.reshape(-1, 4))
    eye = np.array([0.0, -4.0, 0.3])
    ends = crease_edges(surface, eye=eye)
    inner = ends[np.abs(ends[:, :, 2]).max(axis=1) < 0.99]  # the open poles aside
    along = inner @ (eye / np.linalg.norm(eye))
    assert len(inner) > 60 and not len(crease_edges(surface)) > 2 * 72
    np.testing.assert_allclose(along, 1.0 / np.linalg.norm(eye), atol=0.1)
