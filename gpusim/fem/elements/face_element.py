"""Faces of solid elements as pure data: what face loads and areas integrate with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.mesh import Faces
from gpusim.mesh.quadrature import face_rule
from gpusim.mesh.shape_functions import FACE_TYPES, shape_functions, shape_gradients

__all__ = ["FACE_ELEMENTS", "FaceElement", "face_groups"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class FaceElement:
    """One face type with Q quadrature points and n nodes.

    ``columns`` (n,) of `Faces.nodes` hold its nodes. ``shape`` (Q,n), ``gradient`` (Q,n,2)
    d(shape)/d(xi), ``weight`` (Q,). With nodes at x (n,3) the area vector of a point is the cross
    product of the columns of x^T gradient, times the weight; it points outward.
    """

    name: str
    columns: npt.NDArray[np.int64]
    shape: Float
    gradient: Float
    weight: Float


_POINTS = {"tri3": 3, "tri6": 6, "quad4": 4, "quad8": 9, "quad9": 9}


def _face_element(name: str) -> FaceElement:
    points, weight = face_rule(name, _POINTS[name])
    shape, gradient = shape_functions(name, points), shape_gradients(name, points)
    columns = np.array(FACE_TYPES[name])
    for table in (columns, shape, gradient):
        table.setflags(write=False)
    return FaceElement(name, columns, shape, gradient, weight)


FACE_ELEMENTS: dict[str, FaceElement] = {name: _face_element(name) for name in FACE_TYPES}


def face_groups(
    faces: Faces,
) -> Iterator[tuple[FaceElement, npt.NDArray[np.int64], npt.NDArray[np.int32]]]:
    """Yield (face type, rows (K,) of ``faces``, nodes (K,n)) for each type that occurs."""
    for name, rows in faces.kinds():
        element = FACE_ELEMENTS[name]
        yield element, rows, faces.nodes[np.ix_(rows, element.columns)]
