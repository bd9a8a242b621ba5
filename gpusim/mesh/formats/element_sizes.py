"""Element sizes for Gmsh: a greatest size, curvature, named places and boxes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

import numpy as np

from gpusim.errors import InputError

__all__ = ["SizeBox", "check_sizes", "set_sizes"]

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


def check_sizes(
    size: float,
    curvature: int,
    sizes: Mapping[str, float],
    boxes: Sequence[SizeBox],
    scale: float,
) -> None:
    """Refuse numbers that aren't positive."""
    numbers = {"size": size, "scale": scale, **{f"sizes[{n!r}]": s for n, s in sizes.items()}}
    for number, box in enumerate(boxes):
        numbers[f"boxes[{number}].size"] = box.size
        corners = np.array([box.lower, box.upper], dtype=np.float64)
        if corners.shape != (2, 3) or not (corners[0] < corners[1]).all():
            raise InputError(
                f"mesh_cad: boxes[{number}]; got {box.lower} to {box.upper}; expected two corners, "
                "the lower one first"
            )
        if not (np.isfinite(box.transition) and box.transition >= 0.0):
            raise InputError(
                f"mesh_cad: boxes[{number}].transition; got {box.transition}; expected a length"
            )
    for name, value in numbers.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"mesh_cad: {name}; got {value}; expected a number > 0")
    if not (isinstance(curvature, int) and 0 <= curvature <= 1000):
        raise InputError(f"mesh_cad: curvature; got {curvature}; expected a whole number 0 … 1000")


def set_sizes(
    gmsh: Any,
    size: float,
    curvature: int,
    sizes: Mapping[str, float],
    boxes: Sequence[SizeBox],
    scale: float,
    named: Named,
) -> None:
    """Tell Gmsh; ``named`` maps a name to the (dimension, tag) it stands for.

    Raises InputError for a name that isn't there.
    """
    gmsh.option.setNumber("Mesh.MeshSizeMax", size / scale)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", curvature)
    field = gmsh.model.mesh.field
    used = []
    for name, value in sizes.items():
        if name not in named:
            near = get_close_matches(name, named, 1)
            known = f"did you mean {near[0]!r}?" if near else ", ".join(sorted(named)[:20])
            raise InputError(f"mesh_cad: sizes; got {name!r}; expected a name of the file: {known}")
        for dimension, tag in named[name]:
            if dimension == 3:
                constant = field.add("Constant")
                field.setNumbers(constant, "VolumesList", [tag])
                field.setNumber(constant, "VIn", value / scale)
                field.setNumber(constant, "VOut", size / scale)
                used.append(constant)
                continue
            distance = field.add("Distance")
            field.setNumbers(distance, "SurfacesList", [tag])
            field.setNumber(distance, "Sampling", 40)
            threshold = field.add("Threshold")
            field.setNumber(threshold, "InField", distance)
            field.setNumber(threshold, "SizeMin", value / scale)
            field.setNumber(threshold, "SizeMax", size / scale)
            field.setNumber(threshold, "DistMin", 0.5 * value / scale)
            field.setNumber(threshold, "DistMax", 4.0 * size / scale)
            used.append(threshold)
    for box in boxes:
        inside = field.add("Box")
        for axis, low, high in zip("XYZ", box.lower, box.upper, strict=True):
            field.setNumber(inside, f"{axis}Min", low / scale)
            field.setNumber(inside, f"{axis}Max", high / scale)
        field.setNumber(inside, "VIn", box.size / scale)
        field.setNumber(inside, "VOut", size / scale)
        field.setNumber(inside, "Thickness", box.transition / scale)
        used.append(inside)
    if used:
        least = field.add("Min")
        field.setNumbers(least, "FieldsList", used)
        field.setAsBackgroundMesh(least)
