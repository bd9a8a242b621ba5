"""One catalogue of what was measured: tables and maps take values, units and titles from it."""

from __future__ import annotations

import numpy as np
import pytest

from gpusim.export.correlation import csv_names, result_columns
from gpusim.export.measured_fields import field_maps
from gpusim.measure import (
    CalibratedCamera,
    DicResult,
    Status,
    StereoResult,
    dic,
    mapped,
    plane_mapping,
    rig_camera,
    strain,
)
from tests.support.measure_images import speckles

STATUS = np.array([0, 0, int(Status.LOW_CORRELATION)], np.int8)


def flat() -> DicResult:
    """Three points, of which the last was not measured; all numbers differ."""
    return DicResult(
        points=np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]),
        displacement=np.array([[3.0, -4.0], [0.5, 0.25], [np.nan, np.nan]]),
        gradient=np.arange(12.0).reshape(3, 2, 2) / 100,
        zncc=np.array([0.99, 0.98, 0.3]),
        sigma=np.array([0.01, 0.02, np.nan]),
        iterations=np.array([3, 4, 50], np.int32),
        status=STATUS,
        subset=21,
    )


def space() -> StereoResult:
    values = np.arange(9.0).reshape(3, 3)
    return StereoResult(
        points=np.zeros((3, 2)), left=np.zeros((3, 2)), right=np.array([[7.0, 8.0]] * 3),
        shape=values + 100, displacement=values + 200, sigma=values + 300,
        residual=np.array([0.1, 0.2, 0.3]), status=STATUS, subset=21,
    )  # fmt: skip


def test_columns_are_components_of_the_result() -> None:
    columns = result_columns(flat())
    assert columns["du_dy"].tolist() == [0.01, 0.05, 0.09]
    assert columns["dv_dx"].tolist() == [0.02, 0.06, 0.10]
    assert columns["v"][:2].tolist() == [-4.0, 0.25]
    assert columns["iterations"].dtype == np.int32 and columns["zncc"][2] == 0.3
    assert csv_names(columns)[-1] == "status" and "magnitude" not in columns
    columns = result_columns(space())
    assert [columns[name][1] for name in ("x_right", "y_right")] == [7, 8]
    assert [columns[name][1] for name in ("X", "V", "sigma_Z", "residual")] == [103, 204, 305, 0.2]


def test_maps_are_empty_where_nothing_was_measured_and_say_their_unit() -> None:
    maps = field_maps(flat(), ("u", "magnitude", "sigma", "zncc"))
    assert [one.title for one in maps.values()] == [
        "u (px, to the right)", "displacement (px)", "standard uncertainty (px)",
        "correlation coefficient",
    ]  # fmt: skip
    assert maps["magnitude"].values[0] == 5.0
    assert all(np.isnan(one.values[2]) and not one.centred for one in maps.values())
    maps = field_maps(space(), ("W", "Z", "residual"), "unit of the rig")
    assert [one.title for one in maps.values()] == [
        "W (unit of the rig, away)", "Z (unit of the rig, from the left camera)",
        "distance to the rays (px)",
    ]  # fmt: skip
    assert field_maps(space(), ("magnitude",))["magnitude"].title == "displacement (mm)"


def test_strains_and_mapped_results_have_their_own_components() -> None:
    result = dic(speckles(97, 81), speckles(97, 81, shift=(0.5, 0.25)), subset=21, backend="numpy")
    found = strain(result)
    maps = field_maps(found, ("exx", "eyy", "exy", "e1"))
    for name, i, j in (("exx", 0, 0), ("eyy", 1, 1), ("exy", 0, 1)):
        np.testing.assert_array_equal(maps[name].values[found.ok], found.tensor[found.ok, i, j])
    assert all(one.centred for one in maps.values())
    camera: CalibratedCamera = rig_camera((97, 81), [[90.0, 0, 48], [0, 90, 40], [0, 0, 1]])
    pose = np.eye(4)
    pose[2, 3] = 9.0
    on_plane = mapped(result, plane_mapping(camera, pose))
    maps = field_maps(on_plane, ("u", "v", "sigma"), "unit of the mapping")
    assert maps["v"].title == "displacement along y (unit of the mapping)"
    assert float(np.nanmedian(maps["u"].values)) == pytest.approx(0.05, abs=2e-3)
    assert maps["sigma"].title == "standard uncertainty (unit of the mapping)"
