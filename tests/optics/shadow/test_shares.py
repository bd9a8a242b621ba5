"""Shadows against brute-force rays and geometry."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.gpu.wgsl import shader_folder
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import Light
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shading.lighting import find_shadows
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import small_triangles
from gpusim.optics.shadow.receivers import Receivers
from gpusim.optics.shadow.sample_mask import SAMPLES, lattice
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.twin_checks.scenes import block, shadow_scene
from tests.support.optics_rays import brute_share, triangles_of
from tests.support.shadow_rays import found

Array = npt.NDArray[np.float64]
QUAD = np.array([[0, 1, 2, 3]])


def test_every_kind_of_lamp_against_brute_force() -> None:
    """NumPy's shares at pixel centres: 24 x 24 rays to each lamp."""
    surfaces, camera, lights = shadow_scene()
    view = look(surfaces, camera, lit=True)
    shadows = find_shadows(view, lights, surfaces)
    assert shadows is not None
    truth = gs.render(surfaces, camera, None, backend="numpy").truth()
    triangle = visibility_twin(view)[truth.row, truth.column].astype(np.int64) - 1
    inside = ~np.isin(truth.row * camera.width + truth.column, find_edge_pixels(view).pixel)
    # whole tiles, which NumPy looks from together
    rows = np.flatnonzero(inside & ((3 * (truth.row // 8) + truth.column // 8) % 7 == 0))
    points = truth.reference[rows]
    still = np.zeros_like(points)
    got = shadows.shares(
        truth.column[rows].astype(float), truth.row[rows].astype(float), points - camera.eye,
        truth.normal[rows], still, still, triangle[rows],
    )  # fmt: skip
    triangles = triangles_of(surfaces)
    for number, lamp in enumerate(lamps_of(lights)):
        want = brute_share(lamp, points, triangles)
        # faces that look away from the lamp are dark by their cosine
        to = lamp.centre - (0.0 if lamp.far else 1.0) * points
        facing = np.sum(to * truth.normal[rows], axis=1) > 0.1 * np.linalg.norm(to, axis=1)
        off = np.abs(got[:, number] - want)[facing]
        soft = ((want > 0.02) & (want < 0.98))[facing]
        print(
            f"{type(lamp.light).__name__}: {len(off)} points, {soft.sum()} in half shadow, "
            f"{(want[facing] < 0.02).sum()} dark: mean {off.mean():.1e}, worst {off.max():.3f}"
        )
        assert (want[facing] < 0.5).sum() > 5
        if lamp.extended:
            assert off.max() < 0.04 and off[soft].mean() < 0.012
        else:  # a ray that passes within rounding of an edge may go either way
            assert (off > 0.0).mean() < 0.01


def test_penumbra_is_as_wide_as_geometry_says() -> None:
    """A straight edge at height h under a lamp at height H: width = size h / (H - h)."""
    floor = gs.Surface(np.array([[-2.0, -1, 0], [2, -1, 0], [2, 1, 0], [-2, 1, 0]]), QUAD,
                       paint=gs.paint.Plain(1.0))  # fmt: skip
    height, top = 0.2, 1.5
    screen = gs.Surface(np.array([[-2.0, -1, height], [0, -1, height], [0, 1, height],
                                  [-2, 1, height]]), QUAD)  # fmt: skip
    camera = gs.Camera.from_lens((36, 36 * 5 / 901), 30, (901, 5), (0.1, -1.3, 0.15), (0.1, 0, 0))
    for size, shape, law in ((0.15, "rectangle", "box"), (0.15, "ellipse", "disc")):
        lamp = gs.AreaLight((0.0, 0.0, top), (0, 0, 0), (size, 0.6 if law == "box" else size), 10.0,
                            shape=shape)  # fmt: skip
        share = {}
        for shadows in (True, False):
            light = replace(lamp, shadows=shadows)
            share[shadows] = gs.render([floor, screen], camera, [light], backend="numpy")
        truth = share[True].truth()
        row = truth.row == 2
        x = truth.reference[row, 0]
        low = truth.reference[row, 2] < 0.5 * height
        lit, plain = (share[k].radiance[2, truth.column[row]].astype(float) for k in (True, False))
        profile = lit[low] / plain[low]
        x = x[low]
        width = size * height / (top - height)
        assert profile.min() == 0.0 and profile.max() == pytest.approx(1.0, abs=1e-6)
        assert (np.diff(profile) >= -2e-3).all()
        low10, middle, high90 = np.interp([0.1, 0.5, 0.9], profile, x)
        # from 10 % to 90 %: of a box 0.8 of its width, of a disc 0.687 (t sqrt(1-t^2) + asin t
        # = 0.4 pi at t = 0.687)
        want = width * (0.8 if law == "box" else 0.6870)
        print(f"{shape}: 10-90 % {1e3 * (high90 - low10):.3f} mm, geometry {1e3 * want:.3f} mm")
        assert high90 - low10 == pytest.approx(want, rel=0.01)
        assert abs(middle) < 0.01 * width


def test_lit_bodies_do_not_shadow_themselves() -> None:
    """A round closed body, finely meshed: on its lit side shadows change nothing at all."""
    n, m = 40, 24
    theta, phi = np.linspace(0, np.pi, m + 1), 2 * np.pi * np.arange(n) / n
    t, p = np.meshgrid(theta, phi, indexing="ij")
    points = 0.3 * np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], -1)
    points = np.concatenate([points[1:-1].reshape(-1, 3), [[0, 0, 0.3], [0, 0, -0.3]]])
    i, j = np.meshgrid(np.arange(m - 2), np.arange(n), indexing="ij")
    k = (j + 1) % n
    quads = np.stack([i * n + j, (i + 1) * n + j, (i + 1) * n + k, i * n + k], -1).reshape(-1, 4)
    top, base = len(points) - 2, (m - 2) * n
    around = np.arange(n)
    caps = [
        np.stack([0 * around + top, around, (around + 1) % n, 0 * around - 1], 1),
        np.stack([0 * around + top + 1, base + (around + 1) % n, base + around, 0 * around - 1], 1),
    ]
    ball = gs.Surface(points, np.concatenate([quads, *caps]), paint=gs.paint.Plain(0.7))
    camera = gs.Camera.from_lens((36, 24), 40, (151, 101), (0.2, -1.5, 0.3), (0, 0, 0))
    lamp = gs.AreaLight((1.0, -1.2, 0.8), (0, 0, 0), (0.3, 0.2), 20.0)
    images = [
        gs.render([ball], camera, [light], backend="numpy").radiance
        for light in (lamp, replace(lamp, shadows=False))
    ]
    # facets near the terminator stand in their neighbours' way a little, where hardly any light is
    difference = np.abs(images[0] - images[1])
    assert difference.max() < 0.02 * images[1].max()
    bright = images[1] > 0.15 * images[1].max()
    assert difference[bright].max() == 0.0


def test_contact_shadows_begin_at_the_contact(device: Device) -> None:
    """A box on a floor, lit from the left: right of it the floor is dark up to the very edge."""
    floor = gs.Surface(np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), QUAD,
                       paint=gs.paint.Plain(0.5))  # fmt: skip
    box = block((0.0, 0.0, 0.1), (0.1, 0.2, 0.1), 0.5)
    camera = gs.Camera.from_lens((20, 15), 45, (80, 60), (0.3, -0.2, 1.2), (-0.065, 0.0, 0.0))
    lamp = gs.AreaLight((-1.5, 0.0, 1.0), (0, 0, 0), (0.05, 0.05), 10.0)
    for backend in ("gpu", "numpy"):
        frame = gs.render([floor, box], camera, [lamp], device=device, backend=backend)
        truth = frame.truth()
        x, y, z = truth.reference.T
        behind = (z < 1e-9) & (x > 0.1 + 1e-9) & (x < 0.12) & (np.abs(y) < 0.15)
        edge = np.zeros(frame.radiance.shape, bool)
        edge.reshape(-1)[find_edge_pixels(frame.view).pixel] = True
        behind &= ~edge[truth.row, truth.column]
        before = (z < 1e-9) & (x < -0.19) & (x > -0.25) & (np.abs(y) < 0.15)
        before &= ~edge[truth.row, truth.column]
        assert behind.sum() > 50 and before.sum() > 50
        assert frame.radiance[truth.row[behind], truth.column[behind]].max() == 0.0
        plain = gs.render([floor, box], camera, [replace(lamp, shadows=False)], device=device,
                          backend=backend).radiance  # fmt: skip
        lit = frame.radiance[truth.row[before], truth.column[before]]
        np.testing.assert_allclose(lit, plain[truth.row[before], truth.column[before]], rtol=1e-6)


def test_shadows_sharper_than_a_pixel_are_filtered() -> None:
    """A point lamp and an oblique edge: shares are areas, to the 512 samples of the lattice."""
    floor = gs.Surface(np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]), QUAD,
                       paint=gs.paint.Plain(1.0))  # fmt: skip
    edge = np.array([[-3.0, -0.31, 0.5], [3.0, 0.13, 0.5], [3.0, 4.0, 0.5], [-3.0, 4.0, 0.5]])
    camera = gs.Camera.from_lens((36, 24), 30, (61, 41), (0.02, -0.03, 0.4), (0.0, 0.0, 0.0),
                                 up=(0, 1, 0))  # fmt: skip
    lamp = gs.PointLight((0.1, 0.2, 3.0), 1.0)
    screen = gs.Surface(edge, QUAD)
    both = [
        gs.render([floor, screen], camera, [light], backend="numpy").radiance
        for light in (lamp, replace(lamp, shadows=False))
    ]
    share = both[0] / both[1]
    # the edge as the lamp throws it on the floor, on screen
    scale = 3.0 / 2.5
    a, b = (np.array([0.1, 0.2, 3.0]) + scale * (e - [0.1, 0.2, 3.0]) for e in edge[:2])
    pa, pb = camera.project(np.stack([a, b]))
    n = 64
    g = (np.arange(n) + 0.5) / n - 0.5
    y, x = np.mgrid[:41, :61].astype(float)
    sx, sy = x[..., None, None] + g, y[..., None, None] + g[:, None]
    side = (pb[0] - pa[0]) * (sy - pa[1]) - (pb[1] - pa[1]) * (sx - pa[0])
    want = (side > 0).mean(axis=(2, 3))
    if np.abs(share - want).mean() > 0.5:
        want = 1.0 - want
    partly = (want > 0) & (want < 1)
    error = share - want
    print(
        f"{partly.sum()} pixels: mean {error[partly].mean():+.1e}, worst {np.abs(error).max():.1e}"
    )
    assert partly.sum() > 50
    assert np.abs(error).max() < 0.02
    assert abs(error[partly].mean()) < 1e-3


def test_lights_that_cast_none_have_no_shadows() -> None:
    surfaces, camera, lights = shadow_scene()
    view = look(surfaces, camera, lit=True)
    none: list[Light] = [replace(light, shadows=False) for light in lights]  # type: ignore[type-var]
    assert Setup.build(view, none, 0.0, surfaces).lighting.shadows is None
    assert Setup.build(view, lights, 0.0, surfaces).lighting.shadows is not None


@pytest.mark.parametrize("pixels", [0.7, 3.0, 7.0, 15.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_penumbra_some_pixels_wide_is_integrated_over_lamp_and_pixel(
    device: Device, pixels: float, axis: int
) -> None:
    """Closed form: what a half plane hides of a box (the lamp) seen through another (the pixel)."""
    lamp = gs.AreaLight((0.0, 0.0, 2.0), (0.0, 0.0, 0.0), (0.1, 0.1), 1.0)
    step = 0.1 / pixels  # the shadow's edge moves as far as the lamp, the other way
    t = np.linspace(-0.6, 0.6, 61) * (0.1 + step)
    at = np.zeros((len(t), 3))
    at[:, axis] = t
    screen = np.array([[-3.0, -3.0, 1.0], [0.0, -3.0, 1.0], [0.0, 3.0, 1.0], [-3.0, 3.0, 1.0]])
    if axis == 1:
        screen = screen[:, [1, 0, 2]][::-1]
    across, down = np.broadcast_to(step * np.eye(3)[:2, None], (2, len(t), 3))
    normal = np.broadcast_to(np.eye(3)[2], (len(t), 3))
    own = Receivers(at, normal, across, down, np.full(len(t), -1))
    shares = found(device, [gs.Surface(screen, QUAD)], [lamp], own, (0.3, 0.2, 1.5))[:, 0]
    fine = t[:, None] + step * ((np.arange(4000) + 0.5) / 4000 - 0.5)
    exact = np.clip(0.5 + fine / 0.1, 0.0, 1.0).mean(axis=1)
    error = shares - exact
    assert np.abs(error).max() <= 0.013 and np.sqrt(np.mean(error**2)) <= 0.006
    assert exact.min() == 0.0 and exact.max() == 1.0


@pytest.mark.parametrize("bumps", [0.0, 0.006], ids=["arched", "bumpy"])
@pytest.mark.parametrize("backend", ["numpy", "gpu"])
def test_pixels_across_the_facets_of_a_bent_open_sheet_are_lit(
    backend: str, bumps: float, request: pytest.FixtureRequest
) -> None:
    """A sheet arched towards its lamps: from no place on it does another part hide them.

    With bumps its faces are bent, too, ridges and valleys.
    """
    device = request.getfixturevalue("device") if backend == "gpu" else None
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, 10), np.linspace(-0.4, 0.4, 4))
    bent = bumps * np.sin(9.0 * u) * np.cos(8.0 * v)
    points = np.stack([u, v + 0.05 * u, 0.2 - 0.6 * u * u + bent], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(9), np.arange(3))
    first = (10 * j + i).reshape(-1)
    faces = np.stack([first, first + 1, first + 11, first + 10], axis=1)
    sheet = gs.Surface(points, faces, paint=gs.paint.Plain(0.7))
    camera = gs.Camera.from_lens((36.0, 24.0), 40.0, (101, 67), (0.2, -0.9, 1.1), (0, 0, 0.1))
    lamps: list[Light] = [
        gs.AreaLight((0.3, 0.2, 1.9), (0.0, 0.0, 0.0), (0.3, 0.2), 5.0),
        gs.PointLight((0.1, -0.4, 1.5), 5.0),
        gs.SunLight((0.2, 0.3, -1.0), 1.0),
    ]
    for lamp in lamps:
        lit, plain = (
            gs.render(
                [sheet], camera, [replace(lamp, shadows=shadows)], backend=backend, device=device
            ).radiance
            for shadows in (True, False)
        )
        seen = plain > 0.0
        assert seen.sum() > 2000
        assert np.abs(lit[seen] / plain[seen] - 1.0).max() <= 2.0 / SAMPLES


def test_the_shader_has_the_lattice_of_the_twin() -> None:
    source = (shader_folder() / "lib/shadow/sample_mask.wgsl").read_text(encoding="utf-8")
    numbers = re.findall(r"\((vec4f\([^)]*\)) \+ ([0-9.]+)\) / ([0-9.]+) - ([0-9.]+),", source)
    rows = [
        (np.fromstring(row[6:-1], sep=",") + float(more)) / float(by) - float(less)
        for row, more, by, less in numbers
    ]
    found = np.reshape(rows, (4, 3, 4)).transpose(0, 2, 1).reshape(16, 3)
    assert np.array_equal(found, lattice()[:, :3])


@pytest.mark.parametrize("columns", [5, 41], ids=["large", "small"])
@pytest.mark.parametrize("width", [60, pytest.param(150, marks=pytest.mark.slow)])
def test_patterns_on_triangles_of_all_sizes(width: int, columns: int, device: Device) -> None:
    """Under shadows, lit again once these are known: as NumPy has it."""
    x, y = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(-0.8, 0.8, columns))
    flat = np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3)
    points = flat + np.sin(5.0 * flat[:, :1]) * [0.0, 0.0, 0.02]
    node = np.arange(x.size).reshape(x.shape)
    faces = np.stack([node[:-1, :-1], node[:-1, 1:], node[1:, 1:], node[1:, :-1]], axis=-1)
    paint = gs.paint.Checker(0.11, dark=0.1)
    surfaces = [
        gs.Surface(points, faces.reshape(-1, 4), paint, reference=flat),
        *shadow_scene()[0][1:2],
    ]
    size = width, width * 2 // 3
    camera = gs.Camera.from_lens((36.0, 24.0), 30.0, size, (0.2, -0.9, 1.6), (0.0, 0.0, 0.0))
    # of small triangles it is found first which one each pixel sees
    assert small_triangles(look(surfaces, camera, True)) == (columns == 41)
    lights = shadow_scene()[2]
    if width == 60:
        lights = [lights[0], lights[2]]
    for matte in (False, True):
        if matte:
            surfaces[1] = replace(surfaces[1], paint=gs.paint.Plain(0.6))
        got = gs.render(surfaces, camera, lights, device=device).radiance
        want = gs.render(surfaces, camera, lights, backend="numpy").radiance
        # some samples of a lamp fall to the other side of an outline
        difference = np.abs(got.astype(np.float64) - want) / float(want.max())
        assert difference.max() <= 0.03
        assert np.sqrt(np.mean(difference**2)) <= 1e-3
