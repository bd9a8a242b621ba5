"""Points without neighbours are lost, not wrong, where a large turn hides the right place."""

from __future__ import annotations

import copy
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import gpusim as gs
from gpusim import measure
from gpusim.pipeline.measurements.dic.lone_points import without_chance_matches
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


def test_the_end_of_a_thin_beam_is_not_lost() -> None:
    """A beam as high as the subset turns by 5 degrees: of the subsets beside its end one alone,
    towards its middle, is on it."""
    rng = np.random.default_rng(1)
    noise = scipy.ndimage.gaussian_filter(rng.normal(size=(160, 300)), 1.8)
    pattern = np.clip(0.5 + 0.25 * noise / noise.std(), 0.05, 0.95)
    fine = (np.indices((4 * 120, 4 * 240)) + 0.5) / 4 - 0.5

    def picture(degrees: float) -> np.ndarray:
        angle = np.radians(degrees)
        y, x = fine[0] - 60.0, fine[1] - 20.0
        x, y = np.cos(angle) * x + np.sin(angle) * y, np.cos(angle) * y - np.sin(angle) * x
        seen = scipy.ndimage.map_coordinates(pattern, [y + 80.0, x + 40.0], mode="nearest")
        seen = np.where((np.abs(y) < 16.0) & (x < 180.0), seen, 0.2)
        levels = 4000.0 * seen.reshape(120, 4, 240, 4).mean(axis=(1, 3))
        return np.rint(levels + rng.normal(scale=20.0, size=levels.shape)).astype(np.uint16)

    before, after = picture(0.0), picture(5.0)
    options: dict[str, Any] = {"subset": 31, "backend": "numpy"}
    tip = np.array([[181.0, 60.0]])
    found = measure.dic(before, after, points=tip, **options)
    kept = without_chance_matches(found, partial(measure.dic, before, after, **options))
    turn = np.radians(5.0)
    exact = [161.0 * (np.cos(turn) - 1.0), 161.0 * np.sin(turn)]
    assert kept.ok.all() and np.abs(kept.displacement - exact).max() < 0.05
