"""Depth of field and vignetting against the thin lens' own formulas."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import j1

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.optics.lens.thin_lens import aperture_points, edge_error, focus_of
from tests.support.optics_edges import (
    HEIGHT,
    WIDTH,
    K,
    camera,
    half_plane,
    pixel_transfer,
    transfer,
)

FREQUENCY = np.linspace(0.02, 0.5, 25)
# a 50 mm lens at f/2.8 focused at 1.2 m; the pixel is what makes fx = 900 the image distance
FOCAL, NUMBER, FOCUS = 0.05, 2.8, 1.2
PITCH = FOCAL * FOCUS / (FOCUS - FOCAL) / 900.0
LENS = gs.Lens(f_number=NUMBER, focal_length=FOCAL, focus_distance=FOCUS)


def diameter(depth: float) -> float:
    """f^2 |d - s| / (N d (s - f)) in px: the blur disc of the thin lens equation."""
    on_sensor = FOCAL**2 * abs(depth - FOCUS) / (NUMBER * depth * (FOCUS - FOCAL))
    return on_sensor / PITCH


def test_the_plane_of_focus_is_the_pinhole_image(device: Device) -> None:
    lens = gs.Lens(f_number=NUMBER, focal_length=FOCAL, focus_distance=FOCUS, positions=16)
    sharp = gs.render([half_plane(FOCUS)], camera(), device=device).radiance
    image = gs.photograph([half_plane(FOCUS)], camera(), lens=lens, device=device).radiance
    assert np.abs(image - sharp).max() * 255.0 <= 0.2
    frame = gs.photograph([half_plane(FOCUS)], camera(), lens=LENS, device=device)
    assert "left out" in frame.facts["depth of field"]
    np.testing.assert_array_equal(frame.radiance, sharp)


@pytest.mark.parametrize("depth", [0.8, 2.0])
@pytest.mark.parametrize("alone", [True, False], ids=["one disc", "lens positions"])
def test_blur_disc_is_that_of_the_thin_lens(device: Device, depth: float, alone: bool) -> None:
    """The first zero of the transfer is at 3.8317 / (pi diameter); the rest follows 2 J1(u) / u."""
    surfaces = [half_plane(depth)]
    if not alone:  # something else far beside the edge: no longer all at one depth
        points = np.array([[0.6, 0.5, 0], [0.7, 0.5, 0], [0.7, 0.6, 0], [0.6, 0.6, 0]])
        far = gs.Surface(
            points + np.array([0, 0, FOCUS]), np.array([[0, 3, 2, 1]]), name="elsewhere"
        )
        surfaces.append(far)
    frame = gs.photograph(surfaces, camera(), lens=LENS, device=device)
    assert ("one disc" in frame.facts["depth of field"]) == alone
    c = diameter(depth)
    fine = np.linspace(0.7, 1.3, 241) * 3.8317 / (np.pi * c)
    curve = transfer(frame.radiance, fine)
    low, high = fine < fine[120], fine > fine[120]
    # the modulus turns at its zero: lines through both sides, left and right of it
    left = np.polyfit(curve[low][60:110], fine[low][60:110], 1)[1]
    right = np.polyfit(curve[high][10:60], fine[high][10:60], 1)[1]
    zero = 0.5 * (left + right)
    assert 3.8317 / (np.pi * zero) == pytest.approx(c, rel=0.02)
    u = np.pi * c * FREQUENCY
    want = pixel_transfer(FREQUENCY) * np.abs(2 * j1(u) / u)
    assert np.abs(transfer(frame.radiance, FREQUENCY) - want).max() <= 0.02


def test_a_distorting_lens_keeps_its_plane_of_focus(device: Device) -> None:
    """And its tiles of cells: the same picture with cells finer than pixels, binned."""
    view = gs.Camera(WIDTH, HEIGHT, K, distortion=[-1.2, 1.5, 0.02, -0.03])
    lens = gs.Lens(f_number=1.0, focal_length=FOCAL, focus_distance=FOCUS, positions=12)
    plain = gs.render([half_plane(FOCUS, shift=22.0)], camera(), device=device).radiance
    sharp = gs.render([half_plane(FOCUS, shift=22.0)], view, device=device).radiance
    assert np.abs(sharp - plain).max() > 0.1
    image = gs.photograph([half_plane(FOCUS, shift=22.0)], view, lens=lens, device=device).radiance
    assert np.abs(image - sharp).max() * 255.0 <= 0.2
    cells = gs.Lens(psf=gs.psf.Gaussian(1e-3), samples_per_px=3)
    binned = gs.photograph(
        [half_plane(FOCUS, shift=22.0)], view, lens=cells, device=device
    ).radiance
    assert np.abs(binned - sharp).max() * 255.0 <= 0.2
    # out of focus, the centre of the blur stays where the pinhole has the edge
    blurred = gs.photograph([half_plane(0.9, shift=22.0)], view, lens=lens, device=device).radiance
    pinhole = gs.render([half_plane(0.9, shift=22.0)], view, device=device).radiance
    rows = slice(30, HEIGHT - 30)
    shift = (blurred[rows].sum(axis=1) - pinhole[rows].sum(axis=1)) / 0.8
    assert np.abs(shift).max() <= 0.05


def test_one_disc_equals_lens_positions(device: Device) -> None:
    """Where it is used, the disc is what many lens positions converge to."""
    disc = gs.photograph([half_plane(1.5)], camera(), lens=LENS, device=device).radiance
    errors = []
    for count in (16, 128):
        lens = gs.Lens(f_number=NUMBER, focal_length=FOCAL, focus_distance=FOCUS, positions=count)
        image = gs.photograph([half_plane(1.5)], camera(), lens=lens, device=device).radiance
        errors.append(float(np.abs(image - disc).max()))
    assert errors[0] > 2 * errors[1] and errors[1] <= 0.008


def test_stated_error_is_the_error(device: Device) -> None:
    """Several depths: against 128 lens positions, within what the facts say."""
    surfaces = [half_plane(2.0), half_plane(0.9, shift=25.0)]
    many = gs.Lens(f_number=16.0, focal_length=FOCAL, focus_distance=FOCUS, positions=128)
    few = gs.Lens(f_number=16.0, focal_length=FOCAL, focus_distance=FOCUS)
    frame = gs.photograph(surfaces, camera(), lens=few, device=device)
    depths = np.concatenate([s.points[:, 2] for s in surfaces])
    focus = focus_of(few, camera(), depths, 0.25 * 2**0.5 / 255)
    assert f"{focus.edge_error:.1e}" in frame.facts["depth of field"]
    image = gs.photograph(surfaces, camera(), lens=many, device=device, backend="gpu").radiance
    error = frame.radiance - image
    near = np.abs(error) > 1e-6
    assert 0 < near.sum() < 0.6 * near.size
    assert np.sqrt(np.mean(error[near] ** 2)) <= 1.5 * focus.edge_error
    assert np.sqrt(np.mean(error**2)) <= 0.25 / 255


@pytest.mark.parametrize("blades", [0, 5])
def test_lens_positions_have_the_moments_of_the_aperture(blades: int) -> None:
    points = aperture_points(24, blades, 0.3)
    np.testing.assert_allclose(points.mean(axis=0), 0.0, atol=1e-12)
    # a regular polygon on the unit circle: (2 + cos(2 pi / n)) / 12 of its radius squared
    want = 0.25 if not blades else (2.0 + np.cos(2 * np.pi / blades)) / 12.0
    np.testing.assert_allclose(np.cov(points.T, bias=True), want * np.eye(2), atol=3e-4)
    assert np.hypot(*points.T).max() <= 1.03
    assert edge_error(aperture_points(64), 4.0) < 0.5 * edge_error(aperture_points(16), 4.0)


def test_device_equals_twin(device: Device) -> None:
    surfaces = [half_plane(2.0), half_plane(0.9, shift=25.0)]
    lens = gs.Lens(
        psf=gs.psf.Gaussian(0.8), f_number=8.0, focal_length=FOCAL, focus_distance=FOCUS, blades=6,
        positions=6, vignetting=gs.Vignetting(),
    )  # fmt: skip
    images = [
        gs.photograph(surfaces, camera(), lens=lens, device=device, backend=backend).radiance
        for backend in ("gpu", "numpy")
    ]
    np.testing.assert_allclose(images[0], images[1], atol=3e-5)


def test_truth_is_the_pinholes(device: Device) -> None:
    lens = gs.Lens(f_number=NUMBER, focal_length=FOCAL, focus_distance=FOCUS, positions=8)
    frame = gs.photograph([half_plane(2.0)], camera(), lens=lens, device=device)
    sharp = gs.render([half_plane(2.0)], camera(), device=device)
    np.testing.assert_array_equal(frame.ids(), sharp.ids())


def test_vignetting_follows_its_law(device: Device) -> None:
    points = np.array([[-9.0, -9, 2], [9, -9, 2], [9, 9, 2], [-9, 9, 2]])
    wall = gs.Surface(points, np.array([[0, 3, 2, 1]]), paint=gs.paint.Plain(1.0))
    view = gs.Camera(61, 43, np.array([[40.0, 0.3, 27.2], [0, 41.0, 19.4], [0, 0, 1]]))
    y, x = np.mgrid[:43, :61]
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ view.ray_matrix().T
    cosine = 1.0 / np.linalg.norm(rays, axis=-1)
    lens = gs.Lens(vignetting=gs.Vignetting())
    image = gs.photograph([wall], view, lens=lens, device=device).radiance
    np.testing.assert_allclose(image, cosine**4, atol=1e-6)
    radius = np.hypot(x - 27.2, y - 19.4) / (0.5 * np.hypot(61, 43))
    own = gs.Vignetting(cos4=False, polynomial=(-0.3, 0.05), map=np.array([[1.0, 0.5], [1.0, 0.5]]))
    image = gs.photograph([wall], view, lens=gs.Lens(vignetting=own), device=device).radiance
    want = (1 - 0.3 * radius**2 + 0.05 * radius**4) * (1.0 - 0.5 * x / 60.0)
    np.testing.assert_allclose(image, want, atol=1e-6)


def test_what_cannot_be_is_refused(device: Device) -> None:
    for values, part in (
        ({"f_number": 2.0}, "expected all of"),
        ({"f_number": 2.0, "focal_length": 0.1, "focus_distance": 0.05}, "more than the focal"),
        ({"blades": 2}, "blades; got 2"),
        ({"positions": 0}, "positions; got 0"),
    ):
        with pytest.raises(InputError, match=part):
            gs.Lens(**values)
    with pytest.raises(InputError, match="map; got shape"):
        gs.Vignetting(map=np.ones((1, 3)))
    deep = gs.Vignetting(cos4=False, polynomial=(-3.0,))
    with pytest.raises(InputError, match="below 0"):
        gs.photograph([half_plane()], camera(), lens=gs.Lens(vignetting=deep), device=device)
    assert (HEIGHT, WIDTH) == (camera().height, camera().width) and K[0, 0] == 900.0
