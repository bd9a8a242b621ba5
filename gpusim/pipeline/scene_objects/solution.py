"""The solution of a scene's bodies, as it is kept and told."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float, Int
from gpusim.motion import Superposed
from gpusim.report import SolutionSummary

if TYPE_CHECKING:
    from gpusim.fem import Model, Solution

_ARRAYS = ("u", "reactions", "applied")


@dataclass(frozen=True, eq=False)
class SceneSolution:
    """Displacements per body, (L, N, 3) float64 m, L its load groups, and how the solves ended.

    ``reactions``: per body (L, S, 3) the force of each support (N), ``applied``: (L, 3) the sum of
    the loads.
    """

    u: tuple[Float, ...]
    reactions: tuple[Float, ...]
    applied: tuple[Float, ...]
    unknowns: int
    iterations: int
    converged: bool
    error_estimate: float
    residuals: tuple[float, ...]
    facts: dict[str, str]
    energy_balance: float
    warnings: tuple[str, ...]

    @staticmethod
    def of(
        solutions: Sequence[Solution], models: Sequence[Model], held: Sequence[Int]
    ) -> SceneSolution:
        """Bodies in order; the summary adds unknowns and takes the worst of the rest.

        ``held`` (N, 3) per body is the number of the support that holds a degree of freedom.
        """
        worst = max(solutions, key=lambda s: s.iterations)
        balance = max(s.energy_balance for s in solutions)
        facts = {
            "method": worst.method,
            "choices of the solver": "; ".join(worst.reasons),
            "solver arithmetic": worst.real,
            "distinct element matrices": str(sum(s.element_classes for s in solutions)),
            "energy balance": f"{balance:.1e}",
        }
        return SceneSolution(
            tuple(_cases(s.u) for s in solutions),
            tuple(
                support_forces(_cases(s.reactions), model, own)
                for s, model, own in zip(solutions, models, held, strict=True)
            ),
            tuple(model.load_cases.sum(axis=1) for model in models),
            sum(s.unknowns for s in solutions),
            worst.iterations,
            all(s.converged for s in solutions),
            max(s.error_estimate for s in solutions),
            tuple(float(r) for r in worst.residuals[:, 0]) if worst.residuals.size else (),
            facts,
            balance,
            tuple(dict.fromkeys(text for s in solutions for text in s.warnings)),
        )

    def superposed(self, body: int) -> Superposed:
        """The motion of a body."""
        return Superposed(self.u[body], self.reactions[body])

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """What ``np.savez`` keeps: ``u<body>`` and the like, and a JSON summary."""
        names = [one.name for one in fields(self) if one.name not in _ARRAYS]
        summary = {name: getattr(self, name) for name in names} | {"bodies": len(self.u)}
        arrays: dict[str, npt.NDArray[Any]] = {}
        for name in _ARRAYS:
            arrays |= {f"{name}{i}": array for i, array in enumerate(getattr(self, name))}
        return {**arrays, "summary": np.array(json.dumps(summary))}

    @staticmethod
    def from_arrays(arrays: Mapping[str, npt.NDArray[Any]]) -> SceneSolution:
        """The inverse of `arrays`. Raises KeyError, TypeError or ValueError for damage."""
        summary = json.loads(str(arrays["summary"]))
        count = summary.pop("bodies")
        for name in ("residuals", "warnings"):
            summary[name] = tuple(summary[name])
        for name in _ARRAYS:
            summary[name] = tuple(arrays[f"{name}{i}"] for i in range(count))
        return SceneSolution(**summary)

    def said(self) -> dict[str, Any]:
        """What a report says of it, as plain data."""
        return {
            "summary": asdict(self.summary()),
            "residuals": self.residuals,
            "energy_balance": self.energy_balance,
            "reactions": [values.tolist() for values in self.reactions],
            "applied": [values.tolist() for values in self.applied],
        }

    def summary(self) -> SolutionSummary:
        """How the solve ended, for the report."""
        ended = self.iterations, self.converged, self.error_estimate
        return SolutionSummary(self.unknowns, *ended, self.facts["method"])

    def check(self, groups: Sequence[int], nodes: Sequence[int] | None) -> None:
        """Raises ValueError if this isn't of bodies with so many load groups and ``nodes`` (None:
        not known)."""
        if len(self.u) != len(groups):
            raise ValueError(f"{len(self.u)} bodies, expected {len(groups)}")
        for i, cases in enumerate(groups):
            u, reactions, applied = self.u[i], self.reactions[i], self.applied[i]
            wanted = (cases, u.shape[1] if nodes is None and u.ndim == 3 else (nodes or [0])[i], 3)
            if u.shape != wanted:
                raise ValueError(f"displacements of shape {u.shape}, expected {wanted}")
            if reactions.ndim != 3 or reactions.shape[::2] != (cases, 3):
                raise ValueError(f"reactions of shape {reactions.shape}")
            if applied.shape != (cases, 3):
                raise ValueError(f"loads of shape {applied.shape}")
            for values in (u, reactions, applied):
                if values.dtype != np.float64 or not np.isfinite(values).all():
                    raise ValueError("values that are no finite float64")


def solver_seconds(solutions: Sequence[Solution]) -> dict[str, str]:
    """How long the parts of the longest solve took, for the report of the run that solved."""
    worst = max(solutions, key=lambda s: s.iterations)
    return {f"solver: {part}": f"{seconds:.2f} s" for part, seconds in worst.timings.items()}


def _cases(values: Float) -> Float:
    """(L,N,3), also for one load case."""
    return values if values.ndim == 3 else values[None]


def support_forces(reactions: Float, model: Model, held: Int) -> Float:
    """(L,S,3) reactions (L,N,3) added up over the degrees of freedom of each support, which
    ``held`` (N,3) numbers (-1: none).

    S ends with the last support that holds something.
    """
    # whoever reads a solution from its file needs no solver
    from gpusim.fem.model.elimination import eliminate

    if (resolved := eliminate(model)) is not None:
        # what ties do to held nodes isn't the supports'
        reactions = resolved.forces(reactions)
    count = int(held.max()) + 1
    sums = np.zeros((len(reactions), count, 3))
    for axis in range(3):
        mine = held[:, axis] >= 0
        for case, values in enumerate(reactions):
            sums[case, :, axis] = np.bincount(held[mine, axis], values[mine, axis], minlength=count)
    return sums
