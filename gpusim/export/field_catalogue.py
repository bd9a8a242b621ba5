"""The catalogue of fields: all that windows, notebooks, reports and files show of bodies, of the
truth in pictures, and of what was measured, by the name that users write.

A field is a row of a table: `BODY` (of a `gpusim.export.body_state.BodyState`), `TRUTH` (of a
frame's truth layers), `PICTURE`, `SPACE`, `MAPPED` and `STRAIN` (of what a correlation gives);
`point_fields` makes those of a measurement's table. `VTU_ARRAYS` are whole vectors and tensors, in
SI.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import prod
from operator import itemgetter
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.export.layers import LAYERS, Layer
from gpusim.measure import DicResult, MappedResult, StereoResult, StrainResult
from gpusim.scene.tables.table import name_and_unit

Values = Callable[[Any], npt.NDArray[Any]]
Place = Literal["nodes", "elements", "pixels", "points"]


@dataclass(frozen=True, eq=False)
class Field:
    """One field.

    ``title`` and ``unit`` ("1": a pure number) for people, with a ``remark``. ``of``: its numbers
    from what has them, one for each of its ``place`` (nodes or elements of a mesh, pixels, points
    that were measured); ``factor``: how many of ``unit`` are in one of these. ``signed``: zero is
    special, and in the middle of the colours where both signs occur.

    Lengths of a correlation in space are in ``mm`` in files, in the unit of its cameras else.
    """

    title: str
    unit: str
    of: Values
    place: Place
    factor: float = 1.0
    signed: bool = False
    remark: str = ""

    def values(self, source: Any) -> npt.NDArray[Any]:
        """In ``unit``. Raises InputError where the body hasn't this field."""
        values = self.of(source)
        return values if self.factor == 1.0 else self.factor * values

    def label(self, length: str = "mm") -> str:
        """What stands over a legend; ``length``: what lengths in space are in."""
        unit = {"1": "", "mm": length}.get(self.unit, self.unit)
        about = ", ".join(part for part in (unit, self.remark) if part)
        return f"{self.title} ({about})" if about else self.title


Fields = Mapping[str, Field]


def _component(of: Values, k: int, source: Any) -> npt.NDArray[Any]:
    return np.asarray(of(source)[..., k])


def _components(
    names: Iterator[tuple[str, str]], unit: str, of: Values, place: Place, **more: Any
) -> dict[str, Field]:
    """A field for each component of a vector or tensor, by (name, title)."""
    return {
        name: Field(title, unit, partial(_component, of, k), place, **more)
        for k, (name, title) in enumerate(names)
    }


# -- bodies -------------------------------------------------------------------------------------


def _fem() -> Any:
    """The solver: half a second to import, which a window without fields doesn't need."""
    from gpusim import fem

    return fem


def _of_nodes(
    name: str, title: str, components: str, unit: str, factor: float, of: Values
) -> dict[str, Field]:
    names = ((f"{name}_{one}", f"{title} {one}") for one in components.split())
    return _components(names, unit, of, "nodes", factor=factor, signed=True)


_AXES = "xx yy zz xy yz zx"
BODY = {
    "displacement": Field("displacement", "mm", lambda state: state.length, "nodes", 1e3),
    **_of_nodes("displacement", "displacement along", "x y z", "mm", 1e3, lambda state: state.u),
    "von_mises": Field("von Mises stress", "MPa", lambda state: _fem().von_mises(state.stress),
                       "nodes", 1e-6),
    **_of_nodes("principal_stress", "principal stress", "1 2 3", "MPa", 1e-6,
                lambda state: _fem().principal(state.stress)),
    **_of_nodes("stress", "stress", _AXES, "MPa", 1e-6, lambda state: state.stress),
    **_of_nodes("principal_strain", "principal strain", "1 2 3", "10⁻³", 1e3,
                lambda state: _fem().principal(state.strain)),
    **_of_nodes("strain", "strain", _AXES, "10⁻³", 1e3, lambda state: state.strain),
    "plastic_strain": Field("plastic strain", "10⁻³", lambda state: state.plastic_strain,
                            "nodes", 1e3),
    "element_von_mises": Field("von Mises stress of elements", "MPa",
                               lambda state: state.recovered.cell_von_mises, "elements", 1e-6),
    "error_share": Field("share of the stress error", "%", lambda state: state.error_share,
                         "elements", 1e2),
}  # fmt: skip
"""Of a body in a frame; the first are the most telling."""


def _known(name: str) -> Values:
    return lambda state: state.known.get(name)


def _known_mises(state: Any) -> Any:
    return None if "stress" not in state.known else _fem().von_mises(state.known["stress"])


VTU_ARRAYS = {
    "u": Field("displacement", "m", lambda state: state.u, "nodes"),
    "stress": Field(f"stress {_AXES}", "Pa", _known("stress"), "nodes"),
    "von_mises": Field("von Mises stress", "Pa", _known_mises, "nodes"),
    "error_share": Field("share of the stress error", "1", _known("error"), "elements"),
    "strain": Field(f"logarithmic strain {_AXES}", "1", _known("strain"), "nodes"),
    "plastic_strain": Field("plastic strain", "1", _known("plastic"), "nodes"),
    "piola_stress": Field(f"second Piola-Kirchhoff stress {_AXES}", "Pa", _known("piola"), "nodes"),
    "green_lagrange_strain": Field(f"Green-Lagrange strain {_AXES}", "1", _known("green"), "nodes"),
}
"""Of a body in a frame, as VTU files have them; None of what isn't known: stress where asked for,
strain of bodies at large displacements."""


# -- truth in pictures --------------------------------------------------------------------------


def _length(of: Values, source: Any) -> Float:
    return np.asarray(np.sqrt((np.asarray(of(source)) ** 2).sum(axis=-1)))


def _of_layer(layer: Layer) -> Iterator[tuple[str, Field]]:
    """A layer's fields: itself, or its components and, of what moves, its length."""

    def of(layers: Mapping[str, Any]) -> npt.NDArray[Any]:
        return np.asarray(layers[layer.name])

    name, more = layer.name, {"signed": layer.name in _MOVING}
    unit, factor = ("mm", 1e3) if layer.unit == "m" else (layer.unit, 1.0)
    unit = "1" if unit in ("index", "bits") else unit
    if layer.components == 1:
        yield f"truth_{name}", Field(name, unit, of, "pixels", factor)
        return
    if name in _MOVING:
        yield f"truth_{name}", Field(name, unit, partial(_length, of), "pixels", factor)
    axes = "xyz"[: layer.components]
    names = ((f"truth_{name}_{axis}", f"{name} along {axis}") for axis in axes)
    yield from _components(names, unit, of, "pixels", factor=factor, **more).items()


_MOVING = ("displacement", "flow")
TRUTH = {name: one for layer in LAYERS.values() for name, one in _of_layer(layer)}
"""Of a frame's layers by name: a group of truth.h5, or arrays (H, W) and (H, W, C)."""


# -- measurements -------------------------------------------------------------------------------

_MEASURED = {
    "u": ("u", "to the right"),
    "v": ("v", "down"),
    "sigma": ("standard uncertainty", ""),
    "zncc": ("correlation coefficient", ""),
    "Z": ("Z", "from the left camera"),
    "U": ("U", "to the right"),
    "V": ("V", "down"),
    "W": ("W", "away"),
    "residual": ("distance to the rays", ""),
    "exy": ("exy", "half the shear angle"),
    "e1": ("larger principal strain", ""),
    "e2": ("smaller principal strain", ""),
}
"""Title and remark of fields that are drawn, where it isn't their name."""


def _measured(*parts: tuple[str, str, str], signed: bool = False) -> dict[str, Field]:
    """From attributes of a result, their units, and the names of their components."""

    def attribute(name: str, result: Any) -> npt.NDArray[Any]:
        array = getattr(result, name)
        return np.asarray(array.reshape(len(array), prod(array.shape[1:])))

    fields = {}
    for of, unit, names in parts:
        for k, name in enumerate(names.split()):
            title, remark = _MEASURED.get(name, (name, ""))
            values = partial(_component, partial(attribute, of), k)
            fields[name] = Field(title, unit, values, "points", signed=signed, remark=remark)
    return fields


def _magnitude(unit: str) -> dict[str, Field]:
    of = partial(_length, lambda result: result.displacement)
    return {"magnitude": Field("displacement", unit, of, "points")}


PICTURE = _measured(
    ("points", "px", "x y"), ("displacement", "px", "u v"),
    ("gradient", "1", "du_dx du_dy dv_dx dv_dy"),
    ("zncc", "1", "zncc"), ("sigma", "px", "sigma"), ("iterations", "1", "iterations"),
) | _magnitude("px")  # fmt: skip
SPACE = _measured(
    ("points", "px", "x y"), ("right", "px", "x_right y_right"), ("shape", "mm", "X Y Z"),
    ("displacement", "mm", "U V W"), ("sigma", "mm", "sigma_X sigma_Y sigma_Z"),
    ("residual", "px", "residual"),
) | _magnitude("mm")  # fmt: skip
MAPPED = _measured(("sigma", "mm", "sigma")) | _magnitude("mm")
MAPPED |= {name: Field(f"displacement along {axis}", "mm", PICTURE[name].of, "points")
           for name, axis in zip("uv", "xy", strict=True)}  # fmt: skip
_TENSOR = _measured(("tensor", "1", "exx exy eyx eyy"), ("principal", "1", "e1 e2"),
                    ("residual", "1", "strain_residual"), signed=True)  # fmt: skip
STRAIN = {name: _TENSOR[name] for name in ("exx", "eyy", "exy", "e1", "e2", "strain_residual")}
"""Of a `DicResult`, a `StereoResult`, a `MappedResult`, a `StrainResult`."""


_OF_POINTS = ("measured", "true", "levelled", "difference")


def point_fields(columns: Iterable[str]) -> Fields:
    """Of a measurement at points: of its columns by their names, which end with their units, and
    ``difference_<quantity>`` of what was measured and is known.

    Examples
    --------
    >>> from gpusim.export.field_catalogue import point_fields
    >>> fields = point_fields(["measured_U_mm", "true_U_mm", "sigma_U_mm"])
    >>> [one.label() for one in fields.values()]
    ['U measured (mm)', 'U true (mm)', 'U difference (mm)', 'sigma U (mm)']
    """
    names = list(columns)
    quantities = [name.partition("_")[2] for name in names if name.startswith("measured_")]
    names += [f"difference_{one}" for one in quantities if f"true_{one}" in names]

    def place(name: str) -> int:
        kind, _, quantity = name.partition("_")
        compared = kind in _OF_POINTS and quantity in quantities
        return quantities.index(quantity) if compared else len(quantities)

    return {name: _point_field(name) for name in sorted(names, key=place)}


def _point_field(name: str) -> Field:
    kind, _, quantity = name.partition("_")
    if kind not in _OF_POINTS:
        word, unit = name_and_unit(name)
        return Field(word.replace("_", " "), unit or "1", itemgetter(name), "points")
    word, unit = name_and_unit(quantity)
    of: Values = itemgetter(name)
    if kind == "difference":
        of = partial(_difference, f"measured_{quantity}", f"true_{quantity}")
    signed, factor = kind == "difference" or word not in ("X", "Y", "Z"), 1.0 if unit else 1e3
    return Field(f"{word} {kind}", unit or "10⁻³", of, "points", factor, signed)


def _difference(measured: str, true: str, columns: Mapping[str, Float]) -> Float:
    return np.asarray(columns[measured] - columns[true])


@dataclass(frozen=True)
class Catalogue:
    """What a kind of result has of each point: ``fields`` by name, those that are ``shown``, the
    most telling first, and the ``unit`` of its lengths where it isn't px, if no file says mm."""

    fields: Fields
    shown: tuple[str, ...]
    unit: str = ""


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


@dataclass(frozen=True)
class FieldMap:
    """One panel: a value per point, its name and how it is coloured."""

    values: Float
    title: str
    centred: bool = False  # zero is special: colours diverge from it
    scale: tuple[float, float] | None = None  # what the colours span, if not most of the values


def field_maps(result: Any, names: Sequence[str] | None = None) -> dict[str, FieldMap]:
    """Some fields of a result by name, NaN where nothing was measured, lengths in space in mm.
    Without ``names`` those that are shown, in the result's own unit."""
    kind = catalogue_of(result)
    names, unit = (kind.shown, kind.unit) if names is None else (names, "mm")
    maps = {}
    for name in names:
        one = kind.fields[name]
        values = np.where(result.ok, one.values(result), np.nan)
        maps[name] = FieldMap(values, one.label(unit), centred=one.signed)
    return maps
