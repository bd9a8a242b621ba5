"""Points of a camera's picture on the bodies: where they are, that they move, what is shown."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

import gpusim as gs
from gpusim.gpu import Device
from gpusim.pipeline.measurements.results import PointTable
from gpusim.view.content.loading import load_content
from gpusim.view.content.measured_points import MeasuredPoints, measured_points
from gpusim.view.screenshot import screenshot
from gpusim.view.viewer import Viewer
from tests.support.measured_fields import FieldResult

X, Y = (one.ravel() for one in np.meshgrid(np.arange(60.0, 400.0, 10), (55.0, 65.0)))


@pytest.fixture
def measured_run(run_folder: Path, tmp_path: Path) -> Path:
    """OUT with what was measured in frame 1: known functions of the place in the picture."""
    out = tmp_path / "out"
    shutil.copytree(run_folder, out)
    lost = np.where(np.arange(len(X)) == 7, np.nan, 0.0)
    columns = {
        "status": np.full((1, len(X)), "OK"), "x_px": X[None], "y_px": Y[None],
        "measured_v_px": (0.01 * X + lost)[None], "true_v_px": (0.01 * X - 0.002 * Y)[None],
        "measured_exx": (1e-5 * X)[None], "true_exx": (1e-5 * X)[None],
        "sigma_px": np.full((1, len(X)), 0.003),
    }  # fmt: skip
    names = tuple(f"p{k}" for k in range(len(X)))
    result = FieldResult("dic", PointTable("point", (1,), names, columns), ("side",))
    for name, content in result.contents().items():
        assert isinstance(content, bytes)
        (out / "measure" / name).write_bytes(content)
    return out


def test_points_are_where_the_camera_saw_them(measured_run: Path, device: Device) -> None:
    content = load_content(measured_run)
    (points,) = content.measured
    assert (points.name, points.camera, points.table.frames) == ("dic", "side", (1,))
    point, places = content.squares(points, device)
    assert len(point) == len(X)
    camera, surface = content.cameras[0], content.surfaces(0)[0]
    at = np.stack([X, Y], axis=1)
    corners = np.einsum("nkv,nvd->nkd", places.weights, surface.points[places.vertices])
    for k, (dx, dy) in enumerate([(0, 0), (-5, -5), (5, -5), (5, 5), (-5, 5)]):
        np.testing.assert_allclose(camera.project(corners[:, k]), at[point] + [dx, dy], atol=1e-7)
    np.testing.assert_allclose(corners[:, 0, 1], 0.0, atol=1e-12)  # on the side that it sees
    np.testing.assert_allclose(corners, places.reference, atol=1e-12)


def test_measured_true_and_their_difference(measured_run: Path, device: Device) -> None:
    viewer = Viewer(device, measured_run, (480, 320))
    content = viewer.content
    assert content is not None and viewer.fault == ""
    viewer.look_through(0)
    painted = screenshot(viewer)
    viewer.show_field("dic/measured_v_px")
    shared = viewer.color_scale.limits
    found = viewer.field_values
    assert found is not None and found.field.label() == "dic: v measured (px)"
    np.testing.assert_allclose(found.values[0], np.where(np.arange(len(X)) == 7, np.nan, 0.01 * X))
    camera, left, top = viewer.camera()
    share = camera.width / content.cameras[0].width
    rest = content.surfaces(0)[0]
    point, places = content.squares(content.measured[0], device)
    moved = viewer.surfaces()[0].points[places.vertices]
    assert not np.allclose(moved, rest.points[places.vertices])
    at = camera.project(np.einsum("nv,nvd->nd", places.weights[:, 0], moved)) + 0.5
    picture = screenshot(viewer)
    column, row = (np.floor(at[:, k] + offset).astype(int) for k, offset in ((0, left), (1, top)))
    scale = viewer.color_scale
    level = (0.01 * X[point] - scale.low) / (scale.high - scale.low)
    wanted = 255.0 * scale.colors[np.rint(255 * level).astype(int)]
    free = (row > 90) & (point != 7)  # not below what is written over it
    assert share > 0.5 and free.sum() > 40
    np.testing.assert_allclose(picture[row, column][free], wanted[free], atol=2.0)
    lost = point == 7
    np.testing.assert_array_equal(picture[row, column][lost], painted[row, column][lost])
    viewer.show_field("dic/true_v_px")
    assert viewer.color_scale.limits == shared  # told apart by their colours alone
    viewer.show_field("dic/difference_v_px")
    np.testing.assert_allclose(viewer.field_values.values[0][:7], 0.002 * Y[:7])  # type: ignore
    viewer.show_field("dic/measured_exx")
    assert viewer.field_values.field.unit == "10⁻³"  # type: ignore[union-attr]
    np.testing.assert_allclose(viewer.field_values.values[0], 0.01 * X)  # type: ignore
    viewer.show_frame(0)  # in which nothing was measured
    assert np.isnan(viewer.field_values.values[0]).all() and viewer.fault == ""  # type: ignore
    viewer.key("x")
    screenshot(viewer)
    assert viewer.fault == ""
    viewer.close()


def test_points_beside_the_bodies_are_left_out(run_folder: Path, device: Device) -> None:
    """In the background, out of the picture, nowhere; a single one is 40 px wide."""
    content = load_content(run_folder)
    for x, y, shown in (
        ([100.0, 110.0, 120.0, 100.0, -3.0, np.nan], [60.0, 60.0, 60.0, 5.0, 60.0, 1.0], [0, 1, 2]),
        ([100.0, 451.0], [60.0, 60.0], [0]),
        ([9.0, 451.0], [3.0, 60.0], []),
    ):  # fmt: skip
        names = tuple(f"p{k}" for k in range(len(x)))
        columns = {"x_px": np.array([x]), "y_px": np.array([y]), "zncc": np.ones((1, len(x)))}
        points = MeasuredPoints("dic", "side", PointTable("point", (1,), names, columns))
        found = points.squares(content.surfaces(0), content.cameras[0], device)
        assert found.point.tolist() == shown
        assert np.isfinite(found.places.weights).all()
        for corners in found.places.reference[:, 1:]:
            at = content.cameras[0].project(corners)
            np.testing.assert_allclose(np.ptp(at, axis=0), 10.0 if len(shown) > 1 else 40.0)


def test_a_click_tells_the_nearest_point(measured_run: Path, device: Device) -> None:
    from gpusim.view.body_marks import mark_selection

    viewer = Viewer(device, measured_run, (480, 320))
    viewer.look_through(0)
    viewer.show_field("dic/measured_v_px")
    screenshot(viewer)
    content = viewer.content
    assert content is not None
    point, places = content.squares(content.measured[0], device)
    moved = viewer.surfaces()[0].points
    at = np.einsum("v,vd->d", places.weights[20, 0], moved[places.vertices[20]])
    viewer.select(*viewer.place.window(viewer.camera()[0].project(at)))
    lines = mark_selection(viewer, viewer.overlay).splitlines()
    assert lines[-1] == f"dic: v measured {0.01 * X[point[20]]:.4g} px"
    viewer.close()


def test_other_measurements_and_damage(measured_run: Path) -> None:
    """A file of markers has no points in a picture; a damaged file is named."""
    assert (measured_run / "measure" / "tip.npz").is_file()
    assert measured_points(measured_run / "measure" / "tip.npz") is None
    path = measured_run / "measure" / "dic.npz"
    whole = path.read_bytes()
    for damaged in (b"", b"PK\3\4 and no more", whole[: len(whole) // 2], whole[:-30]):
        path.write_bytes(damaged)
        with pytest.raises(gs.InputError, match=r"dic\.npz: damaged"):
            load_content(measured_run)
    shutil.rmtree(measured_run / "measure")
    assert not load_content(measured_run).measured
