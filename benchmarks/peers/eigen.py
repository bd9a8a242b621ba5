"""The lowest eigenvalues of K x = lambda M x by shift and invert around zero: SciPy's `eigsh` with
SuperLU or PARDISO, or SLEPc's Krylov-Schur with MUMPS.

``python eigen.py FOLDER SOLVER COUNT``: the folder has ``k.npz`` and ``m.npz`` (SciPy's CSR, both
triangles). The last line is JSON: values, seconds of the wall and of the processors from the
matrices on. Knows no gpusim.
"""

import json
import sys
import time

import numpy as np

TOLERANCE = 1e-8


class Matrix:
    """The arrays of a CSR matrix, by SciPy's names: SLEPc's interpreter may have no SciPy."""

    def __init__(self, path):
        with np.load(path) as file:
            self.indptr, self.indices, self.data = (
                file[name] for name in ("indptr", "indices", "data")
            )
        self.shape = (len(self.indptr) - 1,) * 2

    def scipy(self):
        from scipy.sparse import csr_matrix

        return csr_matrix((self.data, self.indices, self.indptr), shape=self.shape)


def superlu(stiffness, mass, count):
    from scipy.sparse.linalg import LinearOperator, eigsh, splu

    k, m = stiffness.scipy(), mass.scipy()
    lu = splu(k.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
              options={"SymmetricMode": True})  # fmt: skip
    inverse = LinearOperator(k.shape, lu.solve)
    return eigsh(k, count, m, sigma=0.0, OPinv=inverse, tol=TOLERANCE)[0]


def pardiso(stiffness, mass, count):
    """On the upper triangle: pypardiso's default is the solver of matrices that aren't symmetric,
    and takes twice as long."""
    from pypardiso import PyPardisoSolver
    from scipy.sparse import triu
    from scipy.sparse.linalg import LinearOperator, eigsh

    k, m = stiffness.scipy(), mass.scipy()
    upper = triu(k, format="csr")
    upper.sort_indices()
    solver = PyPardisoSolver(mtype=2)
    solver.factorize(upper)
    solver.set_phase(33)

    def solve(b):
        return solver._call_pardiso(upper, np.ascontiguousarray(b, dtype=float).ravel())

    inverse = LinearOperator(k.shape, solve, dtype=float)
    return eigsh(k, count, m, sigma=0.0, OPinv=inverse, tol=TOLERANCE)[0]


def slepc(stiffness, mass, count):
    import petsc4py

    petsc4py.init([])
    from petsc4py import PETSc
    from slepc4py import SLEPc

    def matrix(a):
        made = PETSc.Mat().createAIJ(
            a.shape, csr=(a.indptr.astype("i4"), a.indices.astype("i4"), a.data)
        )
        made.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        made.setOption(PETSc.Mat.Option.SPD, True)
        return made

    solver = SLEPc.EPS().create()
    solver.setOperators(matrix(stiffness), matrix(mass))
    solver.setProblemType(SLEPc.EPS.ProblemType.GHEP)
    solver.setDimensions(count)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
    solver.setTarget(0.0)
    solver.setTolerances(TOLERANCE)
    transform = solver.getST()
    transform.setType("sinvert")
    inner = transform.getKSP()
    inner.setType("preonly")
    factor = inner.getPC()
    factor.setType("cholesky")
    factor.setFactorSolverType("mumps")
    solver.solve()
    return [solver.getEigenvalue(k).real for k in range(count)]


def main():
    folder, solver, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
    matrices = [Matrix(f"{folder}/{name}.npz") for name in "km"]
    wall, processor = time.perf_counter(), time.process_time()
    values = {"superlu": superlu, "pardiso": pardiso, "slepc": slepc}[solver](*matrices, count)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    found = {"values": sorted(map(float, values)), "wall": wall, "processor": processor}
    print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
