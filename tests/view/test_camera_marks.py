"""What one sees through a camera of the scene: its frame, depth of field and distortion."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.optics.lens.thin_lens import focus_of
from gpusim.view.camera_marks import (
    defocus_tint,
    draw_distortion,
    draw_image_frame,
    draw_principal_point,
)
from gpusim.view.content.depth_of_field import DepthOfField, depth_of_field
from gpusim.visualization.field_colors import draw_field_colors
from gpusim.visualization.overlay import Overlay, pixels_of
from gpusim.visualization.placement import Placement
from tests.support.view_bodies import camera_before, small_crane


def test_the_blur_at_both_limits_is_what_was_asked_for() -> None:
    camera = camera_before()
    lens = gs.Lens(f_number=4.0, focal_length=0.03, focus_distance=1.1)
    found = depth_of_field(camera, lens, blur=0.7)
    assert found is not None and found.near < 1.1 < found.far
    for depth in (found.near, found.far):
        focus = focus_of(lens, camera, np.array([depth]), 1.0)
        assert focus.largest == pytest.approx(0.7, rel=1e-9)
    far = depth_of_field(camera, gs.Lens(f_number=22.0, focal_length=0.03, focus_distance=3.0))
    assert far is not None and np.isinf(far.far) and "to infinity, focus" in far.describe()
    assert depth_of_field(camera, None) is None and depth_of_field(camera, gs.Lens()) is None
    for depth in (0.9, 1.3):
        focus = focus_of(lens, camera, np.array([depth]), 1.0)
        assert found.blur_at(depth) == pytest.approx(focus.largest, rel=1e-9)


@pytest.mark.parametrize("distortion", [None, [-0.2, 0.05, 1e-3, -2e-3]])
def test_what_is_not_sharp_is_tinted(device: Device, distortion: list[float] | None) -> None:
    crane, camera = small_crane(), camera_before(distortion)
    frame = gs.render([crane.moved, crane.wall], camera, device=device)
    truth = frame.truth()
    near, far = np.quantile(truth.depth, [0.2, 0.6])
    found = DepthOfField(float(near), float(far), 0.5 * float(near + far), 1.0)
    target = device.texture(camera.width, camera.height, "rgba8unorm", "test.tint")
    with device.recording("test") as recording:
        Overlay(device).draw(target, recording)
        draw_field_colors(
            device, target, frame, *defocus_tint(found, frame.view), white=1.0, shade=1.0,
            recording=recording,
        )  # fmt: skip
    red, green, blue, _ = pixels_of(device, target)[truth.row, truth.column].astype(int).T
    clear = np.abs(truth.depth - near) > 0.01 * (far - near)
    clear &= np.abs(truth.depth - far) > 0.01 * (far - near)
    nearer, beyond = truth.depth < near, truth.depth > far
    assert ((red > blue) == nearer)[clear].all() and ((blue > red) == beyond)[clear].all()
    assert nearer.sum() > 20 and beyond.sum() > 20 and (green > 0).sum() < len(green)
    unlimited = DepthOfField(float(near), np.inf, 2.0 * float(near), 1.0)
    _, _, endless = defocus_tint(unlimited, frame.view)
    assert endless[0, 3] == 1.0 and not endless[1:, 3].any()


def test_the_frame_leaves_the_image_free(device: Device) -> None:
    camera = gs.Camera.from_lens((36, 24), 30, (300, 200), (0, -1, 0), (0, 0, 0))
    place = Placement(0.0, 20.0, 0.5)
    overlay = Overlay(device)
    draw_image_frame(overlay, camera, place, 150, 140)
    target = device.texture(150, 140, "rgba8unorm", "test.frame")
    with device.recording("test") as recording:
        overlay.draw(target, recording)
    found = pixels_of(device, target)
    assert (found[20:120, :, 3] == 0).all()
    assert (found[:19, :, 3] == 0xC0).all() and (found[:19, :, 2] > found[:19, :, 0]).all()
    assert (found[19] == 255).all() and (found[120] == 255).all()
    assert (place.pixels(place.window(np.array([[3.0, 4.0]]))) == [[3.0, 4.0]]).all()


def test_the_cross_is_on_the_principal_point(device: Device) -> None:
    camera, overlay = camera_before([-0.2, 0.05, 0.0, 0.0]), Overlay(device)
    place = Placement(13.0, 5.0, 1.5)
    draw_principal_point(overlay, camera, place)
    corner = overlay.quads()["corner"].reshape(-1, 2)
    expected = place.window(camera.K[:2, 2])
    assert (corner.min(axis=0) + corner.max(axis=0)) / 2 == pytest.approx(expected, abs=0.51)


def test_the_distortion_grid_is_bent_as_the_lens_does(device: Device) -> None:
    overlay, camera = Overlay(device), camera_before([-0.2, 0.05, 1e-3, -2e-3])
    draw_distortion(overlay, camera, Placement())
    places = overlay.quads()["corner"].astype(np.float64).mean(axis=1) - 0.5
    step = 231 / 12
    ideal = (camera.undistort(places) - camera.K[:2, 2]) / step
    off = np.abs(ideal - np.rint(ideal)).min(axis=1) * step
    assert off.max() < 0.05 and len(places) > 1000
    draw_distortion(overlay := Overlay(device), camera_before(), Placement())
    assert len(overlay.quads()) == 0
