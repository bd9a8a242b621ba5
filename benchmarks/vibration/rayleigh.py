"""Frequencies of given shapes in extended precision, from element matrices of the benchmarks' own.

What rounds to 64 bits in an assembled matrix moves the frequencies of slender bodies by 1e-6.
Energies of shapes in 80 bits don't, and an error of the shapes enters by its square.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.linalg import eigh

from benchmarks.solver.element_matrices import element_matrices
from benchmarks.solver.reference import unique_shapes
from gpusim.fem import Model, mass_matrix

Float = npt.NDArray[np.float64]
_CHUNK = 1000
_LONG = np.dtype(np.longdouble)


def rayleigh_frequencies(model: Model, rules: Mapping[str, str], shapes: Float) -> Float:
    """(n,) Hz in the span of ``shapes`` (n,N,3), of bodies that can't move freely."""
    flat = shapes.reshape(len(shapes), -1)
    # of unit size, so that products stay far from rounding
    flat = flat / np.abs(flat).max(axis=1, keepdims=True)
    inertia = flat @ (mass_matrix(model) @ flat.T)
    size = 1.0 / np.sqrt(inertia.diagonal())
    energy = _energies(model, rules, flat.reshape(shapes.shape))
    scaled = (np.asarray(one, dtype=np.float64) * size * size[:, None]
              for one in (energy, inertia))  # fmt: skip
    return np.sqrt(eigh(*scaled, eigvals_only=True)) / (2.0 * np.pi)


def _energies(model: Model, rules: Mapping[str, str], shapes: Float) -> npt.NDArray[np.longdouble]:
    """(n,n) twice the strain energy of each pair."""
    count = len(shapes)
    total = np.zeros((count, count), dtype=_LONG)
    assert model.material_of_cell is not None
    for kind, first, cells in model.mesh.blocks():
        number = model.material_of_cell[first : first + len(cells)]
        for material in np.unique(number):
            moduli = model.materials[material].stiffness().astype(_LONG)
            chosen = cells[number == material]
            first_alike, alike = unique_shapes(model.mesh.points[chosen])
            order = np.argsort(alike, kind="stable")
            ends = np.concatenate([[0], np.cumsum(np.bincount(alike))])
            for start in range(0, len(first_alike), _CHUNK):
                nodes = chosen[first_alike[start : start + _CHUNK]]
                points = model.mesh.points[nodes].astype(_LONG)
                matrices = element_matrices(kind, points, moduli, rules[kind], _LONG)
                for k, matrix in enumerate(matrices, start):
                    own = chosen[order[ends[k] : ends[k + 1]]]
                    moved = shapes[:, own].astype(_LONG)
                    moved = (moved - moved[:, :, :1]).reshape(count, len(own), -1)
                    total += np.einsum("aci,bci->ab", moved @ matrix, moved)
    return total
