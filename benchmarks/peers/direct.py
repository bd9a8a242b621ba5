"""Sparse direct solvers: MKL PARDISO (pypardiso), CHOLMOD (SuiteSparse 5), NGSolve's Cholesky."""

import ctypes

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


class Sparse(ctypes.Structure):
    """cholmod_sparse of SuiteSparse 5."""

    _fields_ = [
        *[(name, ctypes.c_size_t) for name in ("nrow", "ncol", "nzmax")],
        *[(name, ctypes.c_void_p) for name in ("p", "i", "nz", "x", "z")],
        *[
            (name, ctypes.c_int)
            for name in ("stype", "itype", "xtype", "dtype", "sorted", "packed")
        ],
    ]


class Dense(ctypes.Structure):
    """cholmod_dense of SuiteSparse 5."""

    _fields_ = [
        *[(name, ctypes.c_size_t) for name in ("nrow", "ncol", "nzmax", "d")],
        *[(name, ctypes.c_void_p) for name in ("x", "z")],
        *[(name, ctypes.c_int) for name in ("xtype", "dtype")],
    ]


def cholmod(problem, matrix):
    """CHOLMOD through ctypes, with its default ordering strategy (AMD, then METIS)."""
    import scipy.sparse

    library = ctypes.CDLL("libcholmod.so.3")
    common = ctypes.create_string_buffer(1 << 16)  # larger than cholmod_common
    for name in ("cholmod_analyze", "cholmod_solve"):
        getattr(library, name).restype = ctypes.c_void_p
    library.cholmod_start(common)
    lower = scipy.sparse.tril(matrix, format="csc")
    size = len(problem.right)
    arrays = [lower.indptr.astype(np.int32), lower.indices.astype(np.int32), lower.data]
    p, i, x = (array.ctypes.data for array in arrays)
    sparse = Sparse(size, size, lower.nnz, p, i, None, x, None, -1, 0, 1, 0, 1, 1)
    right = Dense(size, 1, size, size, problem.right.ctypes.data, None, 1, 0)
    clock = Clock()
    factor = ctypes.c_void_p(library.cholmod_analyze(ctypes.byref(sparse), common))
    if not factor or not library.cholmod_factorize(ctypes.byref(sparse), factor, common):
        raise SystemExit("CHOLMOD failed")
    setup = clock.lap()
    answer = library.cholmod_solve(0, factor, ctypes.byref(right), common)
    seconds = clock.lap()
    values = ctypes.cast(answer, ctypes.POINTER(Dense)).contents.x
    u = np.ctypeslib.as_array(ctypes.cast(values, ctypes.POINTER(ctypes.c_double)), (size,))
    return variant(problem, "CHOLMOD", setup, seconds, u)


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
