"""Extensometer, gauge, line and point in a sheet whose motion is known in closed form."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.pipeline.checks.warnings import build_objects, geometry_warnings
from gpusim.pipeline.measurements.material_points import TrueMotion
from gpusim.pipeline.measurements.series.extensometer import _ends
from gpusim.pipeline.measurements.series.placing import ReferencePicture
from gpusim.pipeline.measurements.series.result import SeriesResult
from tests.support.report_figures import figures_drawn
from tests.support.speckled_plate import DOCUMENT

STRAINS = np.array([0.0, 1e-3, 4e-3])
"""Of the frames, along x; across -0.3 times that."""
MIDDLE = np.array([30.0, 15.0, 0.5])
APPROACH = 0.25
"""mm that the sheet moves towards the camera, 200 mm away, in the last frame."""
ONE: dict[str, Any] = {"camera": "top", "subset_px": 21}
SCALED = {**ONE, "mm_per_px": 0.25}
MEASURES: dict[str, dict[str, Any]] = {
    "pixels": {**ONE, "type": "extensometer", "ends_mm": [[10, 15, 1], [50, 15, 1]]},
    "lines": {**SCALED, "type": "extensometer", "ends_mm": [[10, 15, 1], [50, 15, 1]],
              "width_px": 64.0},
    "gauge": {**ONE, "type": "gauge", "center_px": [120, 60], "size_px": [101, 61]},
    "small": {**SCALED, "type": "gauge", "center_mm": [30, 15, 1], "size_mm": [10.0, 8.0],
              "strain": "hencky", "frames": [2]},
    "line": {**SCALED, "type": "line", "start_mm": [10, 20, 1], "end_mm": [55, 20, 1],
             "count": 26, "strain_window": 7},
    "points": {**SCALED, "type": "point", "points_mm": [[45, 8, 1], [12, 22, 1]],
               "names": ["right", "left"]},
    "lost": {**ONE, "type": "point", "points_px": [[120, 60], [14, 60]], "min_zncc": 0.5},
}  # fmt: skip
Get = Callable[[str], SeriesResult]


def sheet(
    folder: Path, measures: dict[str, dict[str, Any]], strains: npt.ArrayLike = STRAINS
) -> gs.Scene:
    """A sheet of 60 x 30 mm, 4 px/mm, that is pulled and comes nearer in the third frame. A wall
    covers its left end from the second frame on."""
    box = gs.mesh.box(size=(60.0, 30.0, 1.0), divisions=(6, 3, 1))
    cells = {f"cells_{kind}": nodes for kind, _, nodes in box.blocks()}
    motion = np.array([(box.points - MIDDLE) * [e, -0.3 * e, 0.0] for e in np.asarray(strains)])
    motion[2:, :, 2] += APPROACH
    times = np.arange(float(np.size(strains)))
    np.savez(folder / "motion.npz", points=box.points, displacement=motion, times=times, **cells)
    away, before = ({"position_mm": [x, 15.0, 6.0]} for x in (-90.0, -1.0))
    document = {
        "schema": 1, "name": "sheet",
        "body": [{"name": "sheet", "field": {"file": "motion.npz", "unit": "mm"}, "paint": [
            {"name": "speckle", "type": "speckle", "where": {"normal": "+z"}, "albedo": 0.8,
             "diameter_mm": 1.2, "softness_mm": 0.15, "spread": 0.3}]}],
        "prop": [{"name": "wall", "center_mm": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0],
                  "up": [0.0, 1.0, 0.0], "size_mm": [14.0, 40.0],
                  "paint": [{"name": "white", "type": "plain", "albedo": 0.9}],
                  "poses": [away, before, before][: np.size(strains)]}],
        "camera": [{"name": "top", "sensor_mm": [4.8, 2.4], "resolution_px": [240, 120],
                    "focal_mm": 16.0, "up": [0.0, 1.0, 0.0],
                    "position_mm": [30.0, 15.0, 201.0], "target_mm": [30.0, 15.0, 1.0]}],
        "analysis": {"type": "field", "times": times.tolist()},
        "sensor": {"bits": 12, "exposure": "auto"}, "output": {},
        "measure": [{"name": name, **one} for name, one in measures.items()],
    }  # fmt: skip
    return gs.Scene.from_document(document, folder=folder)


@pytest.fixture(scope="module")
def words() -> dict[str, str]:
    """The last that was told of each stage of the run."""
    return {}


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory, words: dict[str, str]) -> tuple[gs.Report, Path]:
    folder = tmp_path_factory.mktemp("series")
    with figures_drawn():
        report = gs.run(
            sheet(folder, MEASURES), folder / "out",
            progress=lambda stage, _, text: words.update({stage: text}),
        )  # fmt: skip
    return report, folder / "out"


def test_every_measure_is_told(done: tuple[gs.Report, Path], words: dict[str, str]) -> None:
    told = words["measure"].split("; ")
    assert sorted(text.partition(": ")[0] for text in told) == sorted(MEASURES)
    assert {"small: 1 gauge in 1 frame", "points: 2 points in 2 frames"} <= {*told}


@pytest.fixture
def found(done: tuple[gs.Report, Path]) -> Get:
    return lambda name: SeriesResult.read(done[1] / "measure", name)


def test_the_truth_is_the_closed_form(found: Get) -> None:
    for name in ("pixels", "lines"):
        assert found(name).table["true_strain"][:, 0] == pytest.approx(STRAINS[1:], rel=1e-9)
    scaled, table = found("lines").table, found("points").table
    # ends lie on whole pixels: within half of one
    assert scaled["true_length_mm"][:, 0] == pytest.approx(40.0 * (1 + STRAINS[1:]), abs=0.26)
    first = 40.0 + np.array([scaled["true_elongation_mm"][:, 0] / STRAINS[1:]]) - 40.0
    assert np.ptp(first) < 1e-9
    place = np.stack([table["x_px"][0], table["y_px"][0]], axis=1)
    from_middle = 0.25 * (place - [119.5, 59.5])
    for k, e in enumerate(STRAINS[1:]):
        exact = from_middle * [e, -0.3 * e]
        assert table.vectors("true")[k] == pytest.approx(exact, abs=1e-9)
    green = STRAINS[1:] + 0.5 * STRAINS[1:] ** 2
    gauge = found("gauge").table
    assert gauge["true_exx"][:, 0] == pytest.approx(green, rel=1e-9)
    assert gauge["true_e1"][:, 0] == pytest.approx(green, rel=1e-9)
    assert found("small").table["true_eyy"][0, 0] == pytest.approx(np.log1p(-1.2e-3), rel=1e-9)


def test_measured_strains(found: Get) -> None:
    """In the first loaded frame: what is left is 0.0003 px over the extensometer's length."""
    for name, quantity, limit in (
        ("pixels", "strain", 5e-6), ("lines", "strain", 5e-6),
        ("gauge", "exx", 12e-6), ("gauge", "eyy", 8e-6), ("gauge", "exy", 4e-6),
    ):  # fmt: skip
        error = found(name).table[f"difference_{quantity}"][0, 0]
        assert abs(error) < limit, (name, quantity)


def test_what_one_camera_reads_of_motion_towards_it_is_error(found: Get) -> None:
    """The picture grows by d / (z - d): not the material."""
    grown = APPROACH / (200.0 - APPROACH)
    for name in ("pixels", "lines"):
        expected = (1.0 + STRAINS[2]) * (1.0 + grown) - 1.0
        measured = found(name).table["measured_strain"][1, 0]
        assert measured == pytest.approx(expected, abs=8e-6)
    # lengths in px are those of the picture
    assert abs(found("pixels").table["difference_length_px"][1, 0]) < 1e-3
    error = found("lines").table["difference_elongation_mm"][1, 0]
    assert error == pytest.approx(40.0 * (1.0 + STRAINS[2]) * grown, rel=0.01)


def test_a_line_is_a_profile(found: Get, done: tuple[gs.Report, Path]) -> None:
    line = found("line")
    assert line.quantities == ["u_mm", "v_mm", "exx", "eyy", "exy"]
    way = line.table["along_mm"][0]
    assert way == pytest.approx(np.linspace(0.0, 45.0, 26), abs=0.26)
    assert np.abs(line.table["difference_u_mm"][0]).max() < 0.25 * 4e-3
    exx = line.table["measured_exx"][0]
    assert np.nanmean(exx) == pytest.approx(STRAINS[1], abs=20e-6)
    told = [one for one in done[0].series if one.name.startswith("line: u")]
    assert [one.name for one in told][:2] == ["line: u, frame 1", "line: u, frame 2"]
    assert np.array_equal(told[0].x, way) and told[0].x_label == "along the line (mm)"


def test_places_go_with_the_structure_that_frame_0_loads(tmp_path: Path) -> None:
    """The sheet is 5 % longer in frame 0: a place 15 mm from its middle is 0.75 mm further."""
    measures = {
        "tip": {**ONE, "type": "point", "points_mm": [[45, 15, 1]]},
        "extension": {**SCALED, "type": "extensometer", "ends_mm": [[20, 15, 1], [45, 15, 1]]},
    }
    scene = sheet(tmp_path, measures, strains=(0.05, 0.052))
    gs.run(scene, tmp_path / "out")
    tip, extension = (SeriesResult.read(tmp_path / "out/measure", name) for name in measures)
    # 4 px/mm at the sheet's top, whose middle is in the picture's
    assert tip.table["x_px"][0, 0] == pytest.approx(119.5 + 4.0 * 15.75, abs=0.51)
    place = 0.25 * (tip.table["x_px"][0, 0] - 119.5)
    assert tip.table["true_u_px"][0, 0] == pytest.approx(4.0 * place * 0.002 / 1.05, rel=1e-6)
    assert extension.table["true_length_mm"][0, 0] == pytest.approx(25.0 * 1.052, abs=0.27)


@pytest.mark.parametrize(
    "keys",
    [
        {"type": "extensometer", "ends_mm": [[10, 15, 1], [61, 15, 1]]},
        {"type": "gauge", "center_mm": [61, 15, 1], "size_mm": [10.0, 8.0]},
        {"type": "line", "start_mm": [10, 15, 1], "end_mm": [61, 15, 1]},
        {"type": "point", "points_mm": [[10, 15, 1], [61, 15, 1]]},
    ],
)
def test_a_place_beside_the_structure_that_frame_0_loads_is_told(
    keys: dict[str, Any], tmp_path: Path
) -> None:
    """That place, in the unit in which it was given, though others stand beside it."""
    scene = sheet(tmp_path, {"off": {**SCALED, **keys}}, strains=(0.05, 0.052))
    told = r"measure 'off': \w+_mm; got \[61.0, 15.0, 1.0\], where camera 'top' sees nothing"
    with pytest.raises(InputError, match=told):
        gs.run(scene, tmp_path / "out")


def test_ends_are_as_wide_as_they_are_said_to_be(tmp_path: Path) -> None:
    for width, count in ((0.0, 1), (20.0, 1), (42.0, 2), (62.0, 2), (63.0, 3), (84.0, 4)):
        keys = {**SCALED, "type": "extensometer", "ends_mm": [[10, 15, 1], [50, 15, 1]]}
        scene = sheet(tmp_path, {"wide": {**keys, "width_px": width}})
        (spec,) = scene.measures
        picture = ReferencePicture(spec, TrueMotion(build_objects(scene)))
        ends = _ends(spec, picture)
        for end in ends.values():
            assert len(end) == count and end.mean(axis=0) == pytest.approx(end[:1][0], abs=10.6)
            across = np.sort(end[:, 1])
            assert np.diff(across) == pytest.approx(21.0)
            assert across.mean() == pytest.approx(59.5, abs=1e-6)


def test_lost_points_are_told_with_the_reason(done: tuple[gs.Report, Path], found: Get) -> None:
    lost = found("lost").table
    assert lost["status"].tolist() == [["OK", "HIDDEN"]] * 2
    assert np.isnan(lost["measured_u_px"][:, 1]).all()
    assert np.isfinite(lost["true_u_px"]).all()
    assert "measure 'lost': not measured: p2 (HIDDEN)" in done[0].warnings


def test_what_the_report_says(done: tuple[gs.Report, Path], found: Get) -> None:
    report, out = done
    told = {one.name: one for one in report.measurements}
    strain = told["pixels: strain"]
    assert strain.unit == "um/m" and strain.truth == pytest.approx(4000.0, rel=1e-9)
    assert strain.verdict == "bad"  # it came nearer
    assert told["pixels: length"].unit == "px" and told["lines: length"].unit == "mm"
    assert told["points: right, u"].truth == pytest.approx(0.0605, rel=1e-9)
    assert told["points: RMS error of u, all frames"].unit == "mm"
    assert {"points: u, right", "gauge: exx"} <= {one.name for one in report.series}
    rows = (out / "measure" / "points.csv").read_text().splitlines()
    assert rows[0].startswith("frame,point,status,followed,x_px,y_px,") and len(rows) == 1 + 2 * 2
    labels = [link.label for link in report.links]
    assert len({*labels}) == len(labels) and "Measured: points" in labels
    page = (out / "report.html").read_text()
    assert "points: tracked subsets" in page and "line: u along the line" in page


@pytest.mark.drawn
def test_a_pair_reads_the_material(tmp_path: Path) -> None:
    """Nominal stress far from the hole; both ends of an extensometer over it."""
    common = {"cameras": ["left", "right"], "lens": "pinhole", "subset_px": 21}
    document = {**copy.deepcopy(DOCUMENT), "measure": [
        {"name": "extension", "type": "extensometer", **common,
         "ends_mm": [[-45.0, 20.0, 2.0], [45.0, 20.0, 2.0]], "width_px": 64.0},
        {"name": "far", "type": "gauge", **common, "center_mm": [42.0, 0.0, 2.0],
         "size_mm": [20.0, 20.0]},
        {"name": "tip", "type": "point", **common, "points_mm": [[50.0, 20.0, 2.0]]},
        {"name": "exact", "type": "point", **common, "points_mm": [[50.0, 20.0, 2.0]],
         "calibration": "true"},
    ]}  # fmt: skip
    report = gs.run(gs.Scene.from_document(document), tmp_path / "out")
    extension, far, tip, exact = (
        SeriesResult.read(tmp_path / "out/measure", name).table
        for name in ("extension", "far", "tip", "exact")
    )
    nominal = 50e3 / (70e9 * 0.06 * 0.004)
    assert far["true_exx"][0, 0] == pytest.approx(nominal, rel=0.12)
    assert far["true_eyy"][0, 0] / far["true_exx"][0, 0] == pytest.approx(-0.33, abs=0.1)
    assert abs(far["difference_exx"][0, 0]) < 40e-6
    assert extension["true_length_mm"][0, 0] == pytest.approx(90.0, abs=0.8)
    assert abs(extension["difference_strain"][0, 0]) < 20e-6
    # one point alone: the rig is laid on the structure by the rest of the speckle
    for one in (tip, exact):
        error = one.vectors("difference")[0, 0]
        assert np.abs(error[:2]).max() < 2e-3 and abs(error[2]) < 8e-3
    assert report.warnings == ()


@pytest.mark.parametrize(
    ("measure", "text"),
    [
        ({"type": "gauge", "center_px": [9, 9]}, "size_px: where it is; got neither"),
        ({"type": "extensometer", "ends_px": [[1, 1], [9, 9]], "ends_mm": [[0, 0, 0], [1, 0, 0]]},
         "ends_px: where it is; got both"),
        ({"type": "extensometer", "ends_px": [[1, 1]]}, "ends_px"),
        ({"type": "point", "points_px": [[30, 30]], "names": ["a", "b"]}, "one for each point"),
        ({"type": "line", "start_px": [30, 30], "end_px": [50, 30], "frames": [7]},
         "no such frame; got 7"),
        ({"type": "gauge", "center_px": [9, 9], "size_px": [50, 50], "strain": "small"}, "strain"),
    ],
)  # fmt: skip
def test_what_is_not_a_place_is_told(measure: dict[str, Any], text: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=text):
        sheet(tmp_path, {"wrong": {**ONE, **measure}})


@pytest.mark.parametrize(
    ("measure", "text"),
    [
        ({"type": "point", "points_mm": [[30, 15, 2], [300, 15, 2]]},
         r"measure 'wrong': p2; got \(\d+, \d+\) px of camera 'left'"),
        ({"type": "line", "start_px": [5, 60], "end_px": [100, 60]}, "p01; got"),
        ({"type": "gauge", "center_px": [120, 60], "size_px": [22, 80]},
         "size; got 22 x 80 px; expected room for two subsets"),
        ({"type": "gauge", "center_px": [2, 2], "size_mm": [8.0, 8.0]},
         r"size_mm; got \(2, 2\) px of camera 'left' as the middle"),
    ],
)  # fmt: skip
def test_places_that_are_not_seen_are_told_before_any_work(
    measure: dict[str, Any], text: str
) -> None:
    spec = {"name": "wrong", "camera": "left", "subset_px": 21, **measure}
    scene = gs.Scene.from_document({**copy.deepcopy(DOCUMENT), "measure": [spec]})
    with pytest.raises(InputError, match=text):
        geometry_warnings(build_objects(scene))
