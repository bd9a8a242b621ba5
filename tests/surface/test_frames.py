"""Frames of curved regions: lengths on the surface are lengths of the pattern."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.surface.topology import triangulate
from tests.support.optics_reference import Array

FACES = np.ndarray


def tube(columns: int, rows: int, radius: float, height: float, bore: bool) -> tuple[Array, FACES]:
    """A closed ring of quadrilaterals about a slanting axis through (0.3, -0.2, 0.1)."""
    angle = np.arange(columns) * 2 * np.pi / columns
    z = np.linspace(0.0, height, rows + 1)
    a, t = np.meshgrid(angle, z)
    local = np.stack([radius * np.cos(a), radius * np.sin(a), t], axis=-1).reshape(-1, 3)
    i = np.arange(columns * (rows + 1)).reshape(rows + 1, columns)
    right = np.roll(i, -1, axis=1)
    faces = np.stack([i[:-1], right[:-1], right[1:], i[1:]], axis=-1).reshape(-1, 4)
    if bore:
        faces = faces[:, ::-1]
    c, s = np.cos(0.4), np.sin(0.4)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    return local @ turn.T + [0.3, -0.2, 0.1], faces


AXIS = np.array([0.0, -np.sin(0.4), np.cos(0.4)])


def lengths(points: Array) -> Array:
    """Sides (T, 3) of triangles (T, 3, d)."""
    return np.linalg.norm(np.roll(points, -1, axis=1) - points, axis=2)


def seams(faces: FACES, st: Array) -> Array:
    """For every inner edge, how far apart its ends are on its two sides' pattern."""
    triangles, _ = triangulate(faces.astype(np.int32))
    seen: dict[tuple[int, int], Array] = {}
    gaps = []
    for v, place in zip(triangles.tolist(), st, strict=True):
        for k in range(3):
            a, b = v[k], v[(k + 1) % 3]
            ends = np.stack([place[k], place[(k + 1) % 3]])
            if (b, a) in seen:
                gaps.append(np.abs(seen[b, a][::-1] - ends).max())
            seen[a, b] = ends
    return np.array(gaps)


@pytest.mark.parametrize("bore", [False, True])
def test_round_a_cylinder(bore: bool) -> None:
    points, faces = tube(48, 5, 0.7, 0.9, bore)
    frame = gs.CylinderFrame.fit(points, faces, (0.3, -0.2, 0.1), AXIS, "tube")
    assert frame.inside is bore and abs(frame.radius - 0.7) < 1e-12
    triangles, _ = triangulate(faces.astype(np.int32))
    corners = points[triangles]
    st = frame.of_triangles(corners, np.arange(len(triangles)))
    a, b = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    # not mirrored, and of the arc's area: longer than the chords by their sagitta
    assert (area > 0).all() and abs(area.sum() - 2 * np.pi * 0.7 * 0.9) < 1e-9
    assert abs(st[..., 1].min()) < 1e-12 and abs(st[..., 1].max() - 0.9) < 1e-12
    gaps = seams(faces, st)
    assert (gaps > 1e-9).sum() == 5 and np.allclose(gaps[gaps > 1e-9], 2 * np.pi * 0.7)


def test_only_what_is_round_is_a_cylinder() -> None:
    points, faces = tube(48, 5, 0.7, 0.9, False)
    points[7] += 0.05
    with pytest.raises(gs.InputError, match="one distance within 2%"):
        gs.CylinderFrame.fit(points, faces, (0.3, -0.2, 0.1), AXIS, "tube")
    with pytest.raises(gs.InputError, match="across the axis"):
        gs.CylinderFrame(np.zeros(3), AXIS, 2 * AXIS, 1.0)


@pytest.mark.parametrize("bore", [False, True])
def test_a_tube_unfolds_with_one_seam(bore: bool) -> None:
    points, faces = tube(32, 4, 0.7, 0.9, bore)
    triangles, _ = triangulate(faces.astype(np.int32))
    st = gs.Atlas.unfold(points, faces.astype(np.int32)).st
    np.testing.assert_allclose(lengths(st), lengths(points[triangles]), rtol=1e-9)
    a, b = st[:, 1] - st[:, 0], st[:, 2] - st[:, 0]
    assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()
    assert (seams(faces, st) > 1e-9).sum() == 4


def plate_with_hole() -> tuple[Array, FACES]:
    """Front face and bore of a square plate with a round hole, 0.3 thick."""
    n = 32
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    square = ring / np.abs(ring).max(axis=1)[:, None]
    rows = [
        np.c_[2.0 * square, np.zeros(n)],
        np.c_[ring, np.zeros(n)],
        np.c_[ring, np.full(n, -0.3)],
    ]
    i = np.arange(n)
    j = (i + 1) % n
    front = np.stack([i, j, n + j, n + i], axis=1)
    bore = np.stack([n + i, n + j, 2 * n + j, 2 * n + i], axis=1)
    return np.concatenate(rows), np.concatenate([front, bore])


def test_nothing_smears_in_a_hole() -> None:
    """The plane part unfolds without a seam; the bore keeps its area, which projection loses."""
    points, faces = plate_with_hole()
    triangles, source = triangulate(faces.astype(np.int32))
    st = gs.Atlas.unfold(points, faces.astype(np.int32)).st
    np.testing.assert_allclose(lengths(st), lengths(points[triangles]), rtol=0.03)
    front = source < 32
    assert (seams(faces[:32], st[front]) < 1e-9).all()
    flat = gs.PaintFrame.facing(np.array([0.0, 0, 1]), points).coordinates(points[triangles])
    assert lengths(flat)[~front].min() < 1e-9  # what is avoided


def test_a_doubly_curved_surface_keeps_its_shapes() -> None:
    """A hemisphere can't be unfolded whole: seams open, but every triangle keeps its sides."""
    n, m = 24, 8
    theta, phi = np.meshgrid(np.linspace(0.15, 1.4, m + 1), np.arange(n) * 2 * np.pi / n)
    points = np.stack(
        [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1
    ).reshape(-1, 3)
    i = np.arange(n * (m + 1)).reshape(n, m + 1)
    j = np.roll(i, -1, axis=0)
    faces = np.stack([i[:, :-1], i[:, 1:], j[:, 1:], j[:, :-1]], axis=-1).reshape(-1, 4)
    triangles, _ = triangulate(faces.astype(np.int32))
    atlas = gs.Atlas.unfold(points, faces.astype(np.int32))
    ratio = lengths(atlas.st) / lengths(points[triangles])
    print(f"sides of the unfolded hemisphere: {ratio.min():.3f} to {ratio.max():.3f}")
    assert np.abs(ratio - 1.0).max() < 0.06
    with pytest.raises(gs.InputError, match="outside the faces"):
        gs.Atlas.unfold(points, faces.astype(np.int32), np.arange(len(faces)) > 0).of_triangles(
            points[triangles], np.arange(len(triangles))
        )


@pytest.mark.parametrize("kind", ["cylinder", "unfolded"])
def test_dots_on_a_tube_keep_their_coverage(device: Device, kind: str) -> None:
    """As much is covered at the rim, where projection smears, as before."""
    points, faces = tube(64, 4, 0.7, 1.6, False)
    frame: gs.CylinderFrame | gs.Atlas
    if kind == "cylinder":
        frame = gs.CylinderFrame.fit(points, faces, (0.3, -0.2, 0.1), AXIS, "tube")
    else:
        frame = gs.Atlas.unfold(points, faces.astype(np.int32))
    paint = gs.paint.Dots(0.04, 0.062, albedo=0.1, ground=0.9)
    surface = gs.Surface(points, faces, paint=paint, frames={"surface": frame})
    middle = np.array([0.3, -0.2, 0.1]) + 0.8 * AXIS
    want = 0.25 * np.pi * (0.04 / 0.062) ** 2
    for eye in ((-2.4, 1.5, 0.5),):
        view = gs.Camera.from_lens((24.0, 24.0), 40.0, (57, 57), eye, middle)
        # pixels at the ends of the tube see some background: as bright as the mean
        picture = gs.render([surface], view, background=0.9 - 0.8 * want, device=device)
        truth = picture.truth()
        toward = (np.array(eye) - middle) / np.linalg.norm(np.array(eye) - middle)
        facing = truth.normal @ toward
        share = (0.9 - picture.radiance[truth.row, truth.column]) / 0.8
        # pixels weighed by the surface that they see
        inner, rim = facing > 0.6, (facing > 0.2) & (facing < 0.6)
        covered = [np.average(share[part], weights=1 / facing[part]) for part in (inner, rim)]
        print(f"{kind}: covered {covered[0]:.3f} inside, {covered[1]:.3f} at the rim; {want:.3f}")
        assert rim.sum() > 100 and np.abs(np.array(covered) - want).max() < 0.015
