"""Sparse direct solvers: MKL PARDISO (pypardiso), CHOLMOD (cholespy), NGSolve's Cholesky."""

import numpy as np
from common import Clock, main


def run(problem, options):
    name = options["solver"]
    matrix = problem.scipy_csr()
    if name == "exact":
        return exact(problem, matrix)
    return [{"pardiso": pardiso, "cholmod": cholmod, "ngsolve": ngsolve}[name](problem, matrix)]


def variant(problem, name, setup, seconds, u):
    run = {"tolerance": 0.0, "solve_s": seconds, "iterations": 1, **problem.errors(u)}
    return {"name": name, "setup_s": setup, "runs": [run]}


def pardiso(problem, matrix):
    import scipy.sparse
    from pypardiso import PyPardisoSolver

    upper = scipy.sparse.triu(matrix, format="csr")
    clock = Clock()
    solver = PyPardisoSolver(mtype=2)  # real, symmetric positive definite
    solver.factorize(upper)
    setup = clock.lap()
    u = solver.solve(upper, problem.right)
    return variant(problem, "PARDISO (MKL)", setup, clock.lap(), u)


def exact(problem, matrix):
    """Write ``solved.npy``: PARDISO, then refinement with residuals in extended precision."""
    import scipy.sparse
    from pypardiso import PyPardisoSolver

    upper = scipy.sparse.triu(matrix, format="csr")
    solver = PyPardisoSolver(mtype=2)
    solver.factorize(upper)
    u = solver.solve(upper, problem.right).astype(np.longdouble)
    change = np.inf
    for _ in range(20):
        step = solver.solve(upper, residual(matrix, u, problem.right).astype(np.float64))
        before, change = change, np.abs(step).max() / np.abs(u).max()
        if not change < 0.5 * before:
            break
        u += step
    if not change <= 1e-8:
        raise SystemExit(f"refinement stopped at a change of {change:.1e}")
    np.save(problem.folder / "solved.npy", u.astype(np.float64))
    return []


def residual(matrix, u, right, rows=20000):
    """right - K u with products and sums in extended precision, some rows at a time."""
    result = right.astype(np.longdouble)
    for first in range(0, len(right), rows):
        last = min(first + rows, len(right))
        entries = slice(matrix.indptr[first], matrix.indptr[last])
        products = matrix.data[entries].astype(np.longdouble) * u[matrix.indices[entries]]
        starts = matrix.indptr[first:last] - matrix.indptr[first]
        result[first:last] -= np.add.reduceat(products, starts)
    return result


def cholmod(problem, matrix):
    from cholespy import CholeskySolverD, MatrixType

    clock = Clock()
    solver = CholeskySolverD(
        matrix.shape[0], matrix.indptr, matrix.indices, matrix.data, MatrixType.CSR
    )
    setup = clock.lap()
    u = np.zeros_like(problem.right)
    solver.solve(problem.right, u)
    return variant(problem, "CHOLMOD (cholespy)", setup, clock.lap(), u)


def ngsolve(problem, matrix):
    import ngsolve
    from ngsolve.la import SparseMatrixd

    lower = matrix.tocoo()
    sparse = SparseMatrixd.CreateFromCOO(
        lower.row.astype(np.int32), lower.col.astype(np.int32), lower.data, *matrix.shape
    )
    right, u = sparse.CreateColVector(), sparse.CreateColVector()
    right.FV().NumPy()[:] = problem.right
    clock = Clock()
    with ngsolve.TaskManager():
        inverse = sparse.Inverse(inverse="sparsecholesky")
        setup = clock.lap()
        u.data = inverse * right
    return variant(problem, f"NGSolve {ngsolve.__version__} sparsecholesky", setup, clock.lap(),
                   u.FV().NumPy())  # fmt: skip


if __name__ == "__main__":
    main(run)
