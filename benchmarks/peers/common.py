"""What every peer's script shares: reading the problem, measuring the error, printing JSON.

A problem is a folder: ``meta.json``, the matrix K on the free unknowns as ``indptr.npy``,
``indices.npy``, ``data.npy`` (CSR, float64, both triangles, supports eliminated), ``right.npy``
(n,), ``points.npy`` (n/3,3) coordinates of the free nodes and ``wanted.npy`` (n,) the reference
displacements; ``solved.npy``, where it exists, the exact solution of that very matrix, whose
rounding to float64 moves the displacements of slender bodies. Three unknowns a node,
node by node. NumPy and the standard library only.
"""

import json
import resource
import sys
import time
from pathlib import Path

import numpy as np


class Problem:
    """The arrays of one folder."""

    def __init__(self, folder):
        self.folder = Path(folder)
        self.meta = json.loads((self.folder / "meta.json").read_text())
        self.right = self.load("right")
        self.points = self.load("points")
        self.wanted = self.load("wanted")
        exists = (self.folder / "solved.npy").exists()
        self.solved = self.load("solved") if exists else self.wanted

    def load(self, name):
        return np.load(self.folder / f"{name}.npy")

    def csr(self):
        """(indptr, indices, data) of the whole matrix."""
        return self.load("indptr"), self.load("indices"), self.load("data")

    def scipy_csr(self):
        from scipy.sparse import csr_matrix

        indptr, indices, data = self.csr()
        size = len(self.right)
        return csr_matrix((data, indices, indptr), shape=(size, size))

    def distance(self, u, name):
        """Greatest difference to ``wanted`` or ``solved``, relative to the greatest value."""
        u, wanted = np.asarray(u), getattr(self, name)
        if u.shape != wanted.shape or not np.isfinite(u).all():
            return float("inf")
        return float(np.abs(u - wanted).max() / np.abs(wanted).max())

    def errors(self, u):
        """``error`` of the solver alone (against ``solved``), ``difference`` to ``wanted``."""
        return {"error": self.distance(u, "solved"), "difference": self.distance(u, "wanted")}

    def rigid_modes(self):
        """(n,6) translations and rotations about the middle."""
        p = self.points - self.points.mean(axis=0)
        p = p / np.abs(p).max()
        modes = np.zeros((len(p), 3, 6))
        for axis in range(3):
            modes[:, axis, axis] = 1.0
            a, b = (axis + 1) % 3, (axis + 2) % 3
            modes[:, a, 3 + axis], modes[:, b, 3 + axis] = -p[:, b], p[:, a]
        return modes.reshape(-1, 6)


class Clock:
    def __init__(self):
        self.start = time.perf_counter()

    def lap(self):
        """Seconds since the last lap."""
        now = time.perf_counter()
        seconds, self.start = now - self.start, now
        return seconds


def peak_kib():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def sweep(problem, solve, tolerances, enough=1e-6):
    """[{tolerance, seconds, iterations, error}] from loose to tight, until the error is enough.

    500 iterations are taken for a peer that doesn't converge.
    """
    runs = []
    for tolerance in tolerances:
        clock = Clock()
        u, iterations = solve(tolerance)
        seconds = clock.lap()
        runs.append({"tolerance": tolerance, "solve_s": seconds, "iterations": int(iterations),
                     **problem.errors(u)})  # fmt: skip
        if runs[-1]["error"] <= enough or iterations >= 500:
            break
    return runs


def main(run):
    """Call ``run(problem, options) -> [variant]`` and print its JSON on the last line.

    A variant is {"name", "setup_s", "runs", "note"?}; ``peak_kib`` and ``before_kib`` (after
    reading, before the set-up) are added here.
    """
    problem = Problem(sys.argv[1])
    options = json.loads(sys.argv[2]) if len(sys.argv) > 2 else {}
    variants = run(problem, options)
    if variants is not None:
        print(json.dumps({"variants": variants, "peak_kib": peak_kib()}), flush=True)
