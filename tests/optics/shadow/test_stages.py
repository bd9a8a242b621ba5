"""Shadows on the device: the same at any scale, in any order, twice, and with too small a pool."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, OutOfDeviceMemory
from gpusim.gpu import Device, twin_checks
from gpusim.gpu.adapter import is_processor
from gpusim.optics.geometry.view import look
from gpusim.optics.light.lights import AreaLight, Light, PointLight, SunLight
from gpusim.optics.light.quadrature import lamps_of
from gpusim.optics.shadow.brute_force import shares_twin
from gpusim.optics.shadow.lamp_visibility import VisibleShares
from gpusim.optics.shadow.light_space import light_spaces
from gpusim.optics.shadow.occluders import Occluders, relative_points
from gpusim.optics.shadow.receivers import DevicePixels, PixelReceivers, Receivers
from gpusim.optics.shadow.sample_mask import SAMPLES
from gpusim.optics.visibility_buffer import visibility_twin
from gpusim.twin_checks.scenes import probe_pieces, probe_pixels, probe_points
from tests.support.shadow_rays import box, by_rays, found, on_plane, sheet

STAGES = (
    "bvh_refit",
    "receiver_groups",
    "occluder_search",
    "occluder_refinement",
    "penumbra_mask",
)


def test_every_stage_has_a_check() -> None:
    stages = {f"optics/shadow/{stage}" for stage in STAGES} | {"optics/shading/receiver_planes"}
    assert stages <= set(twin_checks())


@pytest.mark.parametrize(
    ("scale", "offset"), [(1e-3, 0.0), (1e3, 0.0), (1.0, 1e3), (1e-3, 1.0), (1e3, 1e6)]
)
def test_any_scale_and_offset(device: Device, scale: float, offset: float) -> None:
    surfaces = [
        box((0.0, 0.0, 0.2), (0.15, 0.1, 0.1), 2), sheet((-0.5, 0.1), (-0.1, 0.5), 0.3, 6, 0.03)
    ]  # fmt: skip
    own = on_plane(100, (-0.8, -0.8), (0.8, 0.8))

    def moved(points: object) -> np.ndarray:
        return np.asarray(points) * scale + offset * np.array([1.0, -0.7, 0.5])

    def lights(scale: float, at: object) -> list[Light]:
        def place(x: float, y: float, z: float) -> tuple[float, float, float]:
            a, b, c = (float(v) for v in at((x, y, z)))
            return a, b, c

        size = 0.3 * scale, 0.2 * scale
        return [
            AreaLight(place(-0.6, -0.3, 1.0), place(0.0, 0.0, 0.1), size, 5.0),
            PointLight(place(0.4, -0.7, 0.8), 5.0), SunLight((0.4, 0.3, -1.0), 0.6, diameter=0.05),
        ]  # fmt: skip

    eye = np.array([0.3, -1.4, 0.9])
    want = found(device, surfaces, lights(1.0, np.asarray), own, eye)
    there = [gs.Surface(moved(v.points), v.faces, gs.paint.Plain(0.5)) for v in surfaces]
    pieces = Receivers(moved(own.at), own.normal, scale * own.across, scale * own.down, own.on)
    got = found(device, there, lights(scale, moved), pieces, moved(eye))
    assert np.abs(got - want).max() <= 1.5 / SAMPLES


def test_surfaces_in_any_order(device: Device) -> None:
    surfaces = [box((0.0, 0.0, 0.2), (0.15, 0.1, 0.1), 2), sheet((-0.5, 0.1), (-0.1, 0.5), 0.3, 6)]
    lights = [AreaLight((-0.6, -0.3, 1.0), (0.0, 0.0, 0.1), (0.3, 0.2), 5.0)]
    own = on_plane(100, (-0.8, -0.8), (0.8, 0.8))
    one = found(device, surfaces, lights, own)
    assert (one == found(device, surfaces[::-1], lights, own)).all()
    assert 0.0 < one.min(initial=1.0, where=one > 0.0) < 1.0


@pytest.mark.parametrize("kind", ["pieces", "pixels"])
def test_the_same_bits_twice_and_in_other_chunks(device: Device, kind: str) -> None:
    occluders, spaces, receivers = probe_pieces() if kind == "pieces" else probe_pixels()
    shares = VisibleShares(device, occluders, receivers)
    first = shares.find(probe_points(), spaces)
    assert (shares.find(probe_points(), spaces) == first).all()
    # as many chunks as are found to be missing
    tight = VisibleShares(device, occluders, receivers, capacity=4)
    assert (tight.find(probe_points(), spaces) == first).all()
    assert max(count["taken"] for count in tight.counts) > 4
    assert tight.search.capacity > 4


def test_lists_that_no_pool_holds(device: Device) -> None:
    occluders, _, receivers = probe_pieces()
    with pytest.raises(OutOfDeviceMemory, match="chunks of lists"):
        VisibleShares(device, occluders, receivers).enlarge(1 << 21)


def crumbs(count: int) -> gs.Surface:
    """Tetrahedra, turned any way, in a layer that lets half of the light through."""
    random = np.random.default_rng(0)
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    turns = np.linalg.qr(random.normal(size=(count, 3, 3)))[0]
    turns *= np.sign(np.linalg.det(turns))[:, None, None]
    at = random.uniform((-0.5, -0.5, 0.45), (0.5, 0.5, 0.55), (count, 3))
    points = at[:, None] + 0.76 / np.sqrt(count) * corners @ turns
    numbers = faces + 4 * np.arange(count)[:, None, None]
    return gs.Surface(points.reshape(-1, 3), numbers.reshape(-1, 3), gs.paint.Plain(0.5))


def test_no_loop_is_cut_short_unnoticed(device: Device) -> None:
    """Mesa's software rasteriser ends loops after 65,535 turns: 20,000 crumbs let 0.8 through."""
    lamp = AreaLight((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.9, 0.9), 50.0)
    own = on_plane(24, (-0.01, -0.01), (0.01, 0.01), 1e-4)
    few = found(device, [crumbs(2000)], [lamp], own)
    want = by_rays([crumbs(2000)], [lamp], own[:4])
    assert np.abs(few[:4] - want).max() <= 0.06  # 400 rays
    if is_processor(device.info):
        with pytest.raises(InputError, match="more triangles between a lamp"):
            found(device, [crumbs(20000)], [lamp], own)
    else:
        assert np.abs(found(device, [crumbs(20000)], [lamp], own) - few.mean()).max() <= 0.06


def test_vertices_move(device: Device) -> None:
    surfaces = [box((0.0, 0.0, 0.2), (0.15, 0.1, 0.1), 2)]
    lights = [AreaLight((-0.6, -0.3, 1.0), (0.0, 0.0, 0.1), (0.3, 0.2), 5.0)]
    own, eye = on_plane(100, (-0.8, -0.8), (0.8, 0.8)), np.zeros(3)
    points = relative_points(surfaces, eye)
    shares = VisibleShares(device, Occluders.of(surfaces), own)
    shares.find(points, light_spaces(lamps_of(lights), points, eye))
    higher = points + np.array([0.05, 0.0, 0.1], np.float32)
    spaces = light_spaces(lamps_of(lights), higher, eye)
    moved = surfaces[0].moved(surfaces[0].points + np.array([0.05, 0.0, 0.1]))
    want = VisibleShares(device, Occluders.of([moved]), own).find(higher, spaces)
    assert np.abs(shares.find(higher, spaces) - want).max() <= 1.5 / SAMPLES


def test_pixels_through_a_bent_lens(device: Device) -> None:
    surfaces = [box((0.0, 0.0, 0.2), (0.15, 0.1, 0.1), 2), sheet((-1.0, -1.0), (1.0, 1.0), 0.0, 2)]
    lights = [AreaLight((-0.6, -0.3, 1.0), (0.0, 0.0, 0.1), (0.3, 0.2), 5.0)]
    K = np.array([[60.0, 0.0, 27.0], [0.0, 60.0, 20.0], [0.0, 0.0, 1.0]])
    camera = gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (57, 39), (0.3, -1.4, 0.95), (0.03, 0.05, 0.05)
    )
    camera = gs.Camera(
        57, 39, K, (-0.2, 0.1, 0.003, -0.002), camera.camera_from_world, pixel_side=0.8
    )
    view = look(surfaces, camera, lit=True)
    occluders = Occluders.of(surfaces)
    pixels = PixelReceivers.of(view, visibility_twin(view), occluders)
    points = relative_points(surfaces, camera.eye)
    spaces = light_spaces(lamps_of(lights), points, camera.eye)
    got = VisibleShares(device, occluders, pixels).find(points, spaces)
    pixel, own = pixels.receivers()
    want = shares_twin(occluders, points[:, :3].astype(float), spaces, own)
    assert np.abs(got[pixel] - want).max() <= 2.5 / SAMPLES
    assert ((want > 0.1) & (want < 0.9)).any()
    # pieces of the same size in the same places see the same
    pieces = VisibleShares(device, occluders, own).find(points, spaces)
    assert np.abs(pieces - want).max() <= 2.5 / SAMPLES


def test_receivers_beyond_the_terminator(device: Device) -> None:
    surfaces = [box((0.0, 0.0, 0.2), (0.15, 0.1, 0.1))]
    lights = [PointLight((2.0, 0.0, -0.1), 5.0)]
    own, eye = on_plane(20, (0.3, -0.5), (0.6, 0.5)), np.zeros(3)
    points = relative_points(surfaces, eye)
    occluders = Occluders.of(surfaces)
    for terminator, share in ((0.0, 0.0), (0.2, 1.0)):
        spaces = [
            replace(space, terminator=terminator)
            for space in light_spaces(lamps_of(lights), points, eye)
        ]
        assert (VisibleShares(device, occluders, own).find(points, spaces) == share).all()


def test_a_pool_enlarged_for_a_short_band_suits_longer_ones(device: Device) -> None:
    occluders, spaces, receivers = probe_pixels()
    want = VisibleShares(device, occluders, receivers).find(probe_points(), spaces)
    shares = VisibleShares(device, occluders, receivers)
    assert isinstance(shares.receivers, DevicePixels)
    shares.receivers.aim(0, 8)
    shares.enlarge(1 << 13)
    shares.receivers.aim(0, receivers.camera.height)
    assert (shares.find(probe_points(), spaces) == want).all()
