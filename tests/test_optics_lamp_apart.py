"""Faces beside receivers of the same surface: told from those before them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.optics.binning import bin_edges
from gpusim.optics.emitters import lamps_of
from gpusim.optics.lamp_apart import apart
from gpusim.optics.light import Light
from gpusim.optics.lighting import find_shadows
from gpusim.optics.view import look
from tests.optics_rays import brute_share, triangles_of

Array = npt.NDArray[np.float64]


def shapes(rng: np.random.Generator, count: int) -> tuple[Array, Array]:
    """Pairs of triangles (3, 4, n): p, q, s of their corners; half share a side or a corner."""
    one = rng.uniform(-1.0, 1.0, (3, 4, count))
    one[:, 3] = one[:, 2]
    other = rng.uniform(-1.0, 1.0, (3, 4, count))
    other[:2] += rng.uniform(-1.5, 1.5, (2, 1, count))
    shared = rng.integers(0, 4, count)
    other[:, 0] = np.where(shared > 1, one[:, 0], other[:, 0])
    other[:, 1] = np.where(shared > 2, one[:, 1], other[:, 1])
    other[:, 3] = other[:, 2]
    return one, other


def overlap(one: Array, other: Array) -> npt.NDArray[np.bool_]:
    """(n,) whether triangles (2, 3, n) have an inner point in common, by their six sides."""
    result = np.ones(one.shape[2], bool)
    for a, b in ((one, other), (other, one)):
        for k in range(3):
            x, y = a[:, (k + 1) % 3] - a[:, k]
            own, far = (x * (c[1] - a[1, k]) - y * (c[0] - a[0, k]) for c in (a, b))
            sign = np.sign(own[(k + 2) % 3])
            result &= (sign * far).max(axis=0) > 1e-7
    return result


@pytest.mark.parametrize("half", [(0.0, 0.0), (0.2, 0.1)])
def test_shapes_that_overlap_from_no_point_of_the_lamp(half: tuple[float, float]) -> None:
    rng = np.random.default_rng(2)
    one, other = shapes(rng, 4000)
    number = np.arange(4000)
    found = apart(half, tuple(one), number, tuple(v.T for v in other), number)  # type: ignore[arg-type]
    anywhere = np.zeros(4000, bool)
    for a, b in rng.uniform(-1.0, 1.0, (30, 2)):
        at = [shape[:2] - np.array([a * half[0], b * half[1]])[:, None, None] * shape[2]
              for shape in (one[:, :3], other[:, :3])]  # fmt: skip
        anywhere |= overlap(*at)
    assert not (found & anywhere).any()
    assert anywhere.sum() > 500
    # all of them for a small lamp, most for a wide one
    assert found[~anywhere].mean() > (0.999 if not any(half) else 0.7)


@pytest.mark.parametrize(
    "light",
    [
        gs.PointLight((-1.5, -0.35, 0.3), 50.0),
        gs.AreaLight((-1.5, -0.6, 0.3), (0.0, 0.0, 0.0), (0.15, 0.1), 50.0),
    ],
)
def test_a_sheet_that_hides_some_of_itself(light: Light) -> None:
    """Shares of the lamp at pixels' centres against rays, on triangles that are bent together."""
    eye = np.array([0.1, -1.0, 0.1])
    camera = gs.Camera.from_lens((36.0, 24.0), 45.0, (240, 160), tuple(eye), (0.0, 0.0, 0.0))
    x, z = np.linspace(-0.4, 0.4, 41), np.linspace(-0.25, 0.25, 25)
    flat = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    flat[:, 1] = 0.05 * np.sin(16.0 * flat[:, 0]) * np.cos(6.0 * flat[:, 2])
    node = np.arange(len(flat)).reshape(41, 25)
    ends = node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]
    a, b, c, d = (v.reshape(-1) for v in ends)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    surface = gs.Surface(flat, faces, gs.paint.Plain(0.8))
    view = look([surface], camera, lit=True)
    tiles = find_shadows(view, [light], [surface])
    assert tiles is not None
    truth = gs.render([surface], camera, None, backend="numpy").truth()
    inside = ~np.isin(truth.row * camera.width + truth.column, bin_edges(view).pixel)
    rows = np.flatnonzero(inside)[::151]
    seen, still = truth.reference[rows], np.zeros((len(rows), 3))
    (lamp,) = lamps_of([light])
    facing = np.sum((lamp.centre - seen) * truth.normal[rows], axis=1) > 0.1
    place = truth.column[rows].astype(float), truth.row[rows].astype(float)
    got = tiles.shares(*place, seen - eye, truth.normal[rows], still, still)[facing, 0]
    want = brute_share(lamp, seen[facing], triangles_of([surface]), 16)
    assert (want < 0.5).sum() > 5 and (want == 1.0).sum() > 50
    assert (got[want == 1.0] == 1.0).mean() > 0.99
    assert np.abs(got - want).mean() < 0.005
    # where nothing is hidden no tile is in half shadow, though faces lie beside each other
    assert len(tiles.place) < 0.5 * tiles.lit.size
