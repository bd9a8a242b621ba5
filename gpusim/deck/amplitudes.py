"""Amplitudes: factors of loads over time, and loads that follow them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.cards import Card, Names, number


@dataclass(frozen=True)
class Scale:
    """What a load is multiplied by.

    ``factor`` at once; ``follows`` numbers the amplitude over total time that it goes on to follow
    in later steps, 0 for none. ``step`` is the number of the step that gives it, 0: before the
    first.
    """

    factor: float = 1.0
    follows: int = 0
    step: int = 0


class ScaledLoads:
    """Loads in an array, each with what it is multiplied by: given again in the same step they add
    up, in a later step they replace."""

    def __init__(self, *shape: int) -> None:
        self.values = np.zeros(shape)
        self._steps = np.zeros(shape, dtype=np.int32)
        self._follows = np.zeros(shape, dtype=np.int32)

    def clear(self) -> None:
        self.values[:] = 0.0

    def add(self, place: tuple[Any, Any], value: float, scale: Scale, where: str) -> None:
        """``value``, scaled, at a place of the array. Raises InputError for two amplitudes."""
        again = self._steps[place] == scale.step
        if (again & (self._follows[place] != scale.follows)).any():
            raise InputError(
                f"{where}: two amplitudes for one degree of freedom or face in one step; expected "
                "one"
            )
        kept = np.where(again, self.values[place], 0.0)
        self.values[place] = kept + scale.factor * value
        self._steps[place] = scale.step
        self._follows[place] = scale.follows

    def at(self, factors: Float) -> Float:
        """All of them, with the value of each amplitude that is followed; the first is 1."""
        return np.asarray(self.values * factors[self._follows])


@dataclass(frozen=True, eq=False)
class _Amplitude:
    times: Float
    factors: Float
    number: int  # 0: over the time of the step in which a load is given

    def at(self, time: float) -> float:
        return float(np.interp(time, self.times, self.factors))


class Amplitudes:
    """Reads *AMPLITUDE; a load without one ends its step at its full value.

    As in CalculiX, an amplitude over the time of a step leaves a load at its last value in later
    steps; one over the total time goes on.
    """

    def __init__(self) -> None:
        self.known: Names[_Amplitude] = Names("amplitude")
        self.following: list[_Amplitude] = []

    def read(self, card: Card) -> None:
        name = card.parameters.get("NAME", "")
        values = [number(text, card.where(line)) for line, row in card.rows() for text in row]
        times, factors = np.array(values[::2]), np.array(values[1::2])
        if not name or not values or len(values) % 2 or not (np.diff(times) > 0.0).all():
            card.fail(
                f"got {len(values)} numbers; expected NAME=name and pairs of "
                "growing time and factor"
            )
        total = "TOTAL" in card.parameters.get("TIME", "").upper()
        one = _Amplitude(times, factors, len(self.following) + 1 if total else 0)
        self.known.define(name, one, card.where())
        if total:
            self.following.append(one)

    def scale(self, card: Card, step: int, period: float) -> Scale:
        """For a load card in a step, by its number and length. Raises InputError."""
        name = card.parameters.get("AMPLITUDE", "")
        if not name:
            return Scale(step=step)
        one = self.known.get(name, card.where())
        return Scale(1.0 if one.number else one.at(period), one.number, step)

    def factors(self, time: float) -> Float:
        """Value at a total time of each amplitude that is followed; the first is 1."""
        return np.array([1.0, *(one.at(time) for one in self.following)])
