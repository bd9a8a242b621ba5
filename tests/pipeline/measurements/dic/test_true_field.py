"""True fields of a block that is moved in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.measure.correlation.strain import strain_tensor
from gpusim.pipeline.measurements.dic.true_field import (
    TrueField,
    inverse_slopes,
    region_of_second_camera,
)
from gpusim.pipeline.measurements.region_of_interest import region_of_interest
from tests.support.moved_block import moved_block

GRADIENT = np.array([[0.02, 0.01, -0.006], [0.004, -0.005, 0.002], [0.03, 0.0, 0.014]])
POINTS = np.array([[150.0, 90.0], [183.0, 66.0], [150.0, 118.0], [199.0, 101.0]])


@pytest.fixture(scope="module")
def field() -> TrueField:
    _, motion = moved_block(lambda points: np.asarray(points @ GRADIENT.T + [1e-3, -2e-3, 5e-4]))
    roi = region_of_interest("measure 'field'", None, motion, "front")
    return TrueField.of(motion, "front", roi, POINTS)


def test_the_field_is_where_pixels_went(field: TrueField) -> None:
    image, shift = field.field(1), field.shift(1)
    x, y = POINTS.astype(int).T
    assert np.abs(image[y, x] - shift).max() <= 1e-9
    assert np.array_equal(np.isfinite(image[..., 0]), field.roi.mask)
    place = field.motion.position(field.material, 0)
    moved = place + place @ GRADIENT.T + [1e-3, -2e-3, 5e-4]
    there = field.motion.camera("front").project(moved)
    assert np.abs(POINTS + shift - there).max() <= 1e-8


def test_strains_are_those_of_the_motion(field: TrueField) -> None:
    axes = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    plane = strain_tensor(axes @ GRADIENT @ axes.T, "green-lagrange")
    assert np.abs(field.plane_strain(1, "green-lagrange", axes) - plane).max() <= 1e-9
    # in the surface nothing depends on the axes but its components
    F = (np.eye(3) + GRADIENT) @ axes.T
    values = np.linalg.eigvalsh(0.5 * (F.T @ F - np.eye(2)))
    found = field.surface_strain(1, "green-lagrange")
    assert np.abs(np.linalg.eigvalsh(found) - values).max() <= 1e-9
    logarithmic = np.linalg.eigvalsh(field.surface_strain(1, "hencky"))
    assert np.abs(logarithmic - 0.5 * np.log1p(2.0 * values)).max() <= 1e-9


def test_the_picture_s_strain_is_the_slope_of_its_field(field: TrueField) -> None:
    image = field.field(1)
    x, y = POINTS.astype(int).T
    along = 0.5 * (image[y, x + 1] - image[y, x - 1])
    down = 0.5 * (image[y + 1, x] - image[y - 1, x])
    slopes = np.stack([along, down], axis=2)
    assert np.abs(field.picture_strain(1, "small") - strain_tensor(slopes, "small")).max() <= 1e-6


def test_a_pixel_s_width_is_that_on_the_surface(field: TrueField) -> None:
    # 50 um pixels, 25 mm, about 0.18 m away, at a small angle
    assert field.resolution() == pytest.approx(50e-6 * 0.18 / 25e-3, rel=0.03)


def test_the_second_camera_s_region_holds_the_same_material(field: TrueField) -> None:
    motion = field.motion
    region = region_of_second_camera(motion, field.roi, "front", "side")
    assert region.mask.sum() > 500
    x, y = np.rint(motion.pixels(region.points, "front", 0)).astype(int).T
    assert field.roi.mask[y, x].all()
    place = motion.position(region.points, 0)
    assert np.abs(place[:, 1]).max() <= 1e-12  # of the painted side alone
    assert place[:, 0].max() - place[:, 0].min() > 0.035


def test_slopes_of_what_is_seen_edge_on_have_no_inverse() -> None:
    slopes = np.array([[[2.0, 0.0], [0.0, 4.0]], [[1.0, 2.0], [2.0, 4.0]], [[0.0, 0.0]] * 2])
    found = inverse_slopes(slopes)
    np.testing.assert_allclose(found[0], [[0.5, 0.0], [0.0, 0.25]])
    assert np.isnan(found[1:]).all()
