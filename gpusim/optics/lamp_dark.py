"""What is dark of a closed body without a shadow, as it is turned away from the lamp."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.optics.corners import products
from gpusim.optics.emitters import Lamp
from gpusim.optics.lamp_turn import SURE
from gpusim.optics.outline import unit
from gpusim.optics.ragged import expand
from gpusim.optics.shape import Shape
from gpusim.surface.topology import Topology

__all__ = ["doubtful"]

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Numbers = npt.NDArray[np.int64]

MOST = 100_000
"""Dark triangles beside others that are looked at closely."""


def doubtful(
    lamp: Lamp, shape: Shape, topology: Topology, lit: Flags, eye: Array
) -> Numbers | None:
    """Of the triangles that aren't ``lit`` (T,) but look to the ``eye``, those that the lamp may
    light nevertheless, by normals that they share with others; None where too many may."""
    triangles, points, area = topology.triangles, shape.points, shape.area
    met = np.zeros(len(points), bool)
    for k in range(3):
        met[triangles[lit, k]] = True
    # all around the others is dark, too
    own = np.flatnonzero(
        ~lit & (met[triangles[:, 0]] | met[triangles[:, 1]] | met[triangles[:, 2]])
    )
    start = points[triangles[own, 0]]
    own = own[np.einsum("ka,ak->k", eye - start, area[:, own]) > 0.0]
    if len(own) > MOST:
        return None
    met[:] = False
    met[triangles[own]] = True
    some = np.flatnonzero(met[triangles[:, 0]] | met[triangles[:, 1]] | met[triangles[:, 2]])
    order = np.argsort(triangles[some], axis=None, kind="stable")
    vertex, around = triangles[some].reshape(-1)[order], some[order // 3]
    corner = triangles[own].reshape(-1)
    first = np.searchsorted(vertex, corner)
    row, offset = expand(np.searchsorted(vertex, corner, side="right") - first)
    other, mine = around[first[row] + offset], own[row // 3]
    alike = products(unit(area[:, mine]), unit(area[:, other])) >= np.cos(shape.smooth_angle) - SURE
    mine, normal = mine[alike], area[:, other[alike]]
    reach = np.abs(products(normal, lamp.u)) + np.abs(products(normal, lamp.v))
    reach += products(normal, lamp.centre)
    near = 0.0 if lamp.far else 1.0
    turned = np.zeros(len(mine), bool)
    for k in range(3):
        turned |= reach > near * products(normal, points[triangles[mine, k]].T)
    return np.unique(mine[turned])
