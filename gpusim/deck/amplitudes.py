"""Amplitudes: factors of loads over time, and loads that follow them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from gpusim.arrays.array_types import Float, Int
from gpusim.errors import InputError
from gpusim.mesh.formats.abaqus.cards import Card, Names, number


@dataclass(frozen=True)
class Scale:
    """What a load is multiplied by.

    ``follows`` numbers the amplitude over total time that it follows, 0 for none. ``step`` is the
    number of the step that gives it, 0: before the first.
    """

    follows: int = 0
    step: int = 0


@dataclass(frozen=True, eq=False)
class Moment:
    """A time: the value of each amplitude, the first of which all follow that follow none, and how
    much of the step is over by then as ramps count it, 0 to 1."""

    factors: Float
    share: float = 1.0

    def of(self, new: Float | float, follows: Int | int, old: Float | float) -> Float:
        """Loads, of values ``new``, that follow an amplitude, or ramp up from ``old``."""
        ramp = (1.0 - self.share) * old + self.share * new
        return np.where(follows, new * self.factors[follows], self.factors[0] * ramp)


class Ramped:
    """Values in an array, each of which follows an amplitude or goes on a ramp from what it was at
    the end of the step before."""

    def __init__(self, initial: Float) -> None:
        self.initial, self.old = initial, initial
        self.values = initial.copy()
        self.follows = np.zeros(initial.shape, dtype=np.int32)

    def clear(self) -> None:
        self.values[:] = self.initial
        self.follows[:] = 0

    def put(self, place: Any, value: float | Float, scale: Scale) -> None:
        self.values[place] = value
        self.follows[place] = scale.follows

    def at(self, moment: Moment) -> Float:
        return moment.of(self.values, self.follows, self.old)

    def end(self, moment: Moment) -> None:
        """A step has ended."""
        self.old = self.at(moment)


class ScaledLoads(Ramped):
    """Loads in an array, each with what it is multiplied by: given again in the same step they add
    up, in a later step they replace."""

    def __init__(self, *shape: int) -> None:
        super().__init__(np.zeros(shape))
        self._steps = np.zeros(shape, dtype=np.int32)

    def add(self, place: Any, value: float, scale: Scale, where: str) -> None:
        """``value``, scaled, at a place of the array. Raises InputError for two amplitudes."""
        again = self._steps[place] == scale.step
        if (again & (self.follows[place] != scale.follows)).any():
            raise InputError(
                f"{where}: two amplitudes for one degree of freedom or face in one step; expected "
                "one"
            )
        self.put(place, np.where(again, self.values[place], 0.0) + value, scale)
        self._steps[place] = scale.step


@dataclass(frozen=True)
class Interval:
    """The time of step ``number``: its ``begin`` in total time, and its ``period``."""

    number: int
    begin: float
    period: float


@dataclass(frozen=True, eq=False)
class Amplitude:
    """Factors over time, linear in between."""

    times: Float
    factors: Float
    number: int  # 0: over the time of the step in which a load is given
    step: int = 0  # over the time of which it is; 0: over the total time

    def at(self, time: Float | float) -> Float:
        return np.asarray(np.interp(time, self.times, self.factors))

    def within(self, step: Interval, number: int) -> Amplitude:
        """The same over total time, in a step, and as it is at its end from then on."""
        inside = self.times < step.period
        times = np.append(self.times[inside], step.period)
        factors = np.append(self.factors[inside], self.at(step.period))
        return Amplitude(step.begin + times, factors, number, step.number)


class _Acceleration(Amplitude):
    """Of a harmonic motion over frequency in Hz."""

    def at(self, time: Float | float) -> Float:
        square = (2.0 * np.pi * np.asarray(time)) ** 2
        return -super().at(time) / np.where(square > 0.0, square, np.inf)


class Amplitudes:
    """Reads *AMPLITUDE; a load without one ends its step at its full value.

    As in CalculiX, an amplitude over the time of a step leaves a load at its last value in later
    steps; one over the total time goes on.
    """

    def __init__(self) -> None:
        self.known: Names[Amplitude] = Names("amplitude")
        self.following: list[Amplitude] = []
        self._within: dict[tuple[int, int], int] = {}

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
        one = Amplitude(times, factors, len(self.following) + 1 if total else 0)
        self.known.define(name, one, card.where())
        if total:
            self.following.append(one)

    def scale(self, card: Card, step: Interval) -> Scale:
        """For a load card in a step. Raises InputError."""
        name = card.parameters.get("AMPLITUDE", "")
        if not name:
            return Scale(step=step.number)
        one = self.known.get(name, card.where())
        if one.number:
            return Scale(one.number, step.number)
        key = (id(one), step.number)
        if key not in self._within:
            self.following.append(one.within(step, len(self.following) + 1))
            self._within[key] = len(self.following)
        return Scale(self._within[key], step.number)

    def factors(self, time: float) -> Float:
        """Value at a total time of each amplitude that is followed; the first is 1."""
        return np.array([1.0, *(one.at(time) for one in self.following)])

    def integrated(self, scale: Scale) -> Scale:
        """What moves harmonically with the acceleration that follows an amplitude."""
        own = self.following[scale.follows - 1]
        count = len(self.following) + 1
        self.following.append(_Acceleration(own.times, own.factors, count, own.step))
        return Scale(count, scale.step)

    def courses(self) -> list[tuple[Moment, Amplitude]]:
        """Each amplitude that is followed, and a moment at which only what follows it is there; of
        the first, which is 1, what follows none."""
        every = [Amplitude(np.zeros(1), np.ones(1), 0), *self.following]
        return list(zip(map(Moment, np.eye(len(every))), every, strict=True))

    def corners(self, step: Interval, first: float) -> Float:
        """Total times in a step at which what is followed bends, and the end of its ``first``
        increment, by which loads that don't begin at zero are there; empty: nothing goes on."""
        times = [one.times for one in self.following if one.times[-1] > step.begin]
        if not times:
            return np.zeros(0)
        every = np.unique(np.concatenate([[step.begin + first], *times]))
        return every[(every > step.begin) & (every < step.begin + step.period)]
