"""A stocky block between smooth plates, pressed through its thickness (Sussman & Bathe, Computers &
Structures 140 (2014) 14): it is stable to a strain of some 0.4, every earlier loss an element's.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh

from gpusim.mesh import box
from tests.support.element_responses import Body, NeoHooke, elements


def lowest_of_pressed_block(form: tuple[str, str, str], aspect: float, strain: float) -> float:
    """The tangent's lowest eigenvalue; cells are ``aspect`` times as long as thick."""
    count = 5
    mesh = box(size=(aspect * count, 1.0, float(count)), divisions=(count, 1, count))
    low, high = mesh.bounds
    free = ~(np.isclose(mesh.points, low) | np.isclose(mesh.points, high))
    free[:, 0] = True
    body = Body(mesh, elements(form, mesh.points, mesh.cells["hex8"], NeoHooke(0.0)), free)
    _, matrix = body.dense(-strain * mesh.points * [0.0, 0.0, 1.0])
    kept = np.flatnonzero(free)
    lowest = eigh(matrix[np.ix_(kept, kept)], eigvals_only=True, subset_by_index=[0, 0])
    return float(lowest[0])
