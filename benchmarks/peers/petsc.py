"""PETSc: conjugate gradients with geometric multigrid (boxes) or GAMG; run with Debian's petsc4py.

Under ``mpiexec -n 2`` both ranks work; unknowns are renumbered so that the longest direction is
the slowest, before the clock starts. Geometric multigrid: a 2:1 nested box per level, trilinear
interpolation, Galerkin coarse matrices; a direction with an odd number of cells isn't coarsened.
"""

import resource

import numpy as np
from common import Clock, Problem, main, sweep
from petsc4py import PETSc
from scipy_free import interpolation_levels, renumbered

TOLERANCES = [1e-4, 1e-6, 3e-7, 1e-7, 3e-8, 1e-8, 1e-9, 1e-10, 1e-12]


def run(problem: Problem, options):
    comm = PETSc.COMM_WORLD
    rank, ranks = comm.getRank(), comm.getSize()
    order = renumbered(problem)  # new -> old node
    nodes = len(order)
    split = [nodes * k // ranks for k in range(ranks + 1)]
    mine = order[split[rank] : split[rank + 1]]
    local, size = 3 * len(mine), 3 * nodes
    new_of_old = np.empty(nodes, dtype=np.int64)
    new_of_old[order] = np.arange(nodes)
    indptr, indices, data = rows_of(problem, mine, new_of_old)
    right = PETSc.Vec().createMPI((local, size), bsize=3, comm=comm)
    right.setArray(problem.right.reshape(-1, 3)[mine].ravel())
    mine_of = {
        name: getattr(problem, name).reshape(-1, 3)[mine].ravel() for name in ("wanted", "solved")
    }
    largest = np.abs(problem.wanted).max()
    comm.barrier()

    matrix = PETSc.Mat().createAIJ(
        ((local, size), (local, size)), bsize=3, csr=(indptr, indices, data), comm=comm
    )
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    matrix.assemble()
    variants = []
    for name in options.get("variants", ["gamg", "gmg"]):
        if name.startswith("gmg") and not problem.meta.get("divisions"):
            continue
        comm.barrier()
        clock = Clock()
        ksp = PETSc.KSP().create(comm)
        ksp.setOptionsPrefix(name.replace("-", "_") + "_")  # options of one variant stay its own
        ksp.setType("cg")
        ksp.setNormType(PETSc.KSP.NormType.PRECONDITIONED)
        ksp.setOperators(matrix)
        if name.startswith("gamg"):
            set_gamg(ksp, matrix, problem, mine, name)
        else:
            set_gmg(ksp, problem, order, split, rank, name)
        ksp.setUp()
        ksp.getPC().setUpOnBlocks()
        comm.barrier()
        setup = clock.lap()
        u = right.duplicate()

        def solve(tolerance, ksp=ksp, u=u, name=name):
            ksp.setTolerances(rtol=tolerance, atol=1e-300, max_it=500)
            u.set(0.0)
            ksp.solve(right, u)
            if ksp.getConvergedReason() < 0 and rank == 0:
                print(f"{name}: diverged, reason {ksp.getConvergedReason()}", flush=True)
            return u.getArray(), ksp.getIterationNumber()

        def error(values, name):
            worst = np.inf
            if np.isfinite(values).all():
                worst = np.abs(values - mine_of[name]).max()
            vector = PETSc.Vec().createMPI((1, ranks), comm=comm)
            vector.setArray([worst])
            return float(vector.max()[1] / largest)

        problem.distance = error
        runs = sweep(problem, solve, options.get("tolerances", TOLERANCES))
        variants.append({"name": f"PETSc {name} x{ranks}", "setup_s": setup, "runs": runs})
        ksp.destroy()
    peak = PETSc.Vec().createMPI((1, ranks), comm=comm)
    peak.setArray([resource.getrusage(resource.RUSAGE_SELF).ru_maxrss])
    total = peak.sum()
    for variant in variants:
        variant["peak_kib"] = total
    return variants if rank == 0 else None


def rows_of(problem, mine, new_of_old):
    """Rows of the nodes ``mine``, columns renumbered, ascending in each row."""
    indptr, indices, data = problem.csr()
    rows = (3 * mine[:, None] + np.arange(3)).ravel()
    length = np.diff(indptr)[rows]
    start = np.concatenate([[0], np.cumsum(length)])
    place = np.repeat(indptr[rows] - start[:-1], length) + np.arange(start[-1])
    column = indices[place]
    column = 3 * new_of_old[column // 3] + column % 3
    row = np.repeat(np.arange(len(rows)), length)
    order = np.lexsort((column, row))
    return start.astype(np.int32), column[order].astype(np.int32), data[place][order]


def set_gamg(ksp, matrix, problem, mine, name):
    modes = problem.rigid_modes().reshape(-1, 3, 6)[mine].reshape(-1, 6)
    vectors = []
    for k in range(6):
        vector = matrix.createVecRight()
        vector.setArray(modes[:, k])
        vectors.append(vector)
    # orthonormal, as MatNullSpaceCreateRigidBody makes them
    for k, vector in enumerate(vectors):
        for other in vectors[:k]:
            vector.axpy(-vector.dot(other), other)
        vector.normalize()
    matrix.setNearNullSpace(PETSc.NullSpace().create(vectors=vectors, comm=matrix.comm))
    options = PETSc.Options(ksp.getOptionsPrefix())
    for key, value in {
        "pc_type": "gamg", "pc_gamg_type": "agg", "pc_gamg_threshold": 0.0 if "0" in name else 0.01,
        "pc_gamg_agg_nsmooths": 1, "mg_levels_ksp_type": "chebyshev",
        # block smoothers meet singular blocks on the coarse levels (aggregates of one node)
        "mg_levels_ksp_max_it": 2, "mg_levels_pc_type": "jacobi",
        "pc_mg_cycle_type": "w" if "-w" in name else "v",
        "pc_gamg_repartition": False, "pc_gamg_coarse_eq_limit": 1000,
    }.items():  # fmt: skip
        options.setValue(key, value)
    ksp.setFromOptions()


def set_gmg(ksp, problem, order, split, rank, name):
    comm = ksp.comm
    levels = interpolation_levels(problem, order, len(split) - 1)
    pc = ksp.getPC()
    pc.setType("mg")
    pc.setMGLevels(len(levels) + 1)
    options = PETSc.Options(ksp.getOptionsPrefix())
    for key, value in {
        "pc_mg_galerkin": "both", "mg_levels_ksp_type": "chebyshev", "mg_levels_ksp_max_it": 2,
        "mg_levels_pc_type": "sor" if "sor" in name else "pbjacobi",
        "pc_mg_cycle_type": "w" if "-w" in name else "v",
        "mg_coarse_ksp_type": "preonly",
        "mg_coarse_pc_type": "redundant" if len(split) > 2 else "cholesky",
        "mg_coarse_redundant_pc_type": "cholesky",
    }.items():  # fmt: skip
        options.setValue(key, value)
    for k, (bounds_fine, bounds_coarse, row_start, column, value) in enumerate(levels):
        first, last = bounds_fine[rank], bounds_fine[rank + 1]
        part = slice(row_start[first], row_start[last])
        start = (row_start[first : last + 1] - row_start[first]).astype(np.int64)
        # one node's weights serve its three unknowns
        length = np.repeat(np.diff(start), 3)
        indptr = np.concatenate([[0], np.cumsum(length)])
        node = np.repeat(np.arange(last - first), 3)
        place = np.repeat(start[node] - indptr[:-1], length) + np.arange(indptr[-1])
        axis = np.repeat(np.tile(np.arange(3), last - first), length)
        transfer = PETSc.Mat().createAIJ(
            ((3 * int(last - first), 3 * int(bounds_fine[-1])),
             (3 * int(bounds_coarse[rank + 1] - bounds_coarse[rank]), 3 * int(bounds_coarse[-1]))),
            bsize=3, comm=comm,
            csr=(indptr.astype(np.int32), (3 * column[part][place] + axis).astype(np.int32),
                 value[part][place]),
        )  # fmt: skip
        transfer.assemble()
        pc.setMGInterpolation(len(levels) - k, transfer)
    ksp.setFromOptions()


if __name__ == "__main__":
    main(run)
