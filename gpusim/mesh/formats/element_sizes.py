"""Element sizes for Gmsh: a greatest size, curvature, named places and boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.errors import InputError, similar_name
from gpusim.validation import by_number, require

Named = Mapping[str, Sequence[tuple[int, int]]]


@dataclass(frozen=True)
class SizeBox:
    """A region with its own element size: corners ``lower`` and ``upper`` (x, y, z), ``size``, and
    the ``transition`` length outside over which the size grows to the global one. All in the unit
    of the mesh.

    Examples
    --------
    >>> gs.mesh.SizeBox(lower=(0, 0, 0), upper=(0.1, 0.1, 0.1), size=0.01).transition
    0.0
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    size: float
    transition: float = 0.0


@dataclass(frozen=True, eq=False)
class CadOptions:
    """The arguments of `mesh_cad`."""

    size: float
    order: int
    hexahedra: bool
    hex_dominant: bool
    curvature: int
    sizes: Mapping[str, float]
    boxes: Sequence[SizeBox]
    scale: float


def check_sizes(ask: CadOptions) -> None:
    """Refuse numbers that aren't positive."""
    numbers = {"size": ask.size, "scale": ask.scale}
    numbers |= {f"sizes[{name!r}]": size for name, size in ask.sizes.items()}
    for number, box in enumerate(ask.boxes):
        numbers[f"boxes[{number}].size"] = box.size
        corners = np.array([box.lower, box.upper], dtype=np.float64)
        fits = corners.shape == (2, 3) and (corners[0] < corners[1]).all()
        what, got = f"mesh_cad: boxes[{number}]", f"{box.lower} to {box.upper}"
        require(fits, what, got, "two corners, the lower one first")
        require(0.0 <= box.transition < np.inf, f"{what}.transition", box.transition, "a length")
    for name, value in numbers.items():
        require(np.isfinite(value) and value > 0.0, f"mesh_cad: {name}", value, "a number > 0")
    fits = isinstance(ask.curvature, int) and 0 <= ask.curvature <= 1000
    require(fits, "mesh_cad: curvature", ask.curvature, "a whole number 0 … 1000")


def set_sizes(gmsh: Any, ask: CadOptions, named: Named) -> None:
    """Tell Gmsh; ``named`` maps a name to the (dimension, tag) it stands for.

    Raises InputError for a name that isn't there.
    """
    size, scale, field = ask.size, ask.scale, gmsh.model.mesh.field
    gmsh.option.setNumber("Mesh.MeshSizeMax", size / scale)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", ask.curvature)
    used = []
    for name, value in ask.sizes.items():
        if name not in named:
            near = similar_name(name, named)
            known = f"did you mean {near!r}?" if near else ", ".join(by_number(named)[:20])
            raise InputError(f"mesh_cad: sizes; got {name!r}; expected a name of the file: {known}")
        for dimension, tag in named[name]:
            if dimension == 3:
                numbers = {"VIn": value / scale, "VOut": size / scale}
                used.append(_field(field, "Constant", numbers, VolumesList=[tag]))
                continue
            distance = _field(field, "Distance", {"Sampling": 40}, SurfacesList=[tag])
            numbers = {
                "InField": distance, "SizeMin": value / scale, "SizeMax": size / scale,
                "DistMin": 0.5 * value / scale, "DistMax": 4.0 * size / scale,
            }  # fmt: skip
            used.append(_field(field, "Threshold", numbers))
    for box in ask.boxes:
        numbers = {f"{axis}Min": low / scale for axis, low in zip("XYZ", box.lower, strict=True)}
        numbers |= {f"{axis}Max": high / scale for axis, high in zip("XYZ", box.upper, strict=True)}
        numbers |= {"VIn": box.size / scale, "VOut": size / scale}
        used.append(_field(field, "Box", numbers | {"Thickness": box.transition / scale}))
    if used:
        field.setAsBackgroundMesh(_field(field, "Min", {}, FieldsList=used))


def _field(field: Any, kind: str, numbers: Mapping[str, float], **lists: list[int]) -> int:
    """The tag of a new field of Gmsh's."""
    tag = int(field.add(kind))
    for name, items in lists.items():
        field.setNumbers(tag, name, items)
    for name, number in numbers.items():
        field.setNumber(tag, name, number)
    return tag
