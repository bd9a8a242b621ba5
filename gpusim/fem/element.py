"""Solid elements as pure data: shape functions, gradients, quadrature, internal modes.

Reference hex: [-1,1]^3, nodes in VTK/Abaqus order. Reference tet: unit simplex.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["ELEMENTS", "Element", "quad_shape"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Element:
    """One element type, with Q quadrature points and k nodes.

    ``shape`` (Q,k), ``gradient`` (Q,k,3) d(shape)/d(xi), ``weight`` (Q,),
    ``centre_gradient`` (k,3), ``mode_gradient`` (Q,m,3) gradients of the m internal modes
    (m = 0 where the element has none), ``formulations`` the names it takes, default first.
    """

    name: str
    shape: Float
    gradient: Float
    weight: Float
    centre_gradient: Float
    mode_gradient: Float
    formulations: tuple[str, ...]


_HEX_SIGNS = np.array(
    [
        [-1, -1, -1], [1, -1, -1], [1, 1, -1], [-1, 1, -1],
        [-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1],
    ],
    dtype=np.float64,
)  # fmt: skip


def _hex_shape(xi: Float) -> Float:
    """Trilinear shape functions at (Q,3) points: (Q,8)."""
    return np.asarray(0.125 * (1.0 + xi[:, None, :] * _HEX_SIGNS).prod(axis=2))


def _hex_gradient(xi: Float) -> Float:
    """Their gradients: (Q,8,3)."""
    terms = 1.0 + xi[:, None, :] * _HEX_SIGNS
    gradient = np.empty((len(xi), 8, 3))
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        gradient[:, :, axis] = 0.125 * _HEX_SIGNS[:, axis] * terms[:, :, others].prod(axis=2)
    return gradient


def quad_shape(xi: Float) -> tuple[Float, Float]:
    """Bilinear shape functions (Q,4) and gradients (Q,4,2) on [-1,1]^2, for face loads."""
    signs = _HEX_SIGNS[:4, :2]
    terms = 1.0 + xi[:, None, :] * signs
    gradient = np.stack(
        [0.25 * signs[:, 0] * terms[:, :, 1], 0.25 * signs[:, 1] * terms[:, :, 0]], axis=2
    )
    return 0.25 * terms.prod(axis=2), gradient


def _hex8() -> Element:
    points = _HEX_SIGNS / np.sqrt(3.0)
    # modes 1 - xi^2, 1 - eta^2, 1 - zeta^2: gradient -2 xi along its own axis only
    modes = np.zeros((8, 3, 3))
    for axis in range(3):
        modes[:, axis, axis] = -2.0 * points[:, axis]
    return Element(
        name="hex8",
        shape=_hex_shape(points),
        gradient=_hex_gradient(points),
        weight=np.ones(8),
        centre_gradient=_hex_gradient(np.zeros((1, 3)))[0],
        mode_gradient=modes,
        formulations=("incompatible", "full", "bbar"),
    )


def _tet4() -> Element:
    gradient = np.array([[-1.0, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    return Element(
        name="tet4",
        shape=np.full((1, 4), 0.25),
        gradient=gradient[None],
        weight=np.array([1.0 / 6.0]),
        centre_gradient=gradient,
        mode_gradient=np.zeros((1, 0, 3)),
        formulations=("full",),
    )


ELEMENTS: dict[str, Element] = {"hex8": _hex8(), "tet4": _tet4()}
