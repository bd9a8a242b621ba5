"""Solutions: every element type, directly and by multigrid, by the device and by NumPy."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

import gpusim as gs
from benchmarks.identical_cases.arrays import Arrays, Case, fields
from gpusim import fem, mesh

METAL = gs.Isotropic(70e9, 0.33, 2700.0, 2.3e-5)
RUBBER = gs.Isotropic(1e6, 0.499)
SIZE = (0.2, 0.11, 0.07)


def bent(shape: mesh.Mesh, material: gs.Isotropic = METAL) -> gs.Model:
    """A body that is held at its least x and pulled askew at its greatest, and heavy."""
    x = shape.points[:, 0]
    fixed = np.repeat(x[:, None] <= x.min() + 1e-9, 3, axis=1)
    force = fem.nodal_force(shape, np.flatnonzero(x >= x.max() - 1e-9), [30.0, -70.0, 110.0])
    weight = fem.body_force(shape, 2700.0, [0.0, 0.0, -9.81])
    return gs.Model(shape, [material], fixed, np.stack([force, weight]))


def skewed(shape: mesh.Mesh) -> mesh.Mesh:
    """The same cells, none like another."""
    points = shape.points.copy()
    span = points.max(axis=0)
    points[:, 1] += 0.07 * span[1] * np.sin(5.0 * points[:, 0] / span[0] + 1.0)
    points[:, 2] *= 1.0 + 0.2 * points[:, 0] / span[0] + 0.1 * points[:, 1] / span[1]
    return mesh.Mesh(points, shape.cells)


MESHES: dict[str, Callable[[], mesh.Mesh]] = {
    "hex8-lattice": lambda: mesh.box(SIZE, (14, 12, 10)),
    "hex8": lambda: skewed(mesh.box(SIZE, (14, 12, 10))),
    "hex8-hole": lambda: mesh.plate_with_hole(0.2, 0.1, 0.01, 0.03, around=16, radial=4),
    "hex20-lattice": lambda: mesh.quadratic(mesh.box(SIZE, (7, 6, 5))),
    "hex20": lambda: mesh.quadratic(skewed(mesh.box(SIZE, (7, 6, 5)))),
    "tet4": lambda: mesh.split(skewed(mesh.box(SIZE, (9, 8, 7)))),
    "tet10": lambda: mesh.quadratic(mesh.split(skewed(mesh.box(SIZE, (6, 5, 4))))),
}


def solved(
    name: str, material: gs.Isotropic = METAL, real: str | None = None, **options: Any
) -> Arrays:
    """Displacements and reactions; ``real``: of a device of its own."""
    device = gs.Device(real=real) if real else None
    return fields(gs.solve(bent(MESHES[name](), material), device, tolerance=1e-5, **options),
                  "u", "reactions")  # fmt: skip


def stresses() -> Arrays:
    """Stresses of a thermal load, and masses."""
    model = bent(MESHES["hex8-hole"]())
    rise = 40.0 + 300.0 * model.mesh.points[:, 0]
    forces = fem.thermal(model.mesh, [METAL], rise)
    solution = gs.solve(gs.Model(model.mesh, [METAL], model.fixed, forces))
    found = fem.stress(model, solution.u, temperature=rise)
    mass = np.asarray(fem.lumped_mass(model))
    return {"mass": mass, **fields(solution, "u"), **fields(found, "nodal", "cell", "error")}


CASES: dict[str, Case] = {
    **{f"fem/{name}-direct": partial(solved, name, method="direct") for name in MESHES},
    **{f"fem/{name}-{backend}": partial(solved, name, method="multigrid", backend=backend)
       for name in MESHES for backend in ("numpy", "gpu")},
    **{f"fem/incompressible-{name}-{backend}":
       partial(solved, name, RUBBER, backend=backend, method="multigrid")
       for name in ("hex8", "tet10") for backend in ("numpy", "gpu")},
    "fem/double-single": partial(solved, "hex8", real="double_single", method="multigrid"),
    "fem/stresses": stresses,
}  # fmt: skip
