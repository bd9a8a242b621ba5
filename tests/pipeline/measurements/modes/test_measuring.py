"""Modes measured in a film of a bar that is let go, against those of the solver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gpusim as gs
from gpusim.errors import InputError, SceneError
from gpusim.pipeline.measurements.modes.result import ModesResult
from gpusim.pipeline.measurements.results import PointTable
from gpusim.plan.scene_stages import scene_stages
from gpusim.plan.stages import RunOptions
from gpusim.report.text import number
from gpusim.scene import Scene
from gpusim.scene.cost import describe
from tests.support.small_scene import DOCUMENT, small_scene

FILM = {"type": "transient", "duration_s": 0.064, "frame_rate_Hz": 1000.0, "count": 2,
        "release": ["push"], "damping": {"ratio": 0.02}}  # fmt: skip
SPECKLE = {"name": "side", "type": "speckle", "where": {"normal": "-y"}, "diameter_mm": 2.4,
           "softness_mm": 0.6, "albedo": 0.7}  # fmt: skip
MODES = {"name": "modes", "type": "modes", "camera": "side", "start_mm": [30.0, 0.0, 5.0],
         "end_mm": [230.0, 0.0, 5.0], "count": 6, "subset_px": 9, "modes": 1,
         "excitation": "release"}  # fmt: skip
CAMERA = {**DOCUMENT["camera"][0], "resolution_px": [300, 40], "sensor_mm": [15.0, 2.0]}


def film(analysis: Any = FILM, **keys: Any) -> Scene:
    grey, _ = DOCUMENT["body"][0]["paint"]
    body = {**DOCUMENT["body"][0], "paint": [grey, SPECKLE]}
    measure = {key: value for key, value in {**MODES, **keys}.items() if value is not None}
    return small_scene(analysis=analysis, body=[body], camera=[CAMERA], measure=[measure],
                       output={"fields": False})  # fmt: skip


def test_a_bar_that_is_let_go(tmp_path: Path) -> None:
    report = gs.run(film(), tmp_path, backend="numpy")
    assert describe(film())["measure"] == "6 points"
    told = {one.name: one for one in report.measurements}
    frequency, damping, likeness = (
        told[f"modes: mode 1, {what}"] for what in ("frequency", "damping", "MAC")
    )
    assert frequency.truth == pytest.approx(143.0, rel=0.02) and damping.truth == pytest.approx(2.0)
    assert {one.verdict for one in (frequency, damping, likeness)} == {"good"}
    assert len(report.series) == 1 and len(report.overlays) == 1
    (row,) = report.first_tables[1].rows
    assert row[:2] == ("mode 1", "1") and all("±" in one for one in row[2:4])
    assert abs(float(row[2].split()[0]) - frequency.measured) <= float(row[2].split()[2])
    result = ModesResult.read(tmp_path / "measure", "modes")
    assert not any("modes found" in one for one in result.warnings)
    more = replace(result, sought=2).warnings
    assert "measure 'modes': 1 of 2 modes found" in more
    assert result.displacement_px.shape == (65, 6 - result.lost, 2) and result.lost <= 1
    assert np.abs(result.shapes - result.true_shapes).max() < 0.02
    rows = (tmp_path / "measure/modes-series.csv").read_text().splitlines()
    assert len(rows) == 66 and rows[0].startswith("time_s,p1_x_px,p1_y_px")
    with pytest.raises(InputError, match="measure 'modes': identify_modes: no mode between 200"):
        gs.run(film(band_Hz=[200.0, 300.0]), tmp_path, backend="numpy")


def test_modes_without_a_true_one_stand_alone(tmp_path: Path) -> None:
    columns = dict.fromkeys(
        [
            "measured_frequency_Hz",
            "measured_damping",
            "true_frequency_Hz",
            "true_damping",
            "mac",
            "sigma_frequency_Hz",
            "sigma_damping",
        ],
        np.array([np.nan]),
    )
    columns |= {"measured_frequency_Hz": np.array([143.0]), "measured_damping": np.array([0.0])}
    shapes, table = np.ones((1, 2, 2)), PointTable.of("mode", ("mode 1",), {63: columns})
    result = ModesResult("modes", table, "side", shapes[0], shapes, np.nan * shapes, np.zeros(1),
                         shapes, 0, 1)  # fmt: skip
    report = result.report(film(), tmp_path)
    dash = number(np.nan)
    assert report.tables[0].rows == (("mode 1", dash, "143.000", "0", dash),)
    told = report.measurements
    assert [(one.name, one.verdict) for one in told] == [
        ("modes: mode 1, frequency", "unknown"), ("modes: mode 1, damping", "unknown")
    ]  # fmt: skip
    assert result.warnings == ["measure 'modes': mode 1 is like none of the body's modes"]


@pytest.mark.parametrize(
    ("analysis", "keys", "text"),
    [
        ({"type": "static", "load_factors": [0.0] * 70}, {}, "without a time between frames"),
        (
            {"type": "modal", "count": 1, "phases": 70},
            {},
            'of type "modal" or "harmonic" duration_s',
        ),
        (FILM, {"band_Hz": [100.0, "x"]}, "band_Hz"),
        (FILM, {"end_mm": None}, r"end_px: where it is; got neither"),
        (FILM, {"subset_px": 8}, r"subset_px: even; got 8; expected an odd number"),
        (FILM, {"identification": "fdd"}, r'excitation: with identification "fdd"; got "?release'),
        (FILM, {"band_Hz": [90.0, 50.0]}, r"band_Hz: no band"),
        (FILM, {"band_Hz": [50.0, 500.0]}, r"band_Hz: faster than frames show; got 500.0; .* 500,"),
        ({**FILM, "duration_s": 0.02}, {}, "got 21 frames; expected 64 or more"),
    ],
)
def test_what_is_not_enough(analysis: Any, keys: dict[str, Any], text: str) -> None:
    with pytest.raises(SceneError, match=text):
        film(analysis, **keys)


def test_films_come_before_measures() -> None:
    """So that a film is there even where no mode is found in it."""
    scene = small_scene(**{**film().document, "video": {}})
    names = [one.name for one in scene_stages(scene, RunOptions("numpy")).stages]
    assert names.index("film/side") < names.index("measure/modes")
