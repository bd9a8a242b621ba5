"""Sobol indices of a function that is known in closed form, through scenes, pictures and report."""

from __future__ import annotations

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gpusim.scene.toml_text import toml_text
from gpusim.studies.effects import sobol
from gpusim.studies.study import study
from gpusim.studies.table import SampleTable
from tests.support.shifted_plate import DOCUMENT

# of Ishigami's function with 7 and 0.1 (Ishigami & Homma, ISUMA '90): alone, and with all others
FIRST, TOTAL = (0.31391, 0.44241, 0.0), (0.55759, 0.44241, 0.24368)
STUDY = """scene = "plate.toml"
backend = "numpy"
samples = {samples}
sensitivity = true
[[parameter]]
key = "material.0.density_kg_m3"
uniform = [1.0, 7.283185307179586]
name = "a"
[[parameter]]
key = "material.1.density_kg_m3"
uniform = [1.0, 7.283185307179586]
name = "b"
[[parameter]]
key = "material.2.density_kg_m3"
uniform = [1.0, 7.283185307179586]
name = "c"
[[derived]]
key = "measure.spot.mm_per_px"
value = "1 + 0.01 * (sin(a-1-pi) + 7 * sin(b-1-pi)**2 + 0.1 * (c-1-pi)**4 * sin(a-1-pi))"
"""


@pytest.fixture(params=[8, pytest.param(1024, marks=pytest.mark.slow)])
def studied(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[SampleTable, dict[str, Any]]:
    """A spot measured with a scale that is wrong by Ishigami's function of three numbers that
    change nothing; what the report says of its error's size."""
    document = copy.deepcopy(DOCUMENT)
    document["prop"][0]["poses"] = [{"position_mm": [x, 0.0, 0.0]} for x in (0.0, 0.3)]
    camera = document["camera"][0] | {"resolution_px": [48, 36], "focal_mm": 20.0}
    spot = {"name": "spot", "type": "point", "camera": "left", "subset_px": 15, "mm_per_px": 1.0,
            "points_mm": [[-20.0, 0.0, 0.0]]}  # fmt: skip
    steel = {"youngs_modulus_GPa": 200.0, "poissons_ratio": 0.3, "density_kg_m3": 1.0}
    materials = [{"name": name, **steel} for name in "abc"]
    scene = {**document, "camera": [camera], "measure": [spot], "material": materials}
    (tmp_path / "plate.toml").write_text(toml_text(scene))
    (tmp_path / "study.toml").write_text(STUDY.format(samples=request.param))
    table = study(tmp_path / "study.toml", tmp_path / "out")
    told = json.loads((tmp_path / "out" / "report.json").read_text())["findings"]
    return table, next(one for one in told if one["quantity"].startswith("spot: RMS error of u"))


def test_indices_of_ishigamis_function(studied: tuple[SampleTable, dict[str, Any]]) -> None:
    """What is measured is that function, and indices are those of its values; of a thousand points
    they are known to 0.02."""
    table, told = studied
    assert set(table["status"]) == {"done"}
    a, b, c = (np.asarray(table[name], np.float64) - 1.0 - np.pi for name in "abc")
    known = np.sin(a) + 7.0 * np.sin(b) ** 2 + 0.1 * c**4 * np.sin(a)
    error = np.asarray(table["spot: p1, u error [mm]"], np.float64)
    slope, _ = np.polyfit(known, error, 1)
    np.testing.assert_allclose(error, slope * known + error[0] - slope * known[0], atol=1e-9)
    found = sobol(error.reshape(5, -1), "abc")
    of_known = sobol(known.reshape(5, -1), "abc")
    np.testing.assert_allclose(found.first, of_known.first, atol=1e-6)
    np.testing.assert_allclose(found.total, of_known.total, atol=1e-6)
    of_size = sobol(np.abs(error).reshape(5, -1), "abc")
    np.testing.assert_allclose(told["sobol"]["first"], of_size.first, atol=1e-6)
    np.testing.assert_allclose(told["sobol"]["total"], of_size.total, atol=1e-6)
    if found.points > 1000:
        np.testing.assert_allclose(found.first, FIRST, atol=0.02)
        np.testing.assert_allclose(found.total, TOTAL, atol=0.02)
