"""What a correlation has of each point, by the name that tables and maps give it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.measure import DicResult, MappedResult, StereoResult, StrainResult

Values = Callable[[Any], npt.NDArray[Any]]
Fields = Mapping[str, "MeasuredField"]

TITLES = {
    "u": "u (px, to the right)",
    "v": "v (px, down)",
    "magnitude": "displacement ({unit})",
    "sigma": "standard uncertainty ({unit})",
    "zncc": "correlation coefficient",
    "Z": "Z ({unit}, from the left camera)",
    "U": "U ({unit}, to the right)",
    "V": "V ({unit}, down)",
    "W": "W ({unit}, away)",
    "residual": "distance to the rays (px)",
    "exy": "exy (half the shear angle)",
    "e1": "larger principal strain",
    "e2": "smaller principal strain",
}
"""Of fields that are drawn, where it isn't their name."""


@dataclass(frozen=True)
class MeasuredField:
    """Numbers of a result, (M,), and their ``unit``: px, mm or 1. Lengths in space are in mm in
    files, in the unit of the cameras else."""

    values: Values
    unit: str
    title: str


@dataclass(frozen=True)
class FieldMap:
    """One panel: a value per point, its name and how it is coloured."""

    values: Float
    title: str
    centred: bool = False  # zero is special: colours diverge from it


@dataclass(frozen=True)
class Catalogue:
    """What a kind of result has of each point: ``fields`` by name, those that are ``shown``, the
    most telling first, and the ``unit`` of its lengths where it isn't px, if no file says mm."""

    fields: Fields
    shown: tuple[str, ...]
    unit: str = ""


def field_maps(
    result: Any, names: Sequence[str] | None = None, unit: str = "mm"
) -> dict[str, FieldMap]:
    """Some fields of a result by name, NaN where nothing was measured; ``unit`` of lengths in
    space. Without ``names`` those that are shown, in the result's own unit."""
    kind = catalogue_of(result)
    if names is None:
        names, unit = kind.shown, kind.unit
    maps = {}
    for name in names:
        one = kind.fields[name]
        title = one.title.format(unit=unit if one.unit == "mm" else one.unit)
        values = np.where(result.ok, one.values(result), np.nan)
        maps[name] = FieldMap(values, title, centred=kind.fields is STRAIN)
    return maps


def _fields(*parts: tuple[str, str, str]) -> dict[str, MeasuredField]:
    """From attributes of a result, their units, and the names of their components."""

    def component(attribute: str, k: int) -> Values:
        def values(result: Any) -> npt.NDArray[Any]:
            array = getattr(result, attribute)
            return np.asarray(array.reshape(len(array), prod(array.shape[1:]))[:, k])

        return values

    return {
        name: MeasuredField(component(attribute, k), unit, TITLES.get(name, name))
        for attribute, unit, names in parts
        for k, name in enumerate(names.split())
    }


def _length(unit: str) -> dict[str, MeasuredField]:
    def length(result: Any) -> npt.NDArray[Any]:
        return np.asarray(np.sqrt((result.displacement**2).sum(axis=1)))

    return {"magnitude": MeasuredField(length, unit, TITLES["magnitude"])}


PICTURE = _fields(
    ("points", "px", "x y"), ("displacement", "px", "u v"),
    ("gradient", "1", "du_dx du_dy dv_dx dv_dy"),
    ("zncc", "1", "zncc"), ("sigma", "px", "sigma"), ("iterations", "1", "iterations"),
) | _length("px")  # fmt: skip
SPACE = _fields(
    ("points", "px", "x y"), ("right", "px", "x_right y_right"), ("shape", "mm", "X Y Z"),
    ("displacement", "mm", "U V W"), ("sigma", "mm", "sigma_X sigma_Y sigma_Z"),
    ("residual", "px", "residual"),
) | _length("mm")  # fmt: skip
MAPPED = _fields(("displacement", "mm", "u v"), ("sigma", "mm", "sigma")) | _length("mm")
MAPPED |= {name: MeasuredField(MAPPED[name].values, "mm", f"displacement along {axis} ({{unit}})")
           for name, axis in zip("uv", "xy", strict=True)}  # fmt: skip
_TENSOR = _fields(("tensor", "1", "exx exy eyx eyy"), ("principal", "1", "e1 e2"),
                  ("residual", "1", "strain_residual"))  # fmt: skip
STRAIN = {name: _TENSOR[name] for name in ("exx", "eyy", "exy", "e1", "e2", "strain_residual")}
"""Of a `DicResult`, a `StereoResult`, a `MappedResult`, a `StrainResult`."""
CATALOGUES: dict[type, Catalogue] = {
    DicResult: Catalogue(PICTURE, ("u", "v", "magnitude", "sigma", "zncc")),
    StereoResult: Catalogue(
        SPACE, ("W", "U", "V", "magnitude", "Z", "residual"), "unit of the rig"
    ),
    MappedResult: Catalogue(MAPPED, ("u", "v", "magnitude", "sigma"), "unit of the mapping"),
    StrainResult: Catalogue(STRAIN, ("exx", "eyy", "exy", "e1", "e2")),
}


def catalogue_of(result: Any) -> Catalogue:
    """What a result has of each point."""
    return next(row for kind, row in CATALOGUES.items() if isinstance(result, kind))
