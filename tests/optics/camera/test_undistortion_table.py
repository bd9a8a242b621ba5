"""Images through distorting lenses: against 64 x 64 exactly undistorted rays, twins, the truth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device, compare
from gpusim.optics.camera.undistortion_table import FINE, distortion_map
from gpusim.optics.edge_pixels.fragment_lists import find_edge_pixels
from gpusim.optics.edge_pixels.resolve import EdgePixelPass, edges_twin
from gpusim.optics.frame import Band
from gpusim.optics.geometry.clipping import CHORD, ImagePlane
from gpusim.optics.geometry.view import look
from gpusim.optics.shading.scene_buffers import SceneBuffers
from gpusim.optics.shading.setup import Setup
from gpusim.optics.shading.shading_pass import ShadingPass, shade_twin
from gpusim.optics.visibility_buffer import visibility_twin
from tests.support.optics_reference import Plate, difference, pattern, reference
from tests.support.optics_rigs import RIGS, rig

BARREL = [-0.28, 0.09, 0.002, -0.003, -0.01]
CUSHION_TILTED = [0.2, -0.1, 0.002, 0.001, 0.1, 0.02, 0.01, 0, 0.01, -0.002, 0.003, 0, 0.05, -0.04]
QUAD = np.array([[0, 1, 2, 3]])


def board(coefficients: list[float] | None, paint: gs.Paint) -> tuple[gs.Camera, Plate, gs.Surface]:
    camera = gs.Camera.from_lens(
        (36.0, 23.0), 24.0, (61, 39), (0.13, -0.78, 0.21), (0.03, 0.0, 0.02), up=(0.1, 0.0, 1.0),
        distortion=coefficients,
    )  # fmt: skip
    s_axis = np.array([np.cos(0.15), np.sin(0.15), 0.0])
    plate = Plate(np.array([-0.4, 0.01, -0.28]), s_axis, np.array([0.0, 0, 1]), (0.86, 0.54),
                  pattern(paint))  # fmt: skip
    return camera, plate, gs.Surface(plate.corners(), QUAD, paint=paint)


@pytest.mark.parametrize(
    ("coefficients", "paint"),
    [
        (BARREL, gs.paint.Checker(0.081, origin=(0.013, 0.007))),
        (CUSHION_TILTED, gs.paint.Dots(0.041, 0.073, origin=(0.017, 0.009))),
    ],
)
def test_bent_images_equal_the_mean_of_exact_rays(
    device: Device, coefficients: list[float], paint: Any
) -> None:
    camera, plate, surface = board(coefficients, paint)
    want = reference(camera, [plate], 0.3, (0, 12))
    for backend in ("gpu", "numpy"):
        image = gs.render([surface], camera, background=0.3, device=device, backend=backend)
        d = difference(image.radiance[:12], want, 12)
        print(
            f"{type(paint).__name__} {backend}: rms {d.rms:.1e}, worst {d.worst:.1e}, shift rms "
            f"{d.shift_rms:.1e} px, bias {d.bias[0]:+.1e} {d.bias[1]:+.1e} px"
        )
        assert d.rms < 3e-4 and d.shift_rms < 2e-3 and np.abs(d.bias).max() < 1e-3


@pytest.mark.parametrize("name", RIGS)
def test_the_table_of_a_lens_is_as_good_as_its_exact_inverse(name: str) -> None:
    camera, _ = rig(name, 1)
    table = distortion_map(camera)
    assert table is not None and table is distortion_map(camera)
    rng = np.random.default_rng(1)
    pixel = rng.integers(0, [camera.width, camera.height], (4000, 2))
    pixel[:4] = [[0, 0], [camera.width - 1, 0], [0, camera.height - 1], [camera.width - 1, 7]]
    at = rng.uniform(-0.5, 0.5, (4000, 2))
    shift, change = table.evaluate(pixel, at)
    off = np.abs(pixel + at + shift - camera.undistort(pixel + at)).max()
    e = 1e-2 * np.eye(2)
    ends = [
        camera.undistort(pixel + at + e[k]) - camera.undistort(pixel + at - e[k]) for k in (0, 1)
    ]
    numeric = np.stack(ends, axis=-1) / 0.02
    print(f"{name}: tiles of {table.size} px, off by {off:.1e} px")
    assert off < 2 * FINE and np.abs(change - numeric).max() < 1e-4


def test_edges_that_show_follow_their_curves() -> None:
    camera, plate, surface = board(BARREL, gs.paint.Plain(0.5))
    view = look([surface], camera, lit=False)
    assert view.edges.shape[0] > 40
    middle = camera.undistort(view.edges.mean(axis=1))
    corners = camera.without_distortion().project(plate.corners())
    best = np.full(len(middle), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        off = along[0] * (middle - a)[:, 1] - along[1] * (middle - a)[:, 0]
        best = np.minimum(best, np.abs(off))
    # undistorting stretches what the chord is off by
    inside = np.isfinite(best) & (np.abs(view.edges.mean(axis=1) - 30) < 30).all(axis=1)
    assert inside.sum() > 20 and best[inside].max() < 3 * CHORD


@pytest.mark.parametrize("backend", ["gpu", "numpy"])
def test_a_bent_fan_has_no_cracks(device: Device, backend: str) -> None:
    """Triangles of all sizes, partly behind the camera and far beyond the lens's domain."""
    rng = np.random.default_rng(6)
    angle = np.sort(rng.uniform(0, 2 * np.pi, 9))
    rim = 40.0 * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    rim[:, 1] = rng.uniform(-0.6, 5.0, 9)
    points = np.concatenate([[[0.05, 0.0, 0.02]], rim])
    faces = np.array([[0, 1 + k, 1 + (k + 1) % 9] for k in range(9)])
    for smooth_angle in (np.pi, 0.0):
        fan = gs.Surface(points, faces, gs.paint.Plain(1.0), smooth_angle=smooth_angle)
        camera = gs.Camera.from_lens(
            (36.0, 20.0), 30.0, (211, 117), (0, -1.0, 0), (0.03, 0, -0.02),
            distortion=[-0.3, 0.0, 0.0, 0.001],
        )  # fmt: skip
        assert camera.lens is not None and camera.lens.limit < 1.4
        image = gs.render([fan], camera, device=device, backend=backend).radiance
        assert np.abs(image - 1.0).max() < 1e-5


def test_bent_stages_agree_with_their_twins(device: Device) -> None:
    paints = (gs.paint.Checker(0.081, origin=(0.013, 0.007)), gs.paint.Dots(0.041, 0.073))
    camera, _, first = board(BARREL, paints[0])
    second = gs.Surface(first.points[:, [0, 1, 2]] * 0.6 + [0.1, -0.2, 0.1], QUAD, paint=paints[1])
    lights = [gs.PointLight((-0.4, -1.0, 0.5), 10.0)]
    setup = Setup.build(look([first, second], camera, lit=True), lights, 0.1)
    tables = SceneBuffers(device, setup)
    shape = (camera.height, camera.width)
    shading = ShadingPass(tables, rows=camera.height)
    out = device.empty(4 * shading.stride * camera.height, "bent.out")
    with device.recording("optics.shade") as recording:
        shading.record(recording, [out], 0, camera.height)
    got = out.read(np.float32, (camera.height, shading.stride))[:, : camera.width]
    (twin,) = shade_twin(setup, visibility_twin(setup.view))
    edges = find_edge_pixels(setup.view)
    inside = np.ones(twin.size, bool)
    inside[edges.pixel] = False
    compare("bent shade", got.reshape(-1)[inside], twin.reshape(-1)[inside], "pixel")
    flat = device.buffer(np.full(shape, 0.25, np.float32), "bent.radiance")
    edge_pass = EdgePixelPass(tables, edges)
    edge_pass.find()
    edge_pass.host_pass()
    edge_pass.write([Band(0, camera.height, camera.width, (flat,))])
    (want,) = edges_twin(setup, edges, np.full((1, *shape), 0.25, np.float32))
    compare("bent edges", flat.read(np.float32, shape), want, "pixel")
    assert len(np.unique(want)) > 100


def test_an_undistorted_scene_does_not_pay(device: Device) -> None:
    camera, _, surface = board(None, gs.paint.Plain(0.5))
    setup = Setup.build(look([surface], camera, lit=False), None, 0.0)
    assert setup.programs.constants((), False, False)["distorted"] == 0.0 and setup.view.count == 2
    assert SceneBuffers(device, setup).undistortion.count == 1
    assert ImagePlane(camera).straight == np.inf and distortion_map(camera) is None


@pytest.mark.parametrize("name", RIGS)
def test_truth_equals_the_exact_ray_through_each_pixel(name: str) -> None:
    """Reference points project back into their pixels to 0.002 px (here 1e-6), in every camera."""
    camera, X = rig(name, 4)
    width, height = camera.width, camera.height
    scale = 2.2 * np.ptp(X, axis=0).max()
    small = np.array([[width / 60, 0, -0.5 + width / 120], [0, height / 41, -0.5 + height / 82],
                      [0, 0, 1]])  # fmt: skip
    reduced = gs.Camera(
        60, 41, np.linalg.inv(small) @ camera.K, camera.distortion, camera.camera_from_world
    )
    R = camera.camera_from_world[:3, :3]
    centre = R.T @ (np.array([0.0, 0.0, camera.camera_from_world[2, 3]])
                    - camera.camera_from_world[:3, 3])  # fmt: skip
    axes = np.array([[1.0, 0.1, 0.2], [-0.1, 1.0, 0.15]]) @ R * scale
    corners = [centre + a * axes[0] + b * axes[1] for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    surface = gs.Surface(np.array(corners), QUAD)
    truth = gs.render([surface], reduced, backend="numpy").truth()
    assert len(truth.row) == 60 * 41
    at = reduced.project(truth.reference)
    off = np.abs(at - np.stack([truth.column, truth.row], axis=1)).max()
    z = reduced.to_camera(truth.reference)[:, 2]
    print(f"{name}: {off:.1e} px")
    assert off < 1e-6 and np.abs(truth.depth / z - 1.0).max() < 1e-9
