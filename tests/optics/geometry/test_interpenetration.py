"""Bodies that cut through each other: the line where they do is an edge like any other."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.edge_pixels import fragment_lists
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.interpenetration import piercings
from gpusim.optics.geometry.view import look
from tests.support.optics_reference import Array, Plate, flat, pattern, reference

QUAD = np.array([[0, 1, 2, 3]])
X, Y, Z = np.eye(3)
BOARD = gs.paint.Checker(0.0831, dark=0.1, light=0.6, origin=(0.011, 0.023))


def camera() -> gs.Camera:
    return gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (57, 38), (0.13, -0.9, 0.21), (0.0, 0.0, 0.0), up=(0.1, 0.0, 1.0)
    )


def crossing() -> tuple[list[gs.Surface], list[Plate]]:
    """A board, and two plates through it at angles, of which one ends inside it."""
    across = np.cos(0.4) * Y - np.sin(0.4) * X
    turned = np.cos(0.4) * X + np.sin(0.4) * Y, np.cos(0.3) * Z + np.sin(0.3) * across
    across = np.cos(0.9) * Y + np.sin(0.9) * Z
    second = np.cos(0.9) * Z - np.sin(0.9) * Y, np.cos(0.2) * X + np.sin(0.2) * across
    plates = [
        Plate(np.array([-0.5, 0.0, -0.4]), X, Z, (1.0, 0.8), pattern(BOARD)),
        Plate(np.array([-0.17, -0.12, -0.15]), turned[0], turned[1], (0.5, 0.29), flat(0.9)),
        Plate(np.array([-0.3, 0.07, -0.05]), second[0], second[1], (0.21, 0.33), flat(0.02)),
    ]
    paints = BOARD, gs.paint.Plain(0.9), gs.paint.Plain(0.02)
    return [
        gs.Surface(
            plate.corners(), QUAD, {"p": paint},
            frames={"p": gs.PaintFrame(plate.origin, plate.s_axis, plate.t_axis)},
        )
        for plate, paint in zip(plates, paints, strict=True)
    ], plates  # fmt: skip


@pytest.fixture(scope="module")
def wanted() -> Array:
    return reference(camera(), crossing()[1], 0.3)


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_the_line_of_a_cut_is_smooth(device: Device, wanted: Array, backend: str) -> None:
    surfaces, _ = crossing()
    view = look(surfaces, camera(), lit=False)
    pierced = find_edge_pixels(view).pixel[find_edge_pixels(view).pierced]
    image = gs.render(surfaces, camera(), background=0.3, device=device, backend=backend).radiance
    error = (image - wanted).reshape(-1)
    rms = np.sqrt(np.mean(error[pierced] ** 2))
    worst = np.abs(error).max()
    print(f"{backend}: {len(pierced)} pixels, RMS {rms:.1e}, worst anywhere {worst:.1e}")
    assert len(pierced) > 25
    assert rms < 5e-4
    assert worst < 3e-3


def test_without_the_line_it_is_not(
    device: Device, wanted: Array, monkeypatch: pytest.MonkeyPatch
) -> None:
    surfaces, _ = crossing()
    pixels = find_edge_pixels(look(surfaces, camera(), lit=False))
    monkeypatch.setattr(fragment_lists, "piercings", lambda bodies: np.zeros((0, 2, 3)))
    image = gs.render(surfaces, camera(), background=0.3, device=device).radiance
    error = (image - wanted).reshape(-1)[pixels.pixel[pixels.pierced]]
    assert np.sqrt(np.mean(error**2)) > 0.05


def test_a_line_of_known_length() -> None:
    def quad(origin: Array, a: Array, b: Array) -> Array:
        return np.stack(
            [np.stack([origin, origin + a, origin + a + b]),
             np.stack([origin, origin + a + b, origin + b])]
        )  # fmt: skip

    floor = quad(np.zeros(3), X, Y)
    wall = quad(np.array([0.2, 0.5, -0.3]), 0.4 * X + 0.1 * Y, 0.03 * X + 0.8 * Z)
    line = piercings([floor, wall])
    ends = np.array([[0.21125, 0.5, 0.0], [0.61125, 0.6, 0.0]])
    length = np.linalg.norm(line[:, 1] - line[:, 0], axis=1)
    np.testing.assert_allclose(length.sum(), np.hypot(0.4, 0.1), rtol=1e-12)
    flat_line = line.reshape(-1, 3)
    for end in ends:
        assert np.linalg.norm(flat_line - end, axis=1).min() < 1e-12
    # what stands on the floor, lies in it, or is elsewhere doesn't cut it
    for other in (quad(np.array([0.2, 0.5, 0.0]), X, Z), floor + 0.3 * X, floor + 0.1 * Z):
        assert piercings([floor, other]).shape == (0, 2, 3)
    # a body has no line with itself
    assert piercings([np.concatenate([floor, wall])]).shape == (0, 2, 3)


def test_fine_meshes_share_the_line_of_coarse_ones() -> None:
    """200 pairs of crossing facets, found by their cells: the length is that of the planes."""
    n = 40
    at = np.linspace(0.0, 1.0, n + 1)
    corner = np.stack(np.meshgrid(at[:-1], at[:-1], indexing="ij"), axis=-1).reshape(-1, 2)
    step = 1.0 / n
    local = np.array([[[0, 0], [1, 0], [1, 1]], [[0, 0], [1, 1], [0, 1]]]) * step
    mesh = (corner[:, None, None] + local).reshape(-1, 3, 2)
    floor = np.concatenate([mesh, np.zeros((*mesh.shape[:2], 1))], axis=2)
    wall = mesh[..., :1] * [0.9, 0.3, 0.0] + mesh[..., 1:] * [0.0, 0.01, 1.0]
    wall += [0.033, 0.201, -0.4871]
    line = piercings([floor, wall])
    length = np.linalg.norm(line[:, 1] - line[:, 0], axis=1)
    np.testing.assert_allclose(length.sum(), np.hypot(0.9, 0.3), rtol=1e-9)
    assert len(line) > 100
