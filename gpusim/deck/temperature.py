"""Stress, and forces of a temperature, with the temperature in elements as CalculiX has it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from gpusim.fem import Material
from gpusim.fem.elements.element import ELEMENTS
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.fem.elements.strain import internal_force, point_stress
from gpusim.mesh import Mesh
from gpusim.mesh.quadrature import cell_rule
from gpusim.mesh.shape_functions import shape_functions

__all__ = ["point_stresses", "point_weights", "temperature_forces"]

Float = npt.NDArray[np.float64]

_CHUNK = 8192


def temperature_forces(
    mesh: Mesh,
    materials: Sequence[Material],
    material_of_cell: npt.NDArray[np.int32],
    formulation: Mapping[str, str],
    change: Float,
) -> Float:
    """(N,3) nodal forces of the change of temperature ``change`` (N,) at the nodes."""
    forces = np.zeros((mesh.node_count, 3))
    still = np.zeros_like(forces)
    for kind, cells, held in _stresses(
        mesh, materials, material_of_cell, formulation, still, change
    ):
        # cells whose nodes are held push against them with minus the wanted forces
        own = internal_force(kind, formulation[kind], mesh.points[cells], held)
        add_to(forces, cells, -own)
    return forces


def point_stresses(
    mesh: Mesh,
    materials: Sequence[Material],
    material_of_cell: npt.NDArray[np.int32],
    formulation: Mapping[str, str],
    u: Float,
    change: Float | None,
) -> dict[str, Float]:
    """Cell type -> (M,Q,6) stress of ``u`` (N,3) at the points of its rule, xx yy zz xy yz zx."""
    found: dict[str, list[Float]] = {}
    for kind, _, stress in _stresses(mesh, materials, material_of_cell, formulation, u, change):
        found.setdefault(kind, []).append(stress)
    return {kind: np.concatenate(parts) for kind, parts in found.items()}


def _stresses(
    mesh: Mesh,
    materials: Sequence[Material],
    material_of_cell: npt.NDArray[np.int32],
    formulation: Mapping[str, str],
    u: Float,
    change: Float | None,
) -> Iterator[tuple[str, npt.NDArray[np.int32], Float]]:
    """Cell type, some cells (C,k) of it, and their stress (C,Q,6), chunk by chunk."""
    moduli = np.stack([one.stiffness() for one in materials])
    expansion = np.stack([one.expansion_strain() for one in materials])
    for kind, first, block in mesh.blocks():
        name = formulation[kind]
        weights = point_weights(kind, name)
        for start in range(0, len(block), _CHUNK):
            cells = block[start : start + _CHUNK]
            own = material_of_cell[first + start : first + start + len(cells)]
            free = None
            if change is not None:
                free = (change[cells] @ weights.T)[..., None] * expansion[own][:, None]
            stress, _ = point_stress(kind, name, mesh.points[cells], u[cells], moduli[own], free)
            yield kind, cells, stress


@cache
def point_weights(kind: str, formulation: str) -> Float:
    """(Q,k) temperature at the points of the stiffness rule from that at the nodes.

    Found by running CalculiX 2.20 on random temperatures: C3D8 and C3D8I take the mean of their
    nodes; C3D20 is trilinear through the values at 2x2x2 points, so that the free strain is of
    the order of the element's own; all others interpolate with their shape functions.
    """
    points = ELEMENTS[kind].rule(formulation).points
    if kind == "hex8":
        return np.full((len(points), 8), 1.0 / 8.0)
    if (kind, formulation) == ("hex20", "full"):
        inner, _ = cell_rule("hex20", 8)
        corners = np.linalg.solve(shape_functions("hex8", inner), shape_functions("hex20", inner))
        return np.asarray(shape_functions("hex8", points) @ corners)
    return shape_functions(kind, points)
