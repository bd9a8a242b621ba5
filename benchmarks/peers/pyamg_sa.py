"""PyAMG: smoothed aggregation with the six rigid-body modes, conjugate gradients."""

import pyamg
from common import Clock, main, sweep
from scipy.sparse import bsr_matrix


def run(problem, options):
    matrix = problem.scipy_csr()
    modes = problem.rigid_modes()
    clock = Clock()
    hierarchy = pyamg.smoothed_aggregation_solver(
        bsr_matrix(matrix, blocksize=(3, 3)), B=modes, max_coarse=100,
        strength=("symmetric", {"theta": 0.08}),
        presmoother=("block_gauss_seidel", {"sweep": "symmetric"}),
        postsmoother=("block_gauss_seidel", {"sweep": "symmetric"}),
    )  # fmt: skip
    setup = clock.lap()

    def solve(tolerance):
        residuals = []
        u = hierarchy.solve(problem.right, tol=tolerance, accel="cg", maxiter=500,
                            residuals=residuals)  # fmt: skip
        return u, len(residuals) - 1

    runs = sweep(problem, solve, options.get("tolerances", [1e-4, 1e-6, 1e-8, 1e-10, 1e-12]))
    return [{"name": f"PyAMG {pyamg.__version__} SA", "setup_s": setup, "runs": runs}]


if __name__ == "__main__":
    main(run)
