"""docs/conventions.md says of every column and layer what the program writes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gpusim.export.correlation import csv_names, result_columns
from gpusim.export.layers import LAYERS
from gpusim.measure import DicResult, StereoResult, StrainResult
from gpusim.optics.calibration.formats import UNITS


@pytest.fixture(scope="module")
def rows(checkout: Path) -> dict[str, list[str]]:
    """The page's tables: first cell to the others."""
    text = (checkout / "docs" / "conventions.md").read_text()
    found = {}
    for line in text.splitlines():
        if line.startswith("| ") and not line.startswith("|---"):
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            found[cells[0].strip()] = cells[1:]
    return found


def empty(kind: type, **given: object) -> object:
    """A result without points: only its columns are asked for."""
    made = object.__new__(kind)
    for name in kind.__dataclass_fields__:
        object.__setattr__(made, name, given.get(name, ()))
    return made


def test_columns_of_correlation(rows: dict[str, list[str]]) -> None:
    none = {"points": (0, 2), "right": (0, 2), "shape": (0, 3), "residual": (0,), "status": (0,),
            "zncc": (0,), "iterations": (0,), "tensor": (0, 2, 2), "principal": (0, 2)}  # fmt: skip
    arrays = {name: np.zeros(shape) for name, shape in none.items()}
    strain = empty(StrainResult, **arrays)
    flat = empty(DicResult, **arrays, displacement=np.zeros((0, 2)), sigma=np.zeros(0),
                 gradient=np.zeros((0, 2, 2)))  # fmt: skip
    space = empty(StereoResult, **arrays, displacement=np.zeros((0, 3)), sigma=np.zeros((0, 3)))
    for name, columns in (
        ("`gpusim dic`", result_columns(flat, strain)),
        ("`gpusim dic --stereo`", result_columns(space, strain)),
    ):
        assert ", ".join(csv_names(columns)) == rows[name][0]


def test_layers_and_units(rows: dict[str, list[str]]) -> None:
    for layer in LAYERS.values():
        unit, frame, text = rows[layer.name]
        assert unit == layer.unit and layer.frame.startswith(frame) and text
    for format in ("opencv", "kalibr", "matchid", "vic", "dice"):
        assert rows[format][0].split()[0] in UNITS
