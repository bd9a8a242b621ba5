"""One catalogue of fields: pictures, tables and maps take values, units and titles from it."""

from __future__ import annotations

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export.body_state import KNOWN, BodyState
from gpusim.export.correlation import csv_names, result_columns
from gpusim.export.field_catalogue import (
    BODY,
    TRUTH,
    VTU_ARRAYS,
    field_maps,
    point_fields,
)
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
from tests.support.view_bodies import small_crane

E, NU, STRESS = 70e9, 0.3, 21e6
RANDOM = np.random.default_rng(4)


def pulled_bar() -> BodyState:
    """Stress 21 MPa along y, exactly, and a hundredth of it along z."""
    bar = gs.mesh.box(size=(0.1, 0.4, 0.2), divisions=(2, 3, 2))
    model = gs.Model(bar, gs.Isotropic(E, NU))
    own = np.array([0.0, STRESS, 0.01 * STRESS])
    strain = ((1.0 + NU) * own - NU * own.sum()) / E
    return BodyState(bar, bar.points * strain, model)


def test_stress_and_strain_of_a_pulled_bar() -> None:
    state = pulled_bar()
    own = np.array([0.0, 21.0, 0.21])
    mises = np.sqrt(0.5 * (21.0**2 + 20.79**2 + 0.21**2))
    expected = {
        "von_mises": mises, "element_von_mises": mises, "principal_stress_1": 21.0,
        "principal_stress_2": 0.21,
        "principal_stress_3": 0.0, "stress_xx": 0.0, "stress_yy": 21.0, "stress_zz": 0.21,
        "stress_xy": 0.0, "error_share": 0.0,
        "strain_yy": 1e3 * (own[1] - NU * own[2]) / (1e-6 * E),
        "principal_strain_1": 1e3 * (own[1] - NU * own[2]) / (1e-6 * E),
        "principal_strain_3": -1e3 * NU * (own[1] + own[2]) / (1e-6 * E),
    }  # fmt: skip
    for name, value in expected.items():
        values = BODY[name].values(state)
        count = state.mesh.cell_count if BODY[name].place == "elements" else state.mesh.node_count
        assert values.shape == (count,)
        assert values == pytest.approx(value, rel=1e-9, abs=1e-8), name


def test_shear_strain_is_the_tensors() -> None:
    bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    u = np.stack([4e-4 * bar.points[:, 1], 0 * bar.points[:, 0], 0 * bar.points[:, 0]], axis=1)
    state = BodyState(bar, u, gs.Model(bar, gs.Isotropic(E, NU)))
    assert BODY["strain_xy"].values(state) == pytest.approx(0.2, rel=1e-9)
    assert BODY["principal_strain_1"].values(state) == pytest.approx(0.2, rel=1e-9)
    assert BODY["stress_xy"].values(state) == pytest.approx(4e-4 * E / 2.6 * 1e-6, rel=1e-9)


def test_displacement_and_stress_that_is_given() -> None:
    crane = small_crane()
    mesh, solution = crane.model.mesh, crane.solution
    stress = np.tile([5e6, 0, 0, 0, 0, 0], (mesh.node_count, 1))
    state = BodyState(mesh, solution.u, known={"stress": stress})
    u = 1e3 * solution.u
    assert BODY["displacement"].values(state) == pytest.approx(np.hypot.reduce(u, axis=1))
    assert BODY["displacement_z"].values(state) == pytest.approx(u[:, 2])
    assert BODY["von_mises"].values(state) == pytest.approx(5.0)


def test_what_a_body_has_not_is_said() -> None:
    bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    state = BodyState(bar, 0 * bar.points)
    with pytest.raises(InputError, match="without a material"):
        BODY["von_mises"].values(state)


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
    maps = field_maps(space())
    assert [maps[name].title for name in ("W", "Z", "residual")] == [
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
    maps = field_maps(on_plane)
    assert maps["v"].title == "displacement along y (unit of the mapping)"
    assert float(np.nanmedian(maps["u"].values)) == pytest.approx(0.05, abs=2e-3)
    assert maps["sigma"].title == "standard uncertainty (unit of the mapping)"


def test_truth_layers_are_fields_of_pixels() -> None:
    layers = {
        "displacement": np.array([[[3e-3, 0.0, 4e-3], [np.nan, np.nan, np.nan]]]),
        "flow": np.array([[[0.5, -1.2], [np.nan, np.nan]]]),
        "depth": np.array([[0.8, np.nan]]),
        "region": np.array([[2, -1]], np.int32),
    }
    expected = {
        "truth_displacement": 5.0, "truth_displacement_z": 4.0, "truth_flow": 1.3,
        "truth_flow_y": -1.2, "truth_depth": 800.0, "truth_region": 2,
    }  # fmt: skip
    for name, value in expected.items():
        found = TRUTH[name].values(layers)
        assert TRUTH[name].place == "pixels" and found.shape == (1, 2)
        assert found[0, 0] == pytest.approx(value)
        assert np.isnan(found[0, 1]) or found[0, 1] == -1
    assert TRUTH["truth_displacement_z"].label() == "displacement along z (mm)"
    assert TRUTH["truth_flow"].label() == "flow (px)" and TRUTH["truth_region"].label() == "region"


def test_arrays_of_vtu_are_in_si_and_none_of_what_isnt_known() -> None:
    state = pulled_bar()
    alone = {name: one.of(state) for name, one in VTU_ARRAYS.items()}
    assert [name for name, values in alone.items() if values is not None] == ["u"]
    np.testing.assert_array_equal(alone["u"], state.u)
    known = {name: RANDOM.normal(size=(5, 6)) for name in KNOWN}
    given = BodyState(state.mesh, state.u, known=known)
    arrays = {name: one.of(given) for name, one in VTU_ARRAYS.items()}
    for name, own in (("stress", "stress"), ("strain", "strain"), ("error_share", "error"),
                      ("plastic_strain", "plastic"), ("piola_stress", "piola"),
                      ("green_lagrange_strain", "green")):  # fmt: skip
        np.testing.assert_array_equal(arrays.pop(name), known[own])
    np.testing.assert_allclose(1e-6 * arrays.pop("von_mises"), BODY["von_mises"].values(given))
    assert list(arrays) == ["u"]
    assert VTU_ARRAYS["error_share"].place == "elements"


def test_fields_of_a_table_of_a_measurement() -> None:
    """Quantity by quantity, with the difference to what is known; strains in thousandths."""
    columns = {
        "measured_Z_mm": np.array([[4.0]]), "measured_exx": np.array([[3e-3]]),
        "true_Z_mm": np.array([[3.5]]), "true_exx": np.array([[2e-3]]),
        "levelled_exx": np.array([[2.5e-3]]), "zncc": np.array([[0.9]]),
        "measured_u_px": np.array([[1.0]]), "sigma_U_mm": np.array([[0.1]]),
    }  # fmt: skip
    fields = point_fields(columns)
    found = {name: (one.label(), one.signed, float(one.values(columns)[0, 0]))
             for name, one in fields.items()}  # fmt: skip
    assert found == {
        "measured_Z_mm": ("Z measured (mm)", False, 4.0),
        "true_Z_mm": ("Z true (mm)", False, 3.5),
        "difference_Z_mm": ("Z difference (mm)", True, 0.5),
        "measured_exx": ("exx measured (10⁻³)", True, 3.0),
        "true_exx": ("exx true (10⁻³)", True, 2.0),
        "levelled_exx": ("exx levelled (10⁻³)", True, 2.5),
        "difference_exx": ("exx difference (10⁻³)", True, pytest.approx(1.0)),
        "measured_u_px": ("u measured (px)", True, 1.0),
        "zncc": ("zncc", False, 0.9),
        "sigma_U_mm": ("sigma U (mm)", False, 0.1),
    }
    assert list(fields) == list(found)
    assert all(one.place == "points" for one in fields.values())
