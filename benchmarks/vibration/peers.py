"""Other programs on the same models: eigensolvers on our matrices, CalculiX from a deck."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix, save_npz

from gpusim.fem import Isotropic, Model

Float = npt.NDArray[np.float64]
_SCRIPT = Path(__file__).resolve().parents[1] / "peers" / "eigen.py"
_OWN = _SCRIPT.parent / ".venv" / "bin" / "python"
# solver of peers/eigen.py -> its interpreter: the one here, or as the variable says
EIGENSOLVERS = {
    "superlu": ("eigsh, SuperLU", "", sys.executable),
    "pardiso": ("eigsh, PARDISO", "GPUSIM_PEERS_PYTHON", str(_OWN)),
    "slepc": ("SLEPc, MUMPS", "SLEPC_PYTHON", "/usr/bin/python3"),
}
# C3D8I has masses of its bubble functions, which keep unknowns of their own there
_ELEMENT = {
    ("hex8", "incompatible"): "C3D8I",
    ("hex8", "full"): "C3D8",
    ("tet10", "full"): "C3D10",
}
# of the machine's memory: a peer that wants more fails by itself
_MEMORY = int(0.75 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))
_THREADS = {
    "OMP_NUM_THREADS": "2",
    "OPENBLAS_NUM_THREADS": "2",
    "MKL_NUM_THREADS": "2",
    "CCX_NPROC_EQUATION_SOLVER": "2",
}


@dataclass(frozen=True, eq=False)
class Run:
    """What a program found, or why it didn't; seconds of the processors and of the wall."""

    program: str
    values: Float | None = None
    processor: float = float("nan")
    wall: float = float("nan")
    failed: str = ""


def eigensolvers(
    stiffness: csr_matrix, mass: csr_matrix, count: int, names: Iterable[str], limit: float
) -> Iterator[Run]:
    """Frequencies (n,) Hz by each of `EIGENSOLVERS`, from the matrices on, within ``limit`` s."""
    with tempfile.TemporaryDirectory() as folder:
        for name, matrix in (("k", stiffness), ("m", mass)):
            save_npz(Path(folder) / f"{name}.npz", matrix, compressed=False)
        for name in names:
            yield _eigensolver(folder, name, count, limit)


def _bounded() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))


def _eigensolver(folder: str, name: str, count: int, limit: float) -> Run:
    program, variable, default = EIGENSOLVERS[name]
    python = os.environ.get(variable, default)
    environment = {**os.environ, **_THREADS}
    environment.pop("PYTHONPATH", None)
    try:
        done = subprocess.run(
            [python, str(_SCRIPT), folder, name, str(count)],
            timeout=limit,
            capture_output=True,
            text=True,
            env=environment,
            check=False,
            preexec_fn=_bounded,
        )
    except FileNotFoundError:
        return Run(program, failed="missing")
    except subprocess.TimeoutExpired:
        return Run(program, failed=f"stopped after {limit:g} s")
    if done.returncode != 0:
        said = done.stderr.strip().splitlines() or [f"ended with {done.returncode}"]
        return Run(program, failed=said[-1][:80])
    found = json.loads(done.stdout.strip().splitlines()[-1])
    frequencies = np.sqrt(np.array(found["values"])) / (2.0 * np.pi)
    return Run(program, frequencies, found["processor"], found["wall"])


def calculix_modes(model: Model, rules: Mapping[str, str], count: int, limit: float) -> Run:
    """Frequencies (n,) Hz, by a run of ``ccx``; with its own mass, see `gpusim.fem.mass_matrix`."""
    step = ["*FREQUENCY", str(count)]
    run, text = _calculix(model, rules, step, limit)
    rows = re.findall(r"^\s+\d+\s+\S+\s+\S+\s+(\S+)\s+\S+\s*$", text, re.M)
    return Run(run.program, np.array(rows[:count], dtype=np.float64) if rows else None,
               run.processor, run.wall, run.failed)  # fmt: skip


def calculix_steps(
    model: Model, rules: Mapping[str, str], step: float, count: int, limit: float
) -> Run:
    """Displacements (N,3) after ``count`` steps of the trapezoidal rule under the load, which acts
    at once."""
    forces = model.load_cases[0]
    lines = ["*AMPLITUDE, NAME=AT-ONCE", "0., 1., 1e9, 1."]
    history = [f"*DYNAMIC, DIRECT, ALPHA=0.\n{step:.12e}, {step * count:.12e}",
               "*CLOAD, AMPLITUDE=AT-ONCE"]  # fmt: skip
    history += [f"{node + 1}, {axis + 1}, {forces[node, axis]:.12e}" for node, axis in
                np.argwhere(forces != 0.0)]  # fmt: skip
    history += [f"*NODE PRINT, NSET=ALL, FREQUENCY={count}", "U"]
    run, text = _calculix(model, rules, history, limit, lines, f"*STEP, INC={10 * count}")
    if run.failed:
        return run
    rows = text.rpartition(" displacements ")[2].splitlines()[2:][: model.mesh.node_count]
    return Run(run.program, np.loadtxt(rows, usecols=(1, 2, 3)), run.processor, run.wall)


def _calculix(
    model: Model, rules: Mapping[str, str], step: Sequence[str], limit: float,
    before: Sequence[str] = (), begin: str = "*STEP",
) -> tuple[Run, str]:  # fmt: skip
    """A run of one step, and the text of its results."""
    ((kind, _, _),) = model.mesh.blocks()
    element = _ELEMENT[kind, rules[kind]]
    name, program = f"CalculiX {element}", shutil.which("ccx")
    if program is None:
        return Run(name, failed="missing"), ""
    with tempfile.TemporaryDirectory() as folder:
        lines = [*_model_lines(model, element), *before, begin, *step, "*END STEP"]
        (Path(folder) / "model.inp").write_text("\n".join(lines) + "\n")
        used, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        try:
            done = subprocess.run(
                [program, "model"],
                cwd=folder,
                capture_output=True,
                text=True,
                env={**os.environ, **_THREADS},
                timeout=limit,
                check=False,
                preexec_fn=_bounded,
            )
        except subprocess.TimeoutExpired:
            return Run(name, failed=f"stopped after {limit:g} s"), ""
        wall, now = time.perf_counter() - wall, resource.getrusage(resource.RUSAGE_CHILDREN)
        if done.returncode != 0 or "*ERROR" in done.stdout:
            return Run(name, failed=f"ended with {done.returncode}"), ""
        text = (Path(folder) / "model.dat").read_text()
    seconds = now.ru_utime - used.ru_utime + now.ru_stime - used.ru_stime
    return Run(name, None, seconds, wall), text


def _model_lines(model: Model, element: str) -> list[str]:
    ((_, _, cells),) = model.mesh.blocks()
    (material,) = model.materials
    assert isinstance(material, Isotropic) and model.fixed is not None
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.12e}, {y:.12e}, {z:.12e}" for k, (x, y, z) in
              enumerate(model.mesh.points, 1)]  # fmt: skip
    lines.append(f"*ELEMENT, TYPE={element}, ELSET=BODY")
    lines += [f"{k}, " + ", ".join(map(str, cell)) for k, cell in enumerate(cells + 1, 1)]
    lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{material.E:.12e}, {material.nu:.12e}",
              "*DENSITY", f"{material.density:.12e}",
              "*SOLID SECTION, ELSET=BODY, MATERIAL=M", "*BOUNDARY"]  # fmt: skip
    lines += [f"{node + 1}, {axis + 1}, {axis + 1}" for node, axis in np.argwhere(model.fixed)]
    return lines
