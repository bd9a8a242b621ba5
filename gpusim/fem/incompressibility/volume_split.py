"""K = A + B^T C^-1 B: nearly incompressible mean-dilatation bricks with a pressure per cell.

A mean-dilatation ("bbar") element feels its bulk modulus by the change of its whole volume alone,
so what a modulus has beyond that of an ordinary material is a matrix of rank one per cell: B (M,3N)
takes displacements to changes of volume, C = V / (kappa - kappa_0) the rest's compliance. With
the pressures p = C^-1 B u,

    A u + B^T p = f,    B u - C p = 0,

and A is as easy for multigrid as any compressible body (Malkus & Hughes, Comput. Methods Appl.
Mech. Eng. 15 (1978) 63, on the equivalence).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_matrix

from gpusim.arrays.array_types import Bool, Float, Long
from gpusim.fem.elements.element_matrix import volume_gradients
from gpusim.fem.lattice.lattice import CORNERS, Lattice
from gpusim.fem.materials.isotropic import Isotropic
from gpusim.fem.materials.law import Material
from gpusim.fem.model.model import Model

# Poisson's ratio that is left to A, and the ratio of bulk to shear modulus (10 at nu = 0.45) from
# which on something is taken from it
_ORDINARY, _STIFF = 0.3, 10.0
# how close to isotropic a stiffness must be
_SAME = 1e-10


@dataclass(frozen=True, eq=False)
class VolumeSplit:
    """``model`` is A's. Per cell ``nodes`` (M,8), ``volume`` (M,), ``compliance`` C (M,), ``shear``
    (M,) which B A^-1 B^T is about volume over, and ``split`` (M,) whether it has a pressure at all.
    ``divergence`` B (M,3N) csr, zero for fixed unknowns and cells without pressure. ``place`` (M,3)
    of each cell where there is a ``lattice``; the cells are in the order of its ``corner_nodes``
    then, in that of the mesh otherwise."""

    model: Model
    lattice: Lattice | None
    place: Long
    nodes: Long
    volume: Float
    compliance: Float
    shear: Float
    split: Bool
    divergence: csr_matrix


def split_volume(
    model: Model, formulation: Mapping[str, str], lattice: Lattice | None, free: Bool
) -> VolumeSplit | None:
    """None unless all cells are mean-dilatation bricks of isotropic materials.

    ``free`` (N,3).
    """
    if formulation != {"hex8": "bbar"}:
        return None
    parts = [_isotropic(material) for material in model.materials]
    known = [part for part in parts if part is not None]
    if len(known) < len(parts):
        return None
    bulk, shear = np.array(known).T
    stiff = bulk > _STIFF * shear
    kept_bulk = 2.0 * (1.0 + _ORDINARY) / (3.0 - 6.0 * _ORDINARY) * shear
    ordinary: list[Material] = [
        Isotropic(2.0 * (1.0 + _ORDINARY) * g, _ORDINARY) if soften else material
        for material, g, soften in zip(model.materials, shear.tolist(), stiff, strict=True)
    ]
    assert model.material_of_cell is not None
    material = model.material_of_cell
    if lattice is None:
        nodes = model.mesh.cells["hex8"].astype(np.int64)
        place = np.zeros((0, 3), dtype=np.int64)
        gradient = volume_gradients(model.mesh.points[nodes])
        # x is linear: what moving along with it adds is the volume
        volume = np.einsum("mk,mk->m", gradient[:, :, 0], _from_first(model, nodes))
    else:
        at, corners = lattice.corner_nodes()
        nodes = corners.astype(np.int64)
        place = np.stack(np.unravel_index(at, lattice.cell.shape), axis=1).astype(np.int64)
        material = material[lattice.cell.ravel()[at]]
        size = np.stack([np.diff(lattice.planes[k])[place[:, k]] for k in range(3)], axis=1)
        volume = size.prod(axis=1)
        # faces' areas times mean displacements
        gradient = (2.0 * CORNERS - 1.0) * (0.25 * volume[:, None] / size)[:, None, :]
    split = stiff[material]
    rest = np.where(stiff, bulk - kept_bulk, 1.0)[material]
    return VolumeSplit(
        replace(model, materials=ordinary),
        lattice,
        place,
        nodes,
        volume,
        np.where(split, volume / rest, 1.0),
        (2.0 * shear + kept_bulk)[material],
        split,
        _divergence(nodes, gradient, split, free),
    )


def _from_first(model: Model, nodes: Long) -> Float:
    """(M,8) x relative to each cell's first node."""
    x = model.mesh.points[nodes, 0]
    return np.asarray(x - x[:, :1])


def _isotropic(material: Material) -> tuple[float, float] | None:
    """Bulk and shear modulus."""
    elastic = material.stiffness()
    shear = float(np.diag(elastic)[3:].mean())
    bulk = float(elastic[:3, :3].mean())
    wanted = np.zeros((6, 6))
    wanted[:3, :3] = bulk - 2.0 / 3.0 * shear
    wanted[np.arange(6), np.arange(6)] += shear * np.repeat([2.0, 1.0], 3)
    close = bool((np.abs(elastic - wanted) <= _SAME * bulk).all())
    return (bulk, shear) if close and bulk > 0.0 else None


def _divergence(nodes: Long, gradient: Float, split: Bool, free: Bool) -> csr_matrix:
    """Integral of div u over each brick."""
    count = len(nodes)
    values = np.where(free[nodes] & split[:, None, None], gradient, 0.0)
    columns = (3 * nodes[:, :, None] + np.arange(3)).reshape(-1)
    start = np.arange(0, 24 * count + 1, 24)
    return csr_matrix((values.reshape(-1), columns, start), shape=(count, free.size))
