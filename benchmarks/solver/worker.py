"""One cold solve in this process: ``python -m benchmarks.solver.worker CASE JSON``; prints JSON."""

from __future__ import annotations

import json
import sys
from typing import Any

from benchmarks.solver.bandwidth import measure_operator
from benchmarks.solver.cases import CASES
from benchmarks.solver.problem import write_problem
from gpusim.bench.solver import solve_cold

__all__ = ["run"]


def run(name: str, options: dict[str, Any]) -> dict[str, Any]:
    """Solve one case as `gpusim.bench.solver.solve_cold` does; with ``export`` what is written
    holds the arrays for the peers, with ``operator`` its bandwidth is measured instead."""
    case = next(case for case in CASES if case.name == name)
    if options.get("operator"):
        return measure_operator(case, case.model())
    return solve_cold(case, options, write_problem if options.get("export") else None)


if __name__ == "__main__":
    print(json.dumps(run(sys.argv[1], json.loads(sys.argv[2]))), flush=True)
