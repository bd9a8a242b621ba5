"""A neo-Hookean block between two plates that it is bonded to, pressed by a tenth of its height.

An eighth of the block 2 x 2 x 1, with cells that get smaller towards its edges, where stress is
singular. The force converges with about the 1.6th power of the cells.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.fem import Law, Model, NeoHookean, solve
from tests.support.verification_models import mapped, unit_block

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]

RUBBER = NeoHookean(1.0, 0.3)
FORCE = 0.123567
"""Of a quarter: hex20, tet10 and wedge15 of 2, 4 and 8 cells extrapolate to it within 1e-5."""


def bonded_block(kind: str, cells: int, law: Law = RUBBER) -> tuple[Model, Bool]:
    """The model, ``cells`` along each edge, and its nodes at the plate."""

    def place(unit: Float) -> Float:
        return np.asarray((1.0 - (1.0 - unit) ** 2) * [1.0, 1.0, 0.5])

    mesh = mapped(unit_block(kind, (cells, cells, cells)), place, straight=True)
    plate = mesh.points[:, 2] >= 0.5 - 1e-9
    fixed = (mesh.points <= 1e-9) | plate[:, None]
    pressed = np.where(plate[:, None], [0.0, 0.0, -0.05], 0.0)
    return Model(mesh, law, fixed, prescribed=pressed), plate


def plate_force(kind: str, formulation: str, cells: int, law: Law = RUBBER) -> float:
    """Of a quarter of the block."""
    model, plate = bonded_block(kind, cells, law)
    found = solve(model, geometry="nonlinear", formulation={kind: formulation}, tolerance=1e-7)
    assert found.converged, found.message
    return -float(found.reactions[plate, 2].sum())


def extrapolated(coarse: float, middle: float, fine: float) -> float:
    """Richardson's, of meshes with cells half as large each."""
    ratio = (coarse - middle) / (middle - fine)
    return fine - (middle - fine) / (ratio - 1.0)
