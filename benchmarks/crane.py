"""Convergence of the crane's deflection, and time per solve: ``python -m benchmarks.crane``.

Prints one line per mesh: elements, unknowns, tip deflection of both load cases of the paper
(Zdziebko & Holak, Sensors 2021, 21(18), 6046), the change to the mesh before, iterations, seconds.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from gpusim.fem import Isotropic, Model, face_force, solve
from gpusim.mesh import crane, set_faces

STEEL = Isotropic(210e9, 0.3, 7850.0)
# element size along the members (m), elements through the thickness and across the width
MESHES = ((0.012, 1, 2), (0.006, 2, 4), (0.003, 2, 6), (0.002, 3, 8))


def crane_model(size: float, through: int, across: int) -> Model:
    """13 N down, and 192 N sideways with it, over the top face of the last 108 mm."""
    mesh = crane(element_size=size, through=through, across=across)
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.node_sets["foot"]] = True
    top = set_faces(mesh, mesh.face_sets["load"])
    loads = [face_force(mesh, top, total) for total in ((0.0, 0.0, -13.0), (0.0, 192.0, -13.0))]
    return Model(mesh, [STEEL], fixed=fixed, forces=np.stack(loads))


def convergence(levels: int, backend: str, formulation: str) -> None:
    """Print the table."""
    print(f"crane, hex8 {formulation}, backend {backend}: tip = mean over the end face x = 597 mm")
    print("elements unknowns   13 N: u_z mm   change   13+192 N: |u| mm   change  its  estimate  s")
    before = np.array([np.nan, np.nan])
    for size, through, across in MESHES[:levels]:
        model = crane_model(size, through, across)
        start = time.perf_counter()
        solution = solve(model, backend=backend, formulation=formulation)
        seconds = time.perf_counter() - start
        tip = model.mesh.points[:, 0] >= model.mesh.bounds[1, 0] - 1e-9
        mean = solution.u[:, tip].mean(axis=1) * 1e3
        values = np.array([-mean[0, 2], np.linalg.norm(mean[1])])
        change = values / before - 1.0
        state = "" if solution.converged else f"  NOT CONVERGED: {solution.message}"
        print(
            f"{model.mesh.cell_count:8d} {solution.unknowns:8d} {values[0]:14.5f} {change[0]:8.1e}"
            f" {values[1]:18.4f} {change[1]:8.1e} {solution.iterations:4d}"
            f"  {solution.error_estimate:.1e} {seconds:6.2f}{state}",
            flush=True,
        )
        before = values


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--levels", type=int, default=3, choices=range(1, len(MESHES) + 1))
    parser.add_argument("--backend", default="gpu", choices=["gpu", "numpy"])
    parser.add_argument("--formulation", default="incompatible")
    arguments = parser.parse_args()
    convergence(arguments.levels, arguments.backend, arguments.formulation)


if __name__ == "__main__":
    main()
