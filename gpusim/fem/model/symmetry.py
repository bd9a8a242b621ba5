"""Symmetry supports: faces on a plane of symmetry don't move along their normal."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.mesh import Faces, Mesh

__all__ = ["symmetry"]


def symmetry(mesh: Mesh, faces: Faces) -> npt.NDArray[np.bool_]:
    """(N,3) bool for ``Model.fixed``: the displacement along the normal of flat ``faces``.

    The faces must lie in one plane x, y or z = constant (1e-6 of the mesh's extent): supports are
    along the axes. Raises InputError otherwise, saying what the faces look like.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(2, 1, 1), divisions=(2, 1, 1))
    >>> gs.fem.symmetry(bar, gs.mesh.select_faces(bar, name="y_min")).sum(axis=0)
    array([0, 6, 0])
    """
    if len(faces) == 0:
        raise InputError("symmetry: no faces; got an empty selection; expected at least one face")
    normals = faces.normals
    mean = normals.mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    nodes = faces.node_numbers()
    along = mesh.points[nodes, axis]
    extent = float((mesh.bounds[1] - mesh.bounds[0]).max())
    thickness = float(along.max() - along.min())
    if not thickness <= 1e-6 * extent:
        tilted = normals[np.argmin(np.abs(normals[:, axis]))]
        shown = ", ".join(f"{value:.4g}" for value in tilted)
        raise InputError(
            f"symmetry: the {len(faces)} faces aren't in one plane across an axis; got "
            f"{'xyz'[axis]} from {along.min():.6g} to {along.max():.6g}, a normal ({shown}); "
            "expected a flat selection that looks along x, y or z (turn the mesh so that the "
            "plane of symmetry does)"
        )
    fixed = np.zeros((mesh.node_count, 3), dtype=bool)
    fixed[nodes, axis] = True
    return fixed
