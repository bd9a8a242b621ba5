"""Consistent nodal forces: each function returns (N,3) float64, to be added up freely."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.fem.element import ELEMENTS, quad_shape
from gpusim.mesh import Faces, Mesh

__all__ = ["body_force", "face_force", "nodal_force", "pressure", "traction"]

Float = npt.NDArray[np.float64]


def nodal_force(mesh: Mesh, nodes: npt.ArrayLike, total: npt.ArrayLike) -> Float:
    """``total`` (3,) shared equally by ``nodes`` (K,)."""
    given = np.asarray(nodes)
    if given.size and given.dtype.kind not in "iu":
        raise InputError(f"nodal_force: nodes; got {given.dtype}; expected integer node numbers")
    numbers = np.unique(given.astype(np.int64).ravel())
    if numbers.size == 0 or numbers[0] < 0 or numbers[-1] >= mesh.node_count:
        raise InputError(
            f"nodal_force: nodes; got {numbers.size} numbers "
            f"{numbers[:3].tolist()}…; expected at least one in 0 … {mesh.node_count - 1}"
        )
    forces = np.zeros((mesh.node_count, 3))
    forces[numbers] = _vector("nodal_force: total", total) / len(numbers)
    return forces


def face_force(mesh: Mesh, faces: Faces, total: npt.ArrayLike) -> Float:
    """``total`` (3,) spread uniformly over the area of ``faces``."""
    vector = _vector("face_force: total", total)
    weights = _integrate(faces, lambda normal: np.linalg.norm(normal, axis=2, keepdims=True))
    return _scatter(mesh, faces, weights * (vector / weights.sum()))


def traction(mesh: Mesh, faces: Faces, value: npt.ArrayLike) -> Float:
    """Force per area ``value`` (3,) on the undeformed ``faces``."""
    vector = _vector("traction: value", value)
    weights = _integrate(faces, lambda normal: np.linalg.norm(normal, axis=2, keepdims=True))
    return _scatter(mesh, faces, weights * vector)


def pressure(mesh: Mesh, faces: Faces, value: float) -> Float:
    """Pressure ``value`` (positive pushes into the body) on the undeformed ``faces``."""
    if not np.isfinite(value):
        raise InputError(f"pressure: value; got {value}; expected a finite number")
    return _scatter(mesh, faces, _integrate(faces, lambda normal: -value * normal))


def body_force(mesh: Mesh, density: npt.ArrayLike, acceleration: npt.ArrayLike) -> Float:
    """Gravity and the like: ``density`` (scalar or (M,) per cell) times ``acceleration`` (3,)."""
    vector = _vector("body_force: acceleration", acceleration)
    rho = np.asarray(density, dtype=np.float64)
    if rho.shape not in ((), (mesh.cell_count,)) or not np.isfinite(rho).all():
        raise InputError(
            f"body_force: density; got shape {rho.shape}; expected a finite number or "
            f"({mesh.cell_count},) of them"
        )
    rho = np.broadcast_to(rho, (mesh.cell_count,))
    forces = np.zeros((mesh.node_count, 3))
    for kind, first, block in mesh.blocks():
        element = ELEMENTS[kind]
        nodes = mesh.points[block] - mesh.points[block[:, :1]]
        jacobian = np.einsum("mki,qkj->mqij", nodes, element.gradient)
        volume = np.linalg.det(jacobian) * element.weight
        share = np.einsum("mq,qk,m->mk", volume, element.shape, rho[first : first + len(block)])
        mass = np.bincount(block.ravel(), weights=share.ravel(), minlength=mesh.node_count)
        forces += mass[:, None] * vector
    return forces


def _integrate(faces: Faces, density: object) -> Float:
    """(F,4,…) integrals of shape function times density(normal area vector) over each face."""
    if len(faces) == 0:
        raise InputError("face load: no faces; got an empty selection; expected at least one face")
    gauss = np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]) / np.sqrt(3.0)
    shape, gradient = quad_shape(gauss)
    tangent = np.einsum("fki,qkj->fqij", faces.corners, gradient)
    normal = np.cross(tangent[..., 0], tangent[..., 1])
    assert callable(density)
    result: Float = np.einsum("qk,fqi->fki", shape, density(normal))
    triangle = faces.is_triangle
    if triangle.any():
        # constant density on a flat triangle: a third of the whole to each corner
        whole = density(faces.area_vectors[triangle][:, None, :])
        result[triangle] = np.concatenate(
            [np.repeat(whole / 3.0, 3, axis=1), np.zeros_like(whole)], axis=1
        )
    return result


def _scatter(mesh: Mesh, faces: Faces, values: Float) -> Float:
    real = faces.nodes >= 0
    nodes = faces.nodes[real]
    return np.stack(
        [
            np.bincount(nodes, weights=values[..., axis][real], minlength=mesh.node_count)
            for axis in range(3)
        ],
        axis=1,
    )


def _vector(where: str, value: npt.ArrayLike) -> Float:
    vector = np.asarray(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{where}; got {value!r}; expected 3 finite numbers")
    return vector
