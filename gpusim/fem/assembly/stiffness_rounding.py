"""What the rounding of the stiffness itself does to the displacements, and what it comes from.

K_ij is known to half a unit in its last place. A stiff part that turns as a rigid body on
something soft, or a slender body's end, moves by differences u_j - u_i that strain nothing, yet
K_ij (u_j - u_i) is rounded all the same: forces of about

    eps/2 * sum_j |K_ij| |u_j - u_i|

of random sign act where none should. No residual shows them, because it is rounded alike. Their
displacements do: K^-1 times such forces (Higham, Accuracy and Stability, 2002, section 7.2).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.arrays.unique import mix
from gpusim.fem.assembly.block_rows import BlockRows
from gpusim.fem.device.stiffness import apply_stiffness
from gpusim.fem.model.model import Model
from gpusim.mesh import mesh_quality

__all__ = ["extremes", "rounding_forces", "signed"]

Float = npt.NDArray[np.float64]


def rounding_forces(rows: BlockRows, u: Float) -> Float:
    """Forces (L,N,3) as large as the rounding in K u, of fixed pseudo-random sign."""
    # equal rows are rounded alike: along a uniform beam their errors add up and don't average out
    together = np.sqrt(rows.node_count / rows.class_count)
    size = apply_stiffness(rows, u, absolute=True) * (0.5 * np.finfo(np.float64).eps * together)
    return signed(size)


def signed(size: Float) -> Float:
    """Forces of these sizes (L,N,3), of fixed pseudo-random sign."""
    shape = size.shape[1:]
    sign = (mix(np.arange(size[0].size), 9) >> np.uint64(63)).astype(np.float64).reshape(shape)
    return np.asarray(size * (2.0 * sign - 1.0))


def extremes(model: Model) -> str:
    """What makes a model hard to solve in float64, in words; "" where nothing stands out."""
    found = []
    points = model.mesh.points
    centred = points - points.mean(axis=0)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred), 0.0))
    if not spread[2] <= 50.0 * spread[0]:
        found.append(f"a slenderness of {spread[2] / max(spread[0], 1e-300):.2g}")
    aspect = float(mesh_quality(model.mesh).aspect.max())
    if not aspect <= 20.0:
        found.append(f"elements of aspect {aspect:.2g}")
    stiffness = [float(np.linalg.eigvalsh(m.stiffness()).max()) for m in model.materials]
    if not max(stiffness) <= 1e3 * min(stiffness):
        found.append(f"stiffnesses in the ratio {max(stiffness) / min(stiffness):.2g}")
    values = [np.linalg.eigvalsh(m.stiffness()) for m in model.materials]
    softest = max(float(one.max() / one.min()) for one in values)
    if not softest <= 100.0:
        found.append(f"a nearly incompressible material (moduli in the ratio {softest:.2g})")
    extent = [
        np.linalg.norm(np.ptp(points[block], axis=1), axis=1)
        for block in model.mesh.cells.values()
        if len(block)
    ]
    largest, smallest = max(float(e.max()) for e in extent), min(float(e.min()) for e in extent)
    if not largest <= 100.0 * smallest:
        found.append(f"element sizes in the ratio {largest / smallest:.2g}")
    return ", ".join(found)
