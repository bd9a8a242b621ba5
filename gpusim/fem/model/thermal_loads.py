"""Forces of a temperature change, from the stress that it causes in cells held still."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int
from gpusim.fem.elements.element import ELEMENTS, Rule
from gpusim.fem.elements.isoparametric_map import add_to
from gpusim.fem.elements.strain import internal_force, point_stress
from gpusim.fem.materials.law import Material
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.mesh import CELL_TYPES, Mesh
from gpusim.mesh.shape_functions import shape_functions
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import finite_numbers, unmasked

_CHUNK = 8192


@unmasked()
@one_blas_thread()
def thermal(
    mesh: Mesh,
    materials: Sequence[Material],
    temperature: npt.ArrayLike,
    material_of_cell: Int | None = None,
    formulation: str | Mapping[str, str] | None = None,
) -> Float:
    """(N,3) nodal forces of a temperature change: the integral of B^T C (expansion) dV.

    Parameters
    ----------
    temperature : (N,) change at the nodes, or one number for all. Inside a cell the corners'
        values are interpolated linearly, so that the free strain is of the same order as the
        strain of quadratic elements; midside values aren't used.
    materials, material_of_cell : as for ``Model``; ``expansion`` is read.
    formulation : the one to solve with, as for `solve`. Internal modes of incompatible elements
        are condensed like those of the stiffness: a temperature that is linear over the height
        of a bar bends it without stress.

    Give the same temperature to ``stress``, which subtracts the free strain.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> steel = gs.Isotropic(E=210e9, nu=0.3, expansion=1.2e-5)
    >>> gs.fem.thermal(bar, [steel], temperature=10.0).shape
    (12, 3)
    """
    model = Model(mesh, materials, material_of_cell=material_of_cell)
    change = linear_temperature("thermal", mesh, temperature)
    names = resolve_formulation(model, formulation)
    assert model.material_of_cell is not None
    moduli = np.stack([one.stiffness() for one in model.materials])
    expansion = np.stack([one.expansion_strain() for one in model.materials])
    forces = np.zeros((mesh.node_count, 3))
    for kind, first, block in mesh.blocks():
        rule = ELEMENTS[kind].rule(names[kind])
        for start in range(0, len(block), _CHUNK):
            cells = block[start : start + _CHUNK]
            numbers = slice(first + start, first + start + len(cells))
            kinds = model.material_of_cell[numbers]
            nodes = mesh.points[cells]
            warm = point_temperature(kind, rule, change[cells])
            free = warm[..., None] * expansion[kinds][:, None]
            # cells whose nodes are held push against them with minus the wanted forces
            held, _ = point_stress(
                kind, names[kind], nodes, np.zeros_like(nodes), moduli[kinds], free
            )
            add_to(forces, cells, -internal_force(kind, names[kind], nodes, held))
    return forces


def linear_temperature(what: str, mesh: Mesh, temperature: npt.ArrayLike) -> Float:
    """(N,) float64 of a number or (N,) values, midside nodes at the mean of their corners.

    Raises InputError.
    """
    shape = (mesh.node_count,)
    expected = f"a finite number or {shape} of them"
    change = finite_numbers(temperature, f"{what}: temperature", ((), shape), expected)
    change = np.array(np.broadcast_to(change, shape))
    for kind, _, block in mesh.blocks():
        cell = CELL_TYPES[kind]
        for number, corners in enumerate(cell.parents, start=cell.corners):
            change[block[:, number]] = change[block[:, list(corners)]].mean(axis=1)
    return change


def point_temperature(kind: str, rule: Rule, nodal: Float) -> Float:
    """(M,Q) at a rule's points of values (M,k), linear between the corners."""
    cell = CELL_TYPES[kind]
    return np.asarray(nodal[:, : cell.corners] @ shape_functions(cell.linear, rule.points).T)
