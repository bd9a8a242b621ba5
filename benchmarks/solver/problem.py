"""A benchmark case as a folder of arrays, which every peer reads.

The matrix is assembled here from the element matrices of this folder, not by the solver that is
measured: that all agree says that both are right.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.sparse import coo_matrix, csr_matrix

from benchmarks.solver.element_matrices import element_matrices
from gpusim.bench.solver_cases import Case
from gpusim.fem import Model

__all__ = ["free_matrix", "write_problem"]

Float = npt.NDArray[np.float64]

_CHUNK = 20_000


def free_matrix(case: Case, model: Model) -> csr_matrix[Any]:
    """K on the nodes that aren't clamped, float64 CSR with sorted columns."""
    assert model.fixed is not None
    mesh = model.mesh
    free = ~np.asarray(model.fixed.all(axis=1))
    number = np.cumsum(free) - 1
    cells = mesh.cells[case.kind]
    size = 3 * int(free.sum())
    moduli = case.material.stiffness()
    total = csr_matrix((size, size))
    for start in range(0, len(cells), _CHUNK):
        part = cells[start : start + _CHUNK]
        values = _matrices(case, mesh.points[part], moduli)
        unknown = (3 * number[part][..., None] + np.arange(3)).reshape(len(part), -1)
        held = np.repeat(~free[part], 3, axis=1)
        keep = ~(held[:, :, None] | held[:, None, :])
        row = np.broadcast_to(unknown[:, :, None], keep.shape)[keep]
        column = np.broadcast_to(unknown[:, None, :], keep.shape)[keep]
        total = total + coo_matrix((values[keep], (row, column)), shape=(size, size)).tocsr()
    total.sort_indices()
    return total


def _matrices(case: Case, nodes: Float, moduli: Float) -> Float:
    return np.asarray(
        element_matrices(case.kind, nodes, moduli, case.rule, np.dtype(np.float64)),
        dtype=np.float64,
    )


def write_problem(case: Case, model: Model, u: Float, folder: Path) -> None:
    """Everything a peer's script reads (see ``benchmarks/peers/common.py``); ``u`` (N,3)."""
    assert model.fixed is not None
    folder.mkdir(parents=True, exist_ok=True)
    mesh = model.mesh
    matrix = free_matrix(case, model)
    free = np.flatnonzero(~model.fixed.all(axis=1))
    arrays: dict[str, npt.NDArray[Any]] = {
        "indptr": matrix.indptr.astype(np.int32),
        "indices": matrix.indices.astype(np.int32),
        "data": matrix.data,
        "right": model.load_cases[0][free].ravel(),
        "points": mesh.points[free],
        "wanted": u[free].ravel(),
        "free_nodes": free,
        "all_points": mesh.points,
        "cells": mesh.cells[case.kind],
        "forces": model.load_cases[0],
    }
    for name, array in arrays.items():
        np.save(folder / f"{name}.npy", array)
    meta = {
        "name": case.name, "kind": case.kind, "rule": case.rule, "E": case.material.E,
        "nu": case.material.nu, "divisions": case.divisions, "size": case.lengths,
        "node_count": mesh.node_count,
    }  # fmt: skip
    (folder / "meta.json").write_text(json.dumps(meta, indent=1) + "\n", encoding="utf-8")
