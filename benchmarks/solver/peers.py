"""Other solvers on the same problem, each a script of ``benchmarks/peers`` in its own process.

See ``benchmarks/peers/README.md``. A peer that is missing, or fails, is reported as such.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gpusim.bench.solver_cases import Case

__all__ = ["EXACT", "PEERS", "SCRIPTS", "Peer", "run_peer"]

SCRIPTS = Path(__file__).resolve().parents[1] / "peers"
_DEBIAN_PETSC = "/usr/lib/petscdir/petsc3.18/x86_64-linux-gnu-real"


@dataclass(frozen=True)
class Peer:
    """``most`` unknowns that are tried, by family of cases ("" for all others)."""

    name: str
    script: str
    options: Mapping[str, Any] = field(default_factory=dict)
    most: Mapping[str, int] = field(default_factory=dict)
    system_python: bool = False
    ranks: int = 1

    def takes(self, case: Case, unknowns: int) -> bool:
        """Whether the peer is tried on this case."""
        return unknowns <= self.most.get(case.family, self.most.get("", 1_200_000))


_PETSC = {"variants": ["gmg", "gmg-w", "gamg"]}
_SOLID = {"": 130_000, "beam": 400_000}
# not a peer: writes the exact solution of the given matrix, for bodies whose matrix rounding shows
EXACT = Peer("exact solution of the matrix", "direct.py", {"solver": "exact"})
PEERS = (
    Peer("PETSc", "petsc.py", _PETSC, system_python=True),
    Peer("PETSc x2", "petsc.py", _PETSC, system_python=True, ranks=2),
    Peer("PARDISO", "direct.py", {"solver": "pardiso"}, {"": 130_000, "beam": 1_200_000}),
    Peer("CHOLMOD", "direct.py", {"solver": "cholmod"}, _SOLID),
    Peer("NGSolve", "direct.py", {"solver": "ngsolve"}, _SOLID),
    Peer("PyAMG", "pyamg_sa.py", {}, {"": 130_000}),
    Peer("CalculiX", "calculix.py", {"solver": "SPOOLES"}, {"": 30_000, "beam": 350_000}),
    Peer("CalculiX iterative", "calculix.py", {"solver": "ITERATIVE CHOLESKY"},
         {"": 400_000, "beam": 10_000, "cube-nu4999": 0}),
)  # fmt: skip


def run_peer(
    peer: Peer, problem: Path, limit: float, scripts: Path = SCRIPTS
) -> Iterator[dict[str, Any]]:
    """The peer's variants: {"name", "setup_s", "runs", "peak_kib"}, or {"name", "failed"}."""
    python = _interpreter(peer, scripts)
    command = [python, str(scripts / peer.script), str(problem), json.dumps(dict(peer.options))]
    environment = dict(os.environ)
    if peer.system_python:
        environment.setdefault("PETSC_DIR", _DEBIAN_PETSC)
        environment.pop("PYTHONPATH", None)
        environment["OMP_NUM_THREADS"] = "1"
    if peer.ranks > 1:
        command = ["mpiexec", "-n", str(peer.ranks), *command]
        environment |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    start = time.perf_counter()
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=limit, env=environment, cwd=scripts
        )
    except FileNotFoundError as error:
        yield {"name": peer.name, "failed": f"missing: {error.filename}"}
        return
    except subprocess.TimeoutExpired:
        yield {"name": peer.name, "failed": f"stopped after {time.perf_counter() - start:.0f} s"}
        return
    lines = [line for line in done.stdout.splitlines() if line.startswith('{"variants"')]
    if done.returncode != 0 or not lines:
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        # mpiexec ends with lines of its own
        errors = [line for line in said if "Error" in line] or said
        why = errors[-1] if errors else f"ended with {done.returncode}"
        missing = "No module named" in why
        yield {"name": peer.name, "failed": f"missing: {why}" if missing else why[:200]}
        return
    result = json.loads(lines[-1])
    for variant in result["variants"]:
        variant.setdefault("peak_kib", result["peak_kib"])
        yield variant


def _interpreter(peer: Peer, scripts: Path) -> str:
    if peer.system_python:
        return os.environ.get("GPUSIM_PETSC_PYTHON", "/usr/bin/python3")
    own = scripts / ".venv" / "bin" / "python"
    return os.environ.get("GPUSIM_PEERS_PYTHON") or (str(own) if own.is_file() else sys.executable)
