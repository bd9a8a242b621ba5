"""Many and small faces: integrated, not sampled; topology found once for all frames."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.surface.frames import used_vertices
from gpusim.surface.topology import Topology, sorted_keys


def board(columns: int, rows: int, pixels: float) -> tuple[gs.Surface, gs.Camera]:
    """Faces of ``pixels`` px in two paints by turns, seen from ahead, off the pixels' lattice."""
    camera = gs.Camera(31, 23, np.array([[40.0, 0, 14.3], [0, 40.0, 10.9], [0, 0, 1]]))
    x = (np.arange(columns + 1) - 0.5 * columns) * pixels + 0.37
    y = (np.arange(rows + 1) - 0.5 * rows) * pixels - 0.21
    grid = np.stack(np.meshgrid(x, y, [40.0], indexing="ij"), axis=-1).reshape(-1, 3)
    number = np.arange(len(grid)).reshape(columns + 1, rows + 1)
    corners = [number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]]
    i, j = np.indices((columns, rows))
    paints = {"a": gs.paint.Plain(0.1), "b": gs.paint.Plain(0.9)}
    return (
        gs.Surface(grid, np.stack(corners, -1).reshape(-1, 4), paints,
                   region=((i + 2 * j) % 3 == 0).reshape(-1).astype(np.int32)),
        camera,
    )  # fmt: skip


def exact(columns: int, rows: int, pixels: float, camera: gs.Camera) -> np.ndarray:
    """Mean of every pixel over the board's squares, by their overlaps along x and y."""

    def overlaps(count: int, size: int, shift: float) -> np.ndarray:
        low = (np.arange(count) - 0.5 * count) * pixels + shift
        pixel = np.arange(size)[:, None]
        covered = np.minimum(pixel + 0.5, low + pixels) - np.maximum(pixel - 0.5, low)
        return np.maximum(covered, 0.0)

    across = overlaps(columns, camera.width, 0.37 + camera.K[0, 2])
    down = overlaps(rows, camera.height, -0.21 + camera.K[1, 2])
    i, j = np.indices((columns, rows))
    albedo = np.where((i + 2 * j) % 3 == 0, 0.9, 0.1)
    result: np.ndarray = down @ albedo.T @ across.T
    return result


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
@pytest.mark.parametrize("pixels", [0.2, 0.7])
def test_faces_smaller_than_a_pixel_are_integrated(
    device: Device, backend: str, pixels: float
) -> None:
    columns, rows = (61, 47) if pixels < 0.5 else (33, 25)
    surface, camera = board(columns, rows, pixels)
    want = exact(columns, rows, pixels, camera)
    got = gs.render([surface], camera, device=device, backend=backend).radiance
    error = np.abs(got - want)
    print(f"faces of {pixels} px, {backend}: worst {error.max():.1e}, mean {error.mean():.1e}")
    assert np.ptp(want) > 0.3 and error.max() < 2e-3 and error.mean() < 1e-4


def test_an_image_in_parts_equals_the_whole(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """More triangles than one binding holds are drawn a part of the rows at a time."""
    surface, camera = board(33, 25, 0.7)
    lights = [gs.PointLight((3.0, -2.0, 1.0), 4e4)]
    whole = gs.render([surface], camera, lights, background=0.2, device=device)
    module = import_module("gpusim.optics.rendering.renderer")
    monkeypatch.setattr(module, "MAX_TRIANGLES", 900)
    monkeypatch.setattr(module, "MIN_PART_ROWS", 3)
    parts = gs.render([surface], camera, lights, background=0.2, device=device)
    assert len(parts.bands) > 2 and len(whole.bands) == 1
    assert np.abs(parts.radiance - whole.radiance).max() < 1e-6 * whole.radiance.max()
    np.testing.assert_array_equal(parts.ids(), whole.ids())
    image = gs.Sensor(8, 2.0).expose(parts)
    np.testing.assert_array_equal(image, gs.Sensor(8, 2.0).expose(whole))


def test_topology_and_extents_are_found_once_for_all_frames() -> None:
    surface, _ = board(6, 5, 1.0)
    moved = surface.moved(surface.points + 0.1)
    assert moved.topology is surface.topology and moved.extents is surface.extents
    assert moved.rest is surface.rest and (moved.points != surface.points).all()
    with pytest.raises(InputError, match=r"points; got \(3, 3\); expected \(42, 3\)"):
        surface.moved(np.zeros((3, 3)))
    with pytest.raises(InputError, match="points row 0"):
        surface.moved(np.full(surface.points.shape, np.nan))


def test_edges_of_a_topology() -> None:
    """Two triangles that share an edge, and a third on the same edge: no manifold there."""
    faces = np.array([[0, 1, 2, -1], [2, 1, 3, -1], [1, 2, 4, -1]], np.int32)
    two, three = Topology.of(faces[:2]), Topology.of(faces)
    assert two.manifold.sum() == 1 and not two.closed
    shared = two.edge[0, 1]
    assert two.edge[1, 0] == shared and two.manifold[shared]
    assert {int(two.first[shared]), int(two.second[shared])} == {0, 1}
    assert three.manifold.sum() == 0 and three.edge.max() + 1 == len(three.first) == 7


def test_many_faces_off_the_image_are_dropped_before_any_work() -> None:
    surface, camera = board(200, 200, 4.0)
    view = look([surface], camera, lit=True)
    assert len(surface.faces) == 40_000 and 80 < view.count < 400


@pytest.mark.parametrize("largest", [50, 2**62])
def test_keys_are_sorted_in_stable_order(largest: int) -> None:
    rng = np.random.default_rng(2)
    keys = rng.integers(0, 40, 300) * (largest // 50)
    order, found = sorted_keys(keys)
    np.testing.assert_array_equal(order, np.argsort(keys, kind="stable"))
    np.testing.assert_array_equal(found, keys[order])


def test_vertices_without_a_face_are_left_out() -> None:
    faces = np.array([[5, 2, 1, -1], [2, 5, 7, 4]], np.int32)
    assert used_vertices(faces, 9).tolist() == [1, 2, 4, 5, 7]
    assert used_vertices(faces[:1, :3], 6).tolist() == [1, 2, 5]


def test_rows_keep_all_that_belongs_to_their_triangles() -> None:
    surface, camera = board(9, 7, 2.3)
    speckled = gs.Surface(
        surface.points, surface.faces, gs.paint.Speckle(3.0, 0.4, seed=1), reference=surface.points
    )
    view = look([speckled], camera, lit=False)
    part = view.over_rows(5, 9)
    assert 0 < part.count < view.count and view.footprint.any()
    own = [np.flatnonzero((view.screen == one).all(axis=(1, 2)))[0] for one in part.screen]
    for name in ("corners", "paint", "face", "footprint"):
        np.testing.assert_array_equal(getattr(part, name), getattr(view, name)[own])
