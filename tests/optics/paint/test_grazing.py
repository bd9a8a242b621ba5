"""Speckle on a tube, at grazing angles and unfolded, against rays through the exact shapes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.geometry.view import look
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.triangle_traits import GRAZING
from gpusim.surface.speckle import EDGE, edge_opacity

SIZE, DISTANCE, RADIUS = 160, 640.0, 60.0
HARD = gs.paint.Speckle(6.0, 0.5, seed=3)
SOFT = gs.paint.Speckle(6.0, 0.5, 1.0, seed=3)


def camera(size: int = SIZE) -> gs.Camera:
    """At -y, looking along +y, z up; about a pixel per unit of length at the origin."""
    K = np.array([[600.0, 0, (size - 1) / 2], [0, 600.0, (size - 1) / 2], [0, 0, 1.0]])
    T = np.eye(4)
    T[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    T[2, 3] = DISTANCE
    return gs.Camera(size, size, K, None, T)


def tube(paint: gs.paint.Speckle, facets: int = 360, radius: float = RADIUS) -> gs.Surface:
    """A cylinder about z that fills the image's height."""
    angle = np.arange(facets) * 2.0 * np.pi / facets
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.concatenate([np.c_[ring, np.full(facets, h)] for h in (-95.0, 97.0)])
    i = np.arange(facets)
    j = (i + 1) % facets
    frame = gs.CylinderFrame(np.zeros(3), np.array([0, 0, 1.0]), np.array([0, -1.0, 0]), radius)
    return gs.Surface(
        points, np.stack([i, j, facets + j, facets + i], axis=1), {"tube": paint},
        frames={"tube": frame},
    )  # fmt: skip


def rays(pixels: np.ndarray, count: int) -> np.ndarray:
    """Directions (n, count^2, 3) through pixels (n, 2: row, column), stratified."""
    at = (np.arange(count) + 0.5) / count - 0.5
    shift = ((np.arange(count) * 7) % count + 0.5) / count
    dx = ((np.arange(count)[None] + shift[:, None]) / count - 0.5).ravel()
    x = (pixels[:, 1:] + dx - (SIZE - 1) / 2) / 600.0
    z = (pixels[:, :1] + np.repeat(at, count) - (SIZE - 1) / 2) / -600.0
    return np.stack([x, np.ones_like(x), z], axis=-1)


def albedo(paint: gs.paint.Speckle, st: np.ndarray) -> np.ndarray:
    """The pattern by its definition at points (…, 2)."""
    flat = st.reshape(-1, 2)
    centres, radii = paint.discs(flat.min(axis=0), flat.max(axis=0))
    if not len(radii):
        return np.full(st.shape[:-1], paint.ground)
    half = EDGE * paint.softness
    reach = float(np.sqrt(radii.max() * (radii.max() + 2.0 * half)))
    tree, clear = cKDTree(centres), np.empty(len(flat))
    for first in range(0, len(flat), 10_000):  # all at once would fill the memory
        part = slice(first, first + 10_000)
        distance, index = tree.query(flat[part], k=24, distance_upper_bound=reach)
        assert not np.isfinite(distance[:, -1]).any()
        r = radii[np.where(np.isfinite(distance), index, 0)]
        # nothing of a disc at an infinite distance
        square = np.minimum(distance, 1e6) ** 2
        opacity = edge_opacity((r * r - square) / (2.0 * r * half)) if half else square < r * r
        clear[part] = np.prod(1.0 - opacity, axis=1)
    return (paint.ground + (paint.dot - paint.ground) * (1.0 - clear)).reshape(st.shape[:-1])


def on_tube(pixels: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Paint coordinates (n, count^2, 2) where rays meet the cylinder; NaN where they miss it."""
    d = rays(pixels, count)
    a, c = d[..., 0] ** 2 + 1.0, DISTANCE**2 - RADIUS**2
    with np.errstate(invalid="ignore"):
        t = (DISTANCE - np.sqrt(DISTANCE**2 - a * c)) / a
    x, y, z = t * d[..., 0], t - DISTANCE, t * d[..., 2]
    return np.stack([RADIUS * np.arctan2(x, -y), z], axis=-1), np.abs(x).mean(axis=1) / RADIUS


@pytest.mark.parametrize(
    "paint", [pytest.param(HARD, marks=pytest.mark.slow), SOFT], ids=["hard", "soft"]
)
def test_a_tube_is_right_from_rim_to_rim(device: Device, paint: gs.paint.Speckle) -> None:
    frame = gs.render([tube(paint)], camera(), background=0.3, device=device).radiance
    row, column = np.mgrid[8 : SIZE - 8 : 4, :SIZE]
    pixels = np.stack([row.ravel(), column.ravel()], axis=1)
    st, sine = on_tube(pixels, 40 if paint is HARD else 16)
    # a footprint of a speckle's diameter at most; rims hit in part are the silhouette's
    own = np.isfinite(st).all(axis=(1, 2)) & (np.sqrt(1.0 - np.minimum(sine, 1.0) ** 2) > 1.07 / 6)
    error = frame[tuple(pixels[own].T)] - albedo(paint, st[own]).mean(axis=1)
    rim = sine[own] > 0.9
    rms = [float(np.sqrt(np.mean(error[part] ** 2))) for part in (rim, ~rim)]
    # what was measured, and a little more: 1.7e-3 and 5.5e-4
    assert rim.sum() > 200 and max(rms) < (2e-3 if paint is HARD else 7e-4)
    assert abs(error.mean()) < 2e-4


def tilted(paint: gs.paint.Speckle, degrees: float) -> gs.Surface:
    """A plane through the origin, tilted about x away from facing the camera."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    along = np.array([0.0, s, c])
    s_, t_ = (v.ravel() for v in np.meshgrid([-150.0, 150.0], [-420.0, 700.0], indexing="ij"))
    points = np.outer(s_, [1.0, 0, 0]) + np.outer(t_, along)
    frame = gs.PaintFrame(np.zeros(3), np.eye(3)[0], along)
    return gs.Surface(points, np.array([[0, 1, 3, 2]]), {"p": paint}, frames={"p": frame})


@pytest.mark.parametrize("softness", [0.0, 2.0], ids=["hard", "soft"])
def test_a_plane_at_85_degrees(device: Device, softness: float) -> None:
    """Footprints of 4 to 46 units: below one diameter exact, beyond that the right mean."""
    paint = gs.paint.Speckle(14.0, 0.5, softness, seed=8)
    surface = tilted(paint, 85.0)
    frame = gs.render([surface], camera(), device=device).radiance
    setup = Setup.build(look([surface], camera(), lit=False), None, 0.0)
    assert set(setup.traits.groups.tolist()) == {(3 if softness == 0.0 else 2) + GRAZING}
    row, column = np.mgrid[SIZE // 2 - 14 : SIZE // 2 + 30 : 2, 30:130:3]
    pixels = np.stack([row.ravel(), column.ravel()], axis=1)
    d = rays(pixels, 32 if softness == 0.0 else 16)
    normal = np.cross([1.0, 0, 0], [0, np.sin(np.radians(85)), np.cos(np.radians(85))])
    t = DISTANCE * normal[1] / (d @ normal)
    hit = t[..., None] * d - [0.0, DISTANCE, 0.0]
    st = np.stack([hit[..., 0], hit[..., 2] / np.cos(np.radians(85.0))], axis=-1)
    want = albedo(paint, st)
    want = want.mean(axis=1)
    long = np.ptp(st[..., 1], axis=1)
    error = frame[tuple(pixels.T)] - want
    near = long < 14.0
    print(f"footprints {long.min():.1f} to {long.max():.1f}; RMS {np.sqrt(np.mean(error**2)):.1e}, "
          f"below a diameter {np.sqrt(np.mean(error[near] ** 2)):.1e}")  # fmt: skip
    assert near.sum() > 100 and (~near).sum() > 100
    assert np.sqrt(np.mean(error[near] ** 2)) < (2e-3 if softness == 0.0 else 5e-4)
    assert abs(error[~near].mean()) < 0.004


def dome(paint: gs.paint.Speckle, rings: int = 14, sectors: int = 40) -> gs.Surface:
    """A hemisphere towards the camera, unfolded."""
    theta = np.linspace(0.0, np.pi / 2, rings + 1)[1:]
    phi = np.arange(sectors) * 2.0 * np.pi / sectors + 0.05
    ring = np.stack([np.cos(phi), np.zeros(sectors), np.sin(phi)], axis=1)
    points = [np.array([[0.0, -RADIUS, 0.0]])]
    points += [RADIUS * (np.sin(t) * ring - [0.0, np.cos(t), 0.0]) for t in theta]
    j = np.arange(sectors)
    k = (j + 1) % sectors
    faces = [np.stack([np.zeros_like(j), 1 + j, 1 + k, np.full(sectors, -1)], axis=1)]
    for i in range(rings - 1):
        a, b = 1 + i * sectors, 1 + (i + 1) * sectors
        faces.append(np.stack([a + j, b + j, b + k, a + k], axis=1))
    mesh = np.concatenate(points), np.concatenate(faces).astype(np.int32)
    return gs.Surface(*mesh, {"dome": paint}, frames={"dome": gs.Atlas.unfold(*mesh)})


@pytest.mark.parametrize("paint", [HARD, SOFT], ids=["hard", "soft"])
def test_an_unfolded_dome_with_its_seams(device: Device, paint: gs.paint.Speckle) -> None:
    surface = dome(paint)
    frame = gs.render([surface], camera(), background=0.3, device=device).radiance
    rng = np.random.default_rng(4)
    pixels = rng.integers(20, SIZE - 20, (80, 2))
    d = rays(pixels, 64 if paint is HARD else 24)
    triangles = surface.topology.triangles
    corners = surface.points[triangles] + [0.0, DISTANCE, 0.0]
    inverse = np.linalg.inv(np.swapaxes(corners, 1, 2))
    column = 600.0 * corners[..., 0] / corners[..., 1] + (SIZE - 1) / 2
    row = -600.0 * corners[..., 2] / corners[..., 1] + (SIZE - 1) / 2
    error = []
    for pixel, ray in zip(pixels, d, strict=True):
        gap = np.stack([row - pixel[0], column - pixel[1]])
        near = np.flatnonzero(((gap.min(axis=2) < 0.5) & (gap.max(axis=2) > -0.5)).all(axis=0))
        b = np.einsum("tij,nj->nti", inverse[near], ray)
        inside = (b > -1e-9).all(axis=2)
        if not inside.any(axis=1).all():
            continue
        rows = np.arange(len(ray))
        nearest = np.argmax(np.where(inside, b.sum(axis=2), 0.0), axis=1)
        share = b[rows, nearest] / b[rows, nearest].sum(axis=1)[:, None]
        atlas = surface.paint_frame(0)
        st = np.einsum("ni,nij->nj", share, atlas.of_triangles(corners[near], near)[nearest])
        error.append(frame[pixel[0], pixel[1]] - albedo(paint, st).mean())
    rms = np.sqrt(np.mean(np.square(error)))
    print(f"dome: RMS {rms:.1e} of {len(error)}")
    assert len(error) > 45 and rms < (1.5e-3 if paint is HARD else 5e-4)
