"""The solution of a scene's bodies as it is kept in the output folder."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.fem import Solution

__all__ = ["Solved"]


@dataclass(frozen=True, eq=False)
class Solved:
    """Displacements at load factor 1 per body, (N, 3) float64 m, and how the solves ended."""

    u: tuple[npt.NDArray[np.float64], ...]
    unknowns: int
    iterations: int
    converged: bool
    error_estimate: float
    residuals: tuple[float, ...]
    facts: dict[str, str]

    @staticmethod
    def of(solutions: Sequence[Solution]) -> Solved:
        """Bodies in order; the summary adds unknowns and takes the worst of the rest."""
        worst = max(solutions, key=lambda s: s.iterations)
        balance = max(s.energy_balance for s in solutions)
        facts = {
            "preconditioner": worst.preconditioner,
            "solver arithmetic": worst.real,
            "distinct element matrices": str(sum(s.element_classes for s in solutions)),
            "energy balance": f"{balance:.1e}",
        }
        for part, seconds in worst.timings.items():
            facts[f"solver: {part}"] = f"{seconds:.2f} s"
        return Solved(
            tuple(s.u for s in solutions),
            sum(s.unknowns for s in solutions),
            worst.iterations,
            all(s.converged for s in solutions),
            max(s.error_estimate for s in solutions),
            tuple(float(r) for r in worst.residuals[:, 0]) if worst.residuals.size else (),
            facts,
        )

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """What ``np.savez`` keeps: ``u<body>`` and a JSON summary."""
        summary = {
            "unknowns": self.unknowns,
            "iterations": self.iterations,
            "converged": self.converged,
            "error_estimate": self.error_estimate,
            "residuals": self.residuals,
            "facts": self.facts,
            "bodies": len(self.u),
        }
        arrays: dict[str, npt.NDArray[Any]] = {f"u{i}": u for i, u in enumerate(self.u)}
        return {**arrays, "summary": np.array(json.dumps(summary))}

    @staticmethod
    def from_arrays(arrays: dict[str, npt.NDArray[Any]]) -> Solved:
        """The inverse of `arrays`."""
        summary = json.loads(str(arrays["summary"]))
        count = summary.pop("bodies")
        summary["residuals"] = tuple(summary["residuals"])
        return Solved(u=tuple(arrays[f"u{i}"] for i in range(count)), **summary)
