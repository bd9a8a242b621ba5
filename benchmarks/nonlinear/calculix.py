"""A model of hexahedra as a deck with NLGEOM, run by ``ccx``: the whole run is timed."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic, Model

Float = npt.NDArray[np.float64]


def calculix(model: Model) -> tuple[Float, float, float] | None:
    """Displacements (N,3), processor and wall seconds; None where ``ccx`` isn't installed."""
    program = shutil.which("ccx")
    if program is None:
        return None
    threads = {"OMP_NUM_THREADS": "2", "CCX_NPROC_EQUATION_SOLVER": "2"}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "model.inp").write_text("\n".join(_deck(model)) + "\n")
        before, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run([program, "model"], cwd=folder, capture_output=True, text=True,
                              env={**os.environ, **threads}, check=False)  # fmt: skip
        wall, after = time.perf_counter() - wall, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode != 0 or "*ERROR" in done.stdout:
            raise SystemExit(f"ccx ended with {done.returncode}: {done.stdout[-400:]}")
        rows = [line.split() for line in (Path(folder) / "model.dat").read_text().splitlines()]
    u = np.full(model.mesh.points.shape, np.nan)
    for row in rows:
        # the last increment's overwrite those of the ones before
        if len(row) == 4 and row[0].isdigit():
            u[int(row[0]) - 1] = [float(value) for value in row[1:]]
    used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return u, used, wall


def _deck(model: Model) -> list[str]:
    ((kind, _, cells),) = model.mesh.blocks()
    (material,) = model.materials
    assert kind == "hex8" and isinstance(material, Isotropic) and model.fixed is not None
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in
              enumerate(model.mesh.points, 1)]  # fmt: skip
    lines.append("*ELEMENT, TYPE=C3D8I, ELSET=BODY")
    lines += [f"{k}, " + ", ".join(map(str, cell)) for k, cell in enumerate(cells + 1, 1)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{material.E:.12e}, {material.nu:.12e}"]
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY"]
    lines += [f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in np.argwhere(model.fixed)]
    forces = model.load_cases[0]
    lines += ["*STEP, NLGEOM", "*STATIC", "1., 1.", "*CLOAD"]
    lines += [f"{node + 1}, {axis + 1}, {forces[node, axis]:.12e}" for node, axis in
              np.argwhere(forces != 0.0)]  # fmt: skip
    return [*lines, "*NODE PRINT, NSET=ALL", "U", "*END STEP"]
