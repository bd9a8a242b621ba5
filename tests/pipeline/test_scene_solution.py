"""What ``gs.solve`` imports: a model needs nothing of scenes, pictures or files."""

from __future__ import annotations

import subprocess
import sys

import pytest

MOST = 152
"""Modules of the package, of more than 450."""
PROBLEM = """
import sys
import numpy as np
import gpusim as gs

bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 3, 2))
fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
forces = gs.fem.face_force(bar, gs.mesh.select_faces(bar, name="x_max"), total=(1e4, 0, 0))
model = gs.Model(bar, [gs.Isotropic(210e9, 0.0)], fixed=fixed, forces=forces)
solution = gs.solve(model, backend=sys.argv[1], method="multigrid")
assert abs(solution.u[:, 0].max() - 1e4 / (210e9 * 0.01)) < 1e-9, solution.u[:, 0].max()
assert solution.backend == sys.argv[1]
print(*(name for name in sys.modules if name.startswith("gpusim")))
"""


@pytest.mark.parametrize("backend", ["numpy", "gpu"])
def test_a_model_is_solved_with_few_modules(backend: str, request: pytest.FixtureRequest) -> None:
    if backend == "gpu":
        request.getfixturevalue("device")
    done = subprocess.run(
        [sys.executable, "-c", PROBLEM, backend], capture_output=True, text=True, check=True
    )
    modules = done.stdout.split()
    assert len(modules) <= MOST
    assert not [name for name in modules if name.split(".")[1:2] in (["scene"], ["optics"])]


def test_the_package_alone_imports_nothing() -> None:
    code = "import gpusim, sys; print(*(name for name in sys.modules if name.startswith('gpusim')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(done.stdout.split()) == {"gpusim", "gpusim._version", "gpusim.public_names"}
