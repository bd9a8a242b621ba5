"""Colours of a field: what is interpolated, whose pixels change, how smooth the borders are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.gpu import Device
from gpusim.visualization.field_colors import (
    SurfaceField,
    corner_values,
    draw_field_colors,
    finer,
    interpolated,
    surface_field,
)
from gpusim.visualization.overlay import Overlay, pixels_of
from gpusim.visualization.placement import Placement
from tests.support.view_bodies import camera_before, small_crane

RAMP = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
SLOPE = np.array([0.7, -3.0, 1.1])


def draw_colors(device: Device, *arguments: Any, **options: Any) -> None:
    with device.recording("test") as recording:
        draw_field_colors(device, *arguments, recording=recording, **options)


@pytest.mark.parametrize("distortion", [None, [-0.2, 0.05, 1e-3, -2e-3]])
def test_values_are_those_of_the_material_point(distortion: list[float] | None) -> None:
    crane = small_crane()
    surfaces = [crane.moved, crane.wall]
    frame = gs.render(surfaces, camera_before(distortion), backend="numpy")
    values = corner_values(frame.view, surfaces, [SurfaceField(crane.surface.rest @ SLOPE)])
    found, truth = interpolated(frame.view, frame.ids(), values), frame.truth()
    own = truth.face < len(crane.surface.faces)
    expected = np.full(found.shape, np.nan)
    expected[truth.row[own], truth.column[own]] = truth.reference[own] @ SLOPE
    assert (np.isnan(found) == np.isnan(expected)).all()
    # behind a lens that distorts, pieces of triangles are straight to a hundredth of a pixel
    tolerance = 2e-6 if distortion is None else 2e-4
    assert np.nanmax(np.abs(found - expected)) < tolerance * np.nanmax(np.abs(expected))


def test_a_triangle_that_the_image_cuts_keeps_its_values() -> None:
    wall = small_crane().wall
    camera = gs.Camera.from_lens((36, 24), 30, (57, 33), (0.2, -0.2, 0.3), (0.3, 0.15, 0.35))
    frame = gs.render([wall], camera, backend="numpy")
    values = corner_values(frame.view, [wall], [SurfaceField(wall.rest @ SLOPE)])
    truth = frame.truth()
    found = interpolated(frame.view, frame.ids(), values)[truth.row, truth.column]
    assert found == pytest.approx(truth.reference @ SLOPE, abs=2e-6)


def test_on_the_device_as_the_truth_has_it(device: Device) -> None:
    crane = small_crane()
    surfaces = [crane.wall, crane.moved]
    frame = gs.render(surfaces, camera_before(), device=device)
    field = SurfaceField(crane.surface.rest[:, 2])
    values = corner_values(frame.view, surfaces, [None, field])
    low, high = float(field.values.min()) - 0.05, float(field.values.max()) + 0.05
    target = device.texture(frame.width, frame.height, "rgba8unorm", "test.window")
    overlay = Overlay(device)
    overlay.rectangle(0, 0, frame.width, frame.height, (0.2, 0.4, 0.6))
    with device.recording("test") as recording:
        overlay.draw(target, recording)
    draw_colors(device, target, frame, values, (low, high), RAMP, white=1.0, shade=1.0)
    found, truth = pixels_of(device, target) / 255.0, frame.truth()
    # a ramp is straight in linear light
    share = (truth.reference[:, 2] - low) / (high - low)
    grey = 1.055 * np.maximum(share, 1e-9) ** (1 / 2.4) - 0.055
    own = truth.face > 0
    seen = found[truth.row[own], truth.column[own], 1]
    assert np.abs(seen - grey[own]).max() < 1.6 / 255.0
    other = np.ones(found.shape[:2], bool)
    other[truth.row[own], truth.column[own]] = False
    assert np.abs(found[other] - [0.2, 0.4, 0.6, 1.0]).max() < 1.0 / 255.0


def test_elements_have_one_colour_each() -> None:
    crane = small_crane()
    frame = gs.render([crane.moved], camera_before(), backend="numpy")
    numbers = np.arange(len(crane.surface.faces)) + 0.5
    values = corner_values(frame.view, [crane.moved], [SurfaceField(numbers, by_face=True)])
    truth = frame.truth()
    found = interpolated(frame.view, frame.ids(), values)[truth.row, truth.column]
    assert found == pytest.approx(truth.face + 0.5, rel=1e-6)


def test_a_shaded_surface_is_darker_where_its_radiance_is(device: Device) -> None:
    wall = small_crane().wall
    camera = gs.Camera.from_lens((36, 24), 30, (30, 20), (0.2, -0.5, 0.3), (0.2, 0.15, 0.3))
    bright = []
    for albedo in (0.25, 1.0):
        surface = gs.Surface(wall.points, wall.faces, gs.paint.Plain(albedo))
        frame = gs.render([surface], camera, device=device)
        values = corner_values(frame.view, [surface], [SurfaceField(np.ones(4))])
        target = device.texture(30, 20, "rgba8unorm-srgb", "test.window")
        draw_colors(device, target, frame, values, (0.0, 1.0), RAMP, white=1.0, shade=0.2)
        encoded = pixels_of(device, target)[10, 15, 0] / 255.0
        bright.append(((encoded + 0.055) / 1.055) ** 2.4)
    assert bright == pytest.approx([0.2 + 0.8 * 0.5, 1.0], abs=6e-3)


def test_borders_are_smooth_and_where_they_belong(device: Device) -> None:
    square = np.array(
        [[-0.31, -0.2, 0.0], [0.4, -0.23, 0.0], [0.35, 0.29, 0.0], [-0.28, 0.33, 0.0]]
    )
    surface = gs.Surface(square, np.array([[0, 1, 2, 3]]))
    camera = gs.Camera.from_lens((36, 24), 36, (57, 38), (0, 0, 1.2), (0, 0, 0), up=(0, 1, 0))
    frame = gs.render([surface], camera, device=device)
    values = corner_values(frame.view, [surface], [SurfaceField(np.ones(4))])
    x, y = camera.project(square).T
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    errors = []
    for samples in (1, 4):
        target = device.texture(114, 90, "rgba8unorm", "test.window")
        draw_colors(
            device,
            target, frame, values, (0.0, 1.0), RAMP, white=1.0, samples=samples,
            place=Placement(0.0, 7.0, 2.0),
        )  # fmt: skip
        alpha = pixels_of(device, target)[..., 3] / 255.0
        errors.append(abs(alpha.sum() / 4.0 / area - 1.0))
        row, column = np.nonzero(alpha > 0.5)
        middle = (Placement(0.0, 7.0, 2.0).window(camera.project(square))).mean(axis=0)
        assert [column.mean() + 0.5, row.mean() + 0.5] == pytest.approx(middle, abs=2.0)
        assert samples == 1 or ((alpha > 0.1) & (alpha < 0.9)).sum() > 40
    assert errors[1] < 4e-3


def test_a_finer_view_has_the_same_triangles() -> None:
    crane = small_crane()
    frame = gs.render([crane.moved], camera_before([-0.2, 0.05, 0.0, 0.0]), backend="numpy")
    fine = finer(frame.view, 3)
    at = np.array([[0.0, 0.0], [230.0, 153.0]])
    middle = 3.0 * at + 1.0  # the middle one of nine
    ideal = frame.view.camera.without_distortion()
    ray, finer_ray = (
        c.ray_matrix() @ [*p, 1.0] for c, p in ((ideal, at[1]), (fine.camera, middle[1]))
    )
    assert ray == pytest.approx(finer_ray, abs=1e-12)
    assert (fine.place - 1.0) / 3.0 == pytest.approx(frame.view.place, abs=1e-9)


def test_what_does_not_fit_is_refused(device: Device) -> None:
    crane = small_crane()
    frame = gs.render([crane.moved], camera_before(), device=device)
    with pytest.raises(InputError, match=r"'crane'; got shape \(3,\); expected"):
        corner_values(frame.view, [crane.moved], [SurfaceField(np.zeros(3))])
    target = device.texture(30, 20, "rgba8unorm", "test.window")
    values = np.zeros((frame.view.count, 3))
    with pytest.raises(InputError, match="limits; got 1 to 1"):
        draw_colors(device, target, frame, values, (1.0, 1.0), RAMP, white=1.0)
    with pytest.raises(InputError, match="field values; got"):
        draw_colors(device, target, frame, values[1:], (0.0, 1.0), RAMP, white=1.0)


def test_on_the_surface_by_node_and_by_element() -> None:
    skin = small_crane().skin
    nodes = surface_field(skin, skin.mesh.points[:, 2])
    assert nodes.values == pytest.approx(small_crane().surface.rest[:, 2]) and not nodes.by_face
    cells = surface_field(skin, np.arange(skin.mesh.cell_count) + 0.0, by_cell=True)
    assert (cells.values == skin.cell_of_piece).all() and cells.by_face
