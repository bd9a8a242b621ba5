"""Increments of a step: the times at which equilibrium is looked for."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.mesh.formats.abaqus.cards import Card, number, whole

_SAME = 1e-9  # of a step's period
# by which CalculiX lengthens increments that converge well
_GROWTH = 1.5


@dataclass(frozen=True)
class Increments:
    """Of *STATIC: the ``first`` one, the ``period`` of the step, the ``longest`` one; ``equal``:
    none is longer than the first (DIRECT); else so many are ``alike`` before they grow. At most so
    ``many``, INC of *STEP, which also says whether loads without an amplitude are there
    ``at_once``, by the end of the first increment."""

    first: float = 1.0
    period: float = 1.0
    longest: float = inf
    equal: bool = False
    many: int = 100
    at_once: bool = False
    alike: int = 1

    @classmethod
    def read(cls, static: Card, step: Card) -> Increments:
        """Of the cards of a step. Raises InputError."""
        many = whole(step.parameters.get("INC") or str(cls.many), step.where())
        equal = static.parameters.get("DIRECT", "NO").upper() != "NO"
        at_once = step.parameters.get("AMPLITUDE", "").upper() == "STEP"
        for line, row in static.rows():
            where = static.where(line)
            given = [number(text or "0", where) for text in (*row, "", "", "", "")[:4]]
            period = given[1] if len(row) > 1 and row[1] else cls.period
            if not period > 0.0:
                static.fail(f"time of the step; got {period:g}; expected > 0", line)
            first = min(given[0], period) if given[0] > 0.0 else period
            return cls(first, period, given[3] if given[3] > 0.0 else inf, equal, many, at_once)
        return cls(equal=equal, many=many, at_once=at_once)

    def ends(self, card: Card) -> Float:
        """Times at which they end, from the beginning of the step, the end of which is the last.

        Raises InputError where there are too many.
        """
        ends, length = [0.0], self.first
        while ends[-1] < self.period * (1.0 - _SAME):
            if len(ends) > self.many:
                card.fail(
                    f"got more than {self.many} increments of {self.first:g} or more; expected "
                    "longer ones, or INC=number"
                )
            ends.append(ends[-1] + length)
            if not self.equal and len(ends) > self.alike:
                length = max(min(_GROWTH * length, self.longest), self.first)
        return np.append(ends[1:-1], self.period)


def merged(times: Float, other: Float, period: float) -> Float:
    """Both in one row, without times that are the same but for rounding."""
    row = np.sort(np.concatenate([times, other]))
    return row[np.diff(row, append=np.inf) > _SAME * period]
