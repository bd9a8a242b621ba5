"""Measurements over several frames: each against the first, a series per marker."""

from __future__ import annotations

import csv
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError
from gpusim.export.images import read_image
from gpusim.pipeline.measurements.deflection import DeflectionResult, measure_deflection
from gpusim.pipeline.measurements.marker_measurement import MarkerResult
from gpusim.pipeline.measurements.results import PointTable
from gpusim.pipeline.scene_objects.surfaces import build_body
from tests.support.documented_tables import documented_columns, head
from tests.support.report_figures import figures_drawn
from tests.support.small_scene import small_scene

FACTORS = (0.0, -0.5, 0.4, 1.0)


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> tuple[gs.Report, Path]:
    out = tmp_path_factory.mktemp("frames") / "out"
    scene = small_scene(analysis={"load_factors": list(FACTORS)}, output={})
    with figures_drawn():
        return gs.run(scene, out, backend="numpy"), out


@pytest.fixture(scope="module")
def result(done: tuple[gs.Report, Path]) -> DeflectionResult:
    return DeflectionResult.read(done[1] / "measure", "tip")


def test_every_frame_is_measured_against_the_first(result: DeflectionResult) -> None:
    assert result.table.frames == (1, 2, 3) and (result.table["status"] == "OK").all()
    true, measured = result.table.vectors("true"), result.table.vectors("measured")
    assert true.shape == measured.shape == (3, 4, 2)
    # linear statics: all frames show one shape
    for frame, factor in enumerate(FACTORS[1:]):
        assert true[frame] == pytest.approx(factor * true[-1], rel=1e-9, abs=1e-12)
    assert np.abs(measured - true).max() <= 0.02  # mm; 0.6 mm/px
    assert np.abs(true[:, -1, 1]).max() > 0.3


def test_the_last_frame_is_the_headline(
    done: tuple[gs.Report, Path], result: DeflectionResult, tmp_path: Path
) -> None:
    report, _ = done
    alone = gs.run(small_scene(output={}), tmp_path / "out", backend="numpy")
    assert report.measurements == alone.measurements
    assert np.array_equal(result.measured_mm, result.table.vectors("measured")[-1])
    only = DeflectionResult.read(tmp_path / "out" / "measure", "tip")
    assert only.table.frames == (1,)
    for name, column in only.table.columns.items():
        assert np.array_equal(column[0], result.table[name][-1]), name
    assert np.array_equal(only.curves, result.curves)
    # one frame has no series over frames
    assert [one.name for one in alone.series] == [report.series[0].name]


def test_a_row_for_each_frame_and_marker(
    done: tuple[gs.Report, Path], result: DeflectionResult, checkout: Path
) -> None:
    path = done[1] / "measure" / "tip.csv"
    assert head(path) == "frame," + documented_columns(checkout, "measure/<deflection>.csv")
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["frame"], row["marker"]) for row in rows] == [
        (str(frame), f"side-{k:02d}") for frame in (1, 2, 3) for k in (1, 2, 3, 4)
    ]
    measured = np.array([float(row["measured_z_mm"]) for row in rows])
    assert measured == pytest.approx(result.table["measured_z_mm"].ravel(), rel=1e-6)


def test_a_series_per_marker(done: tuple[gs.Report, Path], result: DeflectionResult) -> None:
    report, out = done
    line, *histories = report.series
    assert line.figure == "" and [one.name for one in histories] == [
        f"tip: side-{k:02d}, displacement along -z" for k in (1, 2, 3, 4)
    ]
    for k, one in enumerate(histories):
        assert one.x.tolist() == list(FACTORS[1:]) and one.x_label == "load factor"
        assert np.array_equal(one.y_measured, -result.table["measured_z_mm"][:, k])
        assert np.array_equal(one.y_truth, -result.table["true_z_mm"][:, k])
    drawn = sorted(path.name for path in (out / "figures").glob("line-*"))
    assert drawn == ["line-1-side_deflection_along_-z.png",
                     "line-2-tip_side_displacement_along_-z.png"]  # fmt: skip


def test_a_frame_in_which_all_markers_are_lost_has_no_numbers(
    done: tuple[gs.Report, Path], result: DeflectionResult
) -> None:
    scene = small_scene(analysis={"load_factors": list(FACTORS)}, output={})
    body = build_body(scene.bodies[0], scene.input)
    still = np.zeros((body.mesh.node_count, 3))
    objects: Any = SimpleNamespace(bodies=[body], displacement=lambda body, frame: still)

    def image(camera: str, frame: int) -> np.ndarray:
        taken = read_image(done[1] / "images" / camera / f"{frame:04d}.png")
        return np.full_like(taken, 80) if frame == 2 else taken

    sources: Any = SimpleNamespace(image=image)
    table = measure_deflection(scene.measures[0], scene, objects, sources).table  # type: ignore[arg-type]
    measured, before = table.vectors("measured"), result.table.vectors("measured")
    assert (table["status"] == "OK").any(axis=1).tolist() == [True, False, True]
    assert np.isnan(measured[1]).all() and np.array_equal(measured[::2], before[::2])


def test_a_marker_lost_on_the_way_is_told_with_its_frame() -> None:
    status = np.array([["OK", "LOST", "LOST"], ["OK", "LOST", "OK"], ["OK", "OK", "FAR"]])
    none = np.zeros((3, 3), dtype=bool)
    columns = {"status": status, "saturated": none, "unrefined": none}
    result = MarkerResult("line", PointTable("marker", (1, 2, 5), ("a", "b", "c"), columns))
    assert result.warnings == ["measure 'line': not measured: b (LOST in frame 2), c (FAR)"]
    assert result.measured_count == "2 of 3 markers"


def test_columns_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match=r"measured_mm; expected columns of 2 frames and 1 dots"):
        PointTable("dot", (1, 2), ("a",), {"measured_mm": np.zeros((1, 2))})
    with pytest.raises(InputError, match="empty"):
        PointTable("dot", (), ("a",), {})
