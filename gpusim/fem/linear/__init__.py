"""Linear solvers: prepared for a matrix, solved with, and updated where its values change.

In the order in which data passes:

- `solve_plan`: Every choice of a solve, made once before work, each with its reason.
- `direct_solver`: Direct solvers: factors of K, and displacements refined with float64 residuals.
- `multigrid_solver`: Conjugate gradients preconditioned by multigrid, on the host.
- `device_solver`: Conjugate gradients preconditioned by multigrid, on a device.
- `pressure_solver`: Displacements and pressures together, for nearly incompressible materials.
- `tangent_solver`: Tangents solved in Newton's method: the solver of the first one is updated for
  all others.
- `shifted_solver`: Solvers of K + s M: factors, or one multigrid cycle, as the plan of a static
  solve says.
- `linear_solver`: Linear solvers: what all of them can, and a system solved by them as a plan
  says.
"""
