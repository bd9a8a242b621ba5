"""A model of hexahedra as a deck with NLGEOM, run by ``ccx``: the whole run is timed."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from gpusim.fem import J2, Isotropic, Model, Voce

Float = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Run:
    """Displacements (N,3) at the end, seconds of the processors and of the wall."""

    u: Float
    processor: float
    wall: float


def calculix(model: Model, increment: float = 1.0) -> Run | None:
    """A run that begins with a share of the load, the first ``increment``; None without ``ccx``."""
    program = shutil.which("ccx")
    if program is None:
        return None
    threads = {"OMP_NUM_THREADS": "2", "CCX_NPROC_EQUATION_SOLVER": "2"}
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "model.inp").write_text("\n".join(_deck(model, increment)) + "\n")
        before, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run([program, "model"], cwd=folder, capture_output=True, text=True,
                              env={**os.environ, **threads}, check=False)  # fmt: skip
        wall, after = time.perf_counter() - wall, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode != 0 or "*ERROR" in done.stdout:
            raise SystemExit(f"ccx ended with {done.returncode}: {done.stdout[-400:]}")
        text = (Path(folder) / "model.dat").read_text()
    # the last increment's
    rows = text.rpartition(" displacements ")[2].splitlines()[2:][: model.mesh.node_count]
    used = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return Run(np.loadtxt(rows, usecols=(1, 2, 3)), used, wall)


def _deck(model: Model, increment: float) -> list[str]:
    ((kind, _, cells),) = model.mesh.blocks()
    (material,) = model.materials
    elastic = material.elastic if isinstance(material, J2) else material
    assert kind == "hex8" and isinstance(elastic, Isotropic) and model.fixed is not None
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in
              enumerate(model.mesh.points, 1)]  # fmt: skip
    lines.append("*ELEMENT, TYPE=C3D8I, ELSET=BODY")
    lines += [f"{k}, " + ", ".join(map(str, cell)) for k, cell in enumerate(cells + 1, 1)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{elastic.E:.12e}, {elastic.nu:.12e}"]
    lines += _hardening(material)
    lines += ["*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY"]
    lines += [f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in np.argwhere(model.fixed)]
    forces = model.load_cases[0]
    lines += ["*STEP, NLGEOM, INC=1000", "*STATIC", f"{increment}, 1.", "*CLOAD"]
    lines += [f"{node + 1}, {axis + 1}, {forces[node, axis]:.12e}" for node, axis in
              np.argwhere(forces != 0.0)]  # fmt: skip
    return [*lines, "*NODE PRINT, NSET=ALL, FREQUENCY=1000", "U", "*END STEP"]


def _hardening(material: object) -> list[str]:
    """Voce's curve by 200 pairs up to a plastic strain of 0.4."""
    if not isinstance(material, J2):
        return []
    assert isinstance(material.hardening, Voce)
    voce, p = material.hardening, 0.4 * np.linspace(0.0, 1.0, 201) ** 2
    stress = material.yield_stress + voce.linear * p
    stress += (voce.saturation - material.yield_stress) * (1.0 - np.exp(-voce.rate * p))
    return [
        "*PLASTIC",
        *(f"{one:.12e}, {strain:.12e}" for one, strain in zip(stress, p, strict=True)),
    ]
