"""What finite-element tests judge by: a sparse direct solution, and small meshes of each type."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csc_matrix
from scipy.sparse.linalg import spsolve

from gpusim.fem import Model
from gpusim.fem.elements.element_matrix import element_stiffness
from gpusim.fem.model.model import resolve_formulation
from gpusim.mesh import CELL_TYPES, Mesh, box, quadratic, split
from gpusim.mesh.shape_functions import reference_nodes

Float = npt.NDArray[np.float64]
Formulation = str | Mapping[str, str] | None


def stiffness(model: Model, formulation: Formulation = None) -> csc_matrix:
    """(3N,3N) assembled from the element matrices."""
    names = resolve_formulation(model, formulation)
    moduli = np.stack([material.stiffness() for material in model.materials])
    assert model.material_of_cell is not None
    rows, columns, values = [], [], []
    for kind, first, block in model.mesh.blocks():
        own = model.material_of_cell[first : first + len(block)]
        matrix = element_stiffness(kind, model.mesh.points[block], moduli[own], names[kind])
        dofs = (3 * block[:, :, None].astype(np.int64) + np.arange(3)).reshape(len(block), -1)
        rows.append(np.repeat(dofs, dofs.shape[1], axis=1).ravel())
        columns.append(np.tile(dofs, (1, dofs.shape[1])).ravel())
        values.append(matrix.ravel())
    count = 3 * model.mesh.node_count
    places = (np.concatenate(rows), np.concatenate(columns))
    return coo_matrix((np.concatenate(values), places), shape=(count, count)).tocsc()


def direct(model: Model, formulation: Formulation = None) -> Float:
    """(N,3) displacements of a model's first load case by a sparse direct solver."""
    matrix = stiffness(model, formulation)
    assert model.fixed is not None
    free = np.flatnonzero(~model.fixed.ravel())
    u = model.prescribed_cases[0].ravel().copy()
    load = (model.load_cases[0].ravel() - matrix @ u)[free]
    u[free] = spsolve(matrix[free][:, free], load)
    return u.reshape(-1, 3)


def one_cell(kind: str) -> Mesh:
    """A single cell, its shape the reference cell's, stretched and turned."""
    nodes = reference_nodes(kind) @ np.array([[1.1, 0.2, 0.0], [-0.1, 0.9, 0.3], [0.2, 0.1, 1.3]])
    return Mesh(nodes + 3.0, {kind: np.arange(len(nodes))[None]})


def bar(kind: str, size: tuple[float, float, float], divisions: tuple[int, int, int]) -> Mesh:
    """A box of one cell type: hexahedra, wedges, tetrahedra or pyramids (six to a hexahedron)."""
    hexahedra = box(size, divisions)
    linear = CELL_TYPES[kind].linear
    if linear == "pyramid5":
        grid = pyramids(hexahedra)
    else:
        grid = hexahedra if linear == "hex8" else split(hexahedra, linear)
    return grid if kind == linear else quadratic(grid, serendipity=CELL_TYPES[kind].serendipity)


def pyramids(mesh: Mesh) -> Mesh:
    """Each hexahedron split into six pyramids around its centre."""
    block = mesh.cells["hex8"]
    apex = mesh.node_count + np.arange(len(block))
    cells = [
        # the face seen from inside, so that the apex is on the right side
        np.column_stack([block[:, face[::-1]], apex])
        for face in CELL_TYPES["hex8"].faces
    ]
    points = np.concatenate([mesh.points, mesh.points[block].mean(axis=1)])
    return Mesh(points, {"pyramid5": np.concatenate(cells)})
