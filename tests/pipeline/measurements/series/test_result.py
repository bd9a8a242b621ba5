"""What a series says of a table that is written by hand."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from gpusim.pipeline.measurements.results import PointTable
from gpusim.pipeline.measurements.series import SeriesResult
from tests.support.small_scene import small_scene


def result(**columns: np.ndarray) -> SeriesResult:
    """Three places of a line in two frames: v is what it bends by."""
    true = {"u_px": np.full((2, 3), 0.1), "v_px": np.array([[0.0, 1.0, 2.0], [0.0, 2.0, 4.0]])}
    table = {
        "status": np.full((2, 3), "OK"),
        "followed": np.ones((2, 3)),
        "along_px": np.tile([0.0, 5.0, 10.0], (2, 1)),
        **{f"measured_{name}": 1.01 * values for name, values in true.items()},
        **{f"true_{name}": values for name, values in true.items()},
        **{f"difference_{name}": 0.01 * values for name, values in true.items()},
    }
    points = PointTable("place", (1, 2), ("p1", "p2", "p3"), {**table, **columns})
    pixels = np.zeros((3, 2))
    return SeriesResult("line", points, ("side",), ("x", "y"), pixels, pixels)


def test_the_largest_component_comes_first(tmp_path: Path) -> None:
    scene = small_scene(analysis={"load_factors": [0.0, 0.5, 1.0]})
    told = result().report(scene, tmp_path)
    first = told.measurements[0]
    assert (first.name, first.unit, first.truth) == ("line: p3, v", "px", 4.0)
    assert [one.name for one in told.series][-1] == "line: v, frame 2"
    assert told.series[-1].x.tolist() == [0.0, 5.0, 10.0]
    noise = {one.name: one.measured for one in told.measurements}
    rms = 0.01 * np.sqrt((0 + 1 + 4 + 0 + 4 + 16) / 6)
    assert np.isclose(noise["line: RMS error of v, all frames"], rms, rtol=1e-9)


def test_places_of_which_much_was_lost_are_named() -> None:
    assert result().warnings == []
    followed = np.ones((2, 3))
    followed[1, 2] = 0.25
    few = "measure 'line': few of the subsets were followed: p3 (25%)"
    assert result(followed=followed).warnings == [few]
    status = np.full((2, 3), "OK", "U12")
    status[0, 1] = "NO_TEXTURE"
    assert result(status=status).warnings == [
        "measure 'line': not measured: p2 (NO_TEXTURE in frame 1)"
    ]


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    kept = replace(result(), name="kept")
    content = kept.contents()["kept.npz"]
    assert isinstance(content, bytes)
    (tmp_path / "kept.npz").write_bytes(content)
    again = SeriesResult.read(tmp_path, "kept")
    assert again.quantities == ["u_px", "v_px"] and again.axes == ("x", "y")
    assert np.array_equal(again.table["measured_v_px"], kept.table["measured_v_px"])
