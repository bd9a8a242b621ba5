"""Two blocks on top of each other whose meshes don't match; solutions by Lagrange multipliers."""

from __future__ import annotations

import numpy as np
from scipy.sparse import bmat, csc_matrix, csr_matrix, vstack
from scipy.sparse.linalg import splu

from gpusim.fem import Equations, Model, tie
from gpusim.mesh import Faces, Mesh, box, quadratic, select_faces, split
from tests.support.fem_reference import Float, stiffness

Divisions = tuple[int, int, int]
SIZE = (2.0, 3.0, 1.0)


def blocks(lower: Divisions, upper: Divisions, gap: float = 0.0, kind: str = "hex8") -> Mesh:
    """Each of SIZE, the upper one at z = 1 + ``gap``; cells of one ``kind``."""
    parts = [box(SIZE, lower), box(SIZE, upper, origin=(0.0, 0.0, SIZE[2] + gap))]
    if kind.startswith("tet"):
        parts = [split(one, "tet4") for one in parts]
    if kind in ("tet10", "hex20"):
        parts = [quadratic(one) for one in parts]
    cells = [parts[0].cells[kind], parts[1].cells[kind] + parts[0].node_count]
    points = np.concatenate([one.points for one in parts])
    return Mesh(points, {kind: np.concatenate(cells)})


def joint(mesh: Mesh, gap: float = 0.0) -> tuple[Faces, Faces]:
    """The top of the lower block and the bottom of the upper one."""
    low = {"z_min": SIZE[2], "z_max": SIZE[2]}
    high = {"z_min": SIZE[2] + gap, "z_max": SIZE[2] + gap}
    return (
        select_faces(mesh, bounds=low, normal="+z"),
        select_faces(mesh, bounds=high, normal="-z"),
    )


def joined(mesh: Mesh) -> Equations:
    """The upper block follows the lower one."""
    return tie(mesh, *joint(mesh))


def by_multipliers(model: Model) -> Float:
    """(L,N,3) displacements: [K A'; A 0] [u; m] = [f; b], with supports as equations, too."""
    assert model.fixed is not None
    matrix = stiffness(model)
    count = matrix.shape[0]
    loose = (model.mesh.dangling_nodes[:, None] * 3 + np.arange(3)).ravel()
    held = np.flatnonzero(model.fixed.ravel())
    rows = [one.matrix for one in model.constraints]
    used = np.zeros(count, dtype=bool)
    used[vstack(rows).indices] = True
    still = np.union1d(held, loose[~used[loose]])
    one = csr_matrix((np.ones(len(still)), (np.arange(len(still)), still)), (len(still), count))
    size = float(matrix.diagonal().max())
    held_by = vstack([one, *rows]) * size
    factor = splu(csc_matrix(bmat([[matrix, held_by.T], [held_by, None]])))
    given = np.where(model.fixed, model.prescribed_cases, 0.0).reshape(-1, count)
    answers = []
    for case, forces in enumerate(model.load_cases):
        known = given[min(case, len(given) - 1)][still]
        right = np.concatenate([known, *(one.right for one in model.constraints)]) * size
        answers.append(factor.solve(np.concatenate([forces.ravel(), right]))[:count])
    return np.stack(answers).reshape(-1, *model.mesh.points.shape)
