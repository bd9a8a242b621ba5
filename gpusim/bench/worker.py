"""One cold solve in this process: ``python -m gpusim.bench.worker CASE JSON``; prints JSON.

The clock runs around `gpusim.fem.solve` alone and holds everything it does: checks, assembly,
set-up, opening the device, compiling kernels, iterations, reactions. Python's imports and the
making of the mesh come before.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.bench.solver_cases import CASES, Case
from gpusim.errors import GpusimError
from gpusim.fem import Model, solve

__all__ = ["solve_cold"]

Float = npt.NDArray[np.float64]
Export = Callable[[Case, Model, Float, Path], None]


def solve_cold(case: Case, options: dict[str, Any], export: Export | None = None) -> dict[str, Any]:
    """Solve one case; times, iterations, memory and the error as plain values.

    ``options``: tolerance; load_cases (1 or 2); backend; ``reference`` a folder whose ``u.npy``
    the result is compared with; ``write`` a folder for ``u.npy`` and what ``export`` writes.
    """
    model = case.model(options.get("load_cases", 1))
    tolerance = options.get("tolerance", 1e-6)
    before = _reset_peak()
    start = time.perf_counter()
    try:
        solution = solve(
            model,
            tolerance=tolerance,
            formulation={case.kind: case.rule},
            backend=options.get("backend", "auto"),
        )
    except GpusimError as error:
        return {"failed": f"{type(error).__name__}: {error}"}
    seconds = time.perf_counter() - start
    peak = _peak()
    first = solution.u if solution.u.ndim == 2 else solution.u[0]
    result: dict[str, Any] = {
        "tolerance": tolerance,
        "seconds": seconds,
        "timings": dict(solution.timings),
        "iterations": solution.iterations,
        "converged": solution.converged,
        "message": solution.message,
        "stated": solution.error_estimate,
        "path": f"{solution.method}, {solution.backend}, {solution.real}",
        "unknowns": solution.unknowns,
        "before_kib": before,
        "peak_kib": peak,
    }
    if "reference" in options:
        wanted = np.load(Path(options["reference"]) / "u.npy")
        result["error"] = float(np.abs(first - wanted).max() / np.abs(wanted).max())
    if "write" in options:
        folder = Path(options["write"])
        folder.mkdir(parents=True, exist_ok=True)
        if export is not None:
            export(case, model, first, folder)
        # last, so that a folder with u.npy is complete
        np.save(folder / "u.npy", first)
    return result


def _reset_peak() -> int:
    """Memory in use now, KiB; the kernel's high-water mark starts anew from here."""
    try:
        Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    except OSError:
        return 0  # the peak then counts from the start of the process
    return _status("VmRSS:")


def _peak() -> int:
    return _status("VmHWM:") or resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def _status(key: str) -> int:
    try:
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in lines if line.startswith(key)), 0)


if __name__ == "__main__":
    chosen = next(case for case in CASES if case.name == sys.argv[1])
    print(json.dumps(solve_cold(chosen, json.loads(sys.argv[2]))), flush=True)
