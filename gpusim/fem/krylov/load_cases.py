"""Load cases iterated each by itself, beside one another where that gains.

What a case takes doesn't depend on the others then, nor do its numbers, however many processors
there are. Short array operations gain little from threads (the interpreter lock), so cases are
shared out to copies of the process (`gpusim.parallel.processes`): as long as there is a processor
for it, a second case costs little more than its memory.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.system import System
from gpusim.fem.krylov.outer_iteration import Outcome
from gpusim.parallel.processes import in_copies

__all__ = ["Progress", "each_case"]

Float = npt.NDArray[np.float64]
Progress = Callable[[int, float], None]

# a copy of the process takes some 5 ms, the iterations of this many unknowns several times that
_LEAST_UNKNOWNS = 5_000


def each_case(
    solve: Callable[[System, Float | None, Progress | None], Outcome],
    system: System,
    start: Float | None,
    progress: Progress | None,
) -> Outcome:
    """``solve`` for each load case of the system, from ``start`` (L,N,3), on the host.

    ``progress`` hears of the cases that are solved in this process. The first case's error is
    raised, if several have one.
    """
    cases = len(system.right)
    if cases == 1:
        return solve(system, start, progress)
    done, here = 0, os.getpid()

    def one(case: int) -> Outcome:
        nonlocal done
        before = done

        def report(iterations: int, error: float) -> None:
            assert progress is not None
            progress(before + iterations, error)

        begin = None if start is None else start[case : case + 1]
        # in a copy there is nobody to hear: what a program does there would be lost, or done twice
        hears = progress is not None and os.getpid() == here
        outcome = solve(system.case(case), begin, report if hears else None)
        done += outcome.iterations
        return outcome

    if int(system.free.sum()) < _LEAST_UNKNOWNS:
        return _joined([one(case) for case in range(cases)])
    return _joined(in_copies(one, cases))


def _joined(outcomes: Sequence[Outcome]) -> Outcome:
    """All cases in one, told about as the worst of them: the residuals of those that took fewer
    iterations stay as they ended."""
    worst = max(outcomes, key=lambda one: (not one.converged, one.error_estimate))
    most = max(len(one.residuals) for one in outcomes)
    forces = [one.forces for one in outcomes if one.forces is not None]
    return Outcome(
        np.concatenate([one.u for one in outcomes]),
        all(one.converged for one in outcomes),
        worst.error_estimate,
        max(one.iterations for one in outcomes),
        np.concatenate([_stretched(one.residuals, most) for one in outcomes], axis=1),
        worst.message,
        np.concatenate(forces) if len(forces) == len(outcomes) else None,
    )


def _stretched(residuals: Float, count: int) -> Float:
    """(k,1) to (count,1) by the last line."""
    if len(residuals) in (0, count):
        return residuals if len(residuals) else np.zeros((count, 1))
    return np.concatenate([residuals, np.repeat(residuals[-1:], count - len(residuals), axis=0)])
