"""Points without neighbours are lost, not wrong, where a large turn hides the right place."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np

import gpusim as gs
from gpusim.pipeline.measurements.series.result import SeriesResult
from tests.support.shifted_plate import DOCUMENT

WRONG = ([77.0, 127.0], [142.0, 83.0], [76.0, 113.0])
"""By correlation alone these are found 40 to 79 px off, with coefficients up to 0.99."""
RIGHT = ([111.0, 125.0], [141.0, 73.0], [74.0, 73.0])


def test_a_chance_match_of_a_lone_point_is_lost(tmp_path: Path) -> None:
    document = copy.deepcopy(DOCUMENT)
    document["prop"][0]["poses"] = [
        {"position_mm": [0.0] * 3, "rotation_deg": [0.0, 0.0, angle]} for angle in (0.0, 70.0)
    ]
    document["camera"][0] |= {"position_mm": [0.0, 0.0, 200.0], "target_mm": [0.0] * 3}
    document["sensor"] = {"bits": 8, "exposure": "auto"}
    document["measure"] = [
        {"name": f"p{k}", "type": "point", "camera": "left", "subset_px": 11,
         "points_px": [place]}
        for k, place in enumerate((*WRONG, *RIGHT))
    ]  # fmt: skip
    gs.run(gs.Scene.from_document(document), tmp_path)
    tables = [SeriesResult.read(tmp_path / "measure", f"p{k}").table for k in range(6)]
    assert [one["status"][0, 0] for one in tables] == ["LOW_CORRELATION"] * 3 + ["OK"] * 3
    assert all(np.isnan(one["measured_u_px"]).all() for one in tables[:3])
    for one in tables[3:]:
        assert np.abs(one.vectors("difference")).max() < 0.02
