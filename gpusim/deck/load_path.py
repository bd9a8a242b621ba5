"""The load path of a nonlinear deck: its steps as load steps of one analysis, one after the other.

Everything that acts goes straight from one state to the next, so that a time between two of them is
a mean of both: load factors are hat functions of time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.deck.step import Step
from gpusim.fem import Solution
from gpusim.fem.model.solution import load_path_results


@dataclass(frozen=True, eq=False)
class LoadPath:
    """Of the ``steps`` of a deck, from no load at the time 0."""

    steps: Sequence[Step]

    @property
    def states(self) -> list[Step]:
        """What acts, in the order of time: load cases of a model."""
        return [state for step in self.steps for state in (*step.path, step)]

    @property
    def factors(self) -> Float:
        """(K,L) of the load cases, at each increment of all steps."""
        wanted = np.concatenate([step.increments for step in self.steps])
        times = np.array([0.0, *(state.time for state in self.states)])
        hats = [np.interp(wanted, times, row) for row in np.eye(len(times))]
        return np.stack(hats[1:], axis=-1)

    def solutions(self, whole: Solution) -> tuple[Solution, ...]:
        """That of each step, of the ``whole`` path; where that ends early the last displacements
        found, without load steps."""
        wanted = np.cumsum([one.wanted for one in whole.steps])
        ends = np.cumsum([0, *(len(step.increments) for step in self.steps)])
        # points on the way past a limit point belong to what they lead to
        places = np.searchsorted(wanted, ends, side="left") + (ends > 0)
        found = []
        for (first, last), (begin, end) in zip(pairwise(places), pairwise(ends), strict=True):
            own, last = whole.steps[first:last], min(last, len(whole.steps))
            complete = bool(sum(one.wanted for one in own) == end - begin)
            message = "converged" if complete else whole.message
            results = load_path_results(own, whole.steps[last - 1])
            found.append(replace(whole, converged=complete, message=message, **results))
        return tuple(found)
