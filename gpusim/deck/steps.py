"""The history of a deck: what each step adds, changes or removes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.deck.amplitudes import Amplitudes, Interval, Moment, Ramped, Scale
from gpusim.deck.constraints import Axes, Constraints, read_tie
from gpusim.deck.forces import Forces, following_pressures, pressure_forces
from gpusim.deck.increments import Increments, merged
from gpusim.deck.initial_state import InitialStress, temperature_forces
from gpusim.deck.materials import Body
from gpusim.deck.step import Step
from gpusim.fem import FollowerPressure
from gpusim.fem.model.constraints import touched
from gpusim.mesh.formats.abaqus.cards import Card, number
from gpusim.validation import require


@dataclass(eq=False)
class _Open:
    """The step being read; ``seen`` holds the keywords of its loads: OP counts at their first."""

    card: Card
    increments: Increments | None = None
    seen: set[str] = field(default_factory=set)


class History:
    """Reads supports, loads and steps in their order; ``steps`` holds the finished ones.

    A load or support stays in later steps until it is given again, or removed by the first card
    of its keyword with OP=NEW. Within one step, forces on the same degree of freedom and
    pressures on the same face add up. Ramps end at their full value.
    """

    def __init__(self, body: Body, axes: Axes) -> None:
        self.body = body
        self.constraints = Constraints(body.content, axes)
        self.forces = Forces(body, axes)
        nodes = body.mesh.node_count
        self.stress = InitialStress(body)
        self.initial = np.zeros(nodes)
        self.temperature: Ramped | None = None
        self.amplitudes = Amplitudes()
        self.steps: list[Step] = []
        self.time = 0.0
        self.open: _Open | None = None

    def readers(self) -> dict[str, Callable[[Card], None]]:
        """Keyword -> the method that reads its card."""
        return {
            "AMPLITUDE": self.amplitudes.read,
            "INITIALCONDITIONS": self._initial,
            "EQUATION": self.constraints.equation,
            "TIE": self._tie,
            "BOUNDARY": self._boundary,
            "STEP": self._step,
            "STATIC": self._static,
            "ENDSTEP": self._end,
            "CLOAD": self._loads(self.forces.read_nodal, self.forces.nodal.clear),
            "DLOAD": self._loads(self.forces.read_distributed, self.forces.clear_distributed),
            "DSLOAD": self._loads(self.forces.read_surface, self.forces.clear_distributed),
            "TEMPERATURE": self._temperature,
        }

    def _loads(
        self, read: Callable[[Card, Scale], None], clear: Callable[[], None]
    ) -> Callable[[Card], None]:
        def reader(card: Card) -> None:
            self._renew(card, clear)
            read(card, self._scale(card))

        return reader

    def _inside(self, card: Card) -> _Open:
        if self.open is None:
            card.fail("outside of a step; expected *STEP before it")
        return self.open

    def _renew(self, card: Card, clear: Callable[[], None]) -> None:
        """OP=NEW counts at the first card of its keyword in a step."""
        step = self._inside(card)
        operation = card.parameters.get("OP", "MOD").upper()
        group = "DLOAD" if card.keyword == "DSLOAD" else card.keyword
        if group not in step.seen and operation == "NEW":
            clear()
        step.seen.add(group)

    def _scale(self, card: Card) -> Scale:
        increments = self._inside(card).increments
        if increments is None and card.parameters.get("AMPLITUDE", ""):
            card.fail("an amplitude before *STATIC, which says how long the step is; expected it "
                      "after that")  # fmt: skip
        return self.amplitudes.scale(card, self._interval(increments or Increments()))

    def _interval(self, increments: Increments) -> Interval:
        return Interval(len(self.steps) + 1, self.time, increments.period)

    def _initial(self, card: Card) -> None:
        kind = card.parameters.get("TYPE", "").upper()
        if kind == "STRESS":
            require(not self.body.nonlinear, f"{card.where()}: in a nonlinear deck", kind, "none")
            self.stress.read(card)
            return
        if kind != "TEMPERATURE":
            card.fail(f"TYPE={kind} isn't supported; expected TEMPERATURE or STRESS")
        for nodes, value in self._node_values(card):
            self.initial[nodes] = value

    def _temperature(self, card: Card) -> None:
        self._inside(card)
        if self.temperature is None:
            self.temperature = Ramped(self.initial.copy())
        self._renew(card, self.temperature.clear)
        scale = self._scale(card)
        for nodes, value in self._node_values(card):
            self.temperature.put(nodes, value, scale)

    def _node_values(self, card: Card) -> list[tuple[Long, float]]:
        return [
            (self.body.content.node_rows(row[0], where), number(row[1], where))
            for where, row in card.records(2, 2, "node or node set, temperature")
        ]

    def _tie(self, card: Card) -> None:
        self.constraints.ties.append(read_tie(card, self.body.content, self.body.labelled))

    def _boundary(self, card: Card) -> None:
        if self.open is None:
            self.constraints.boundary(card, Scale())
            return
        self._renew(card, self.constraints.clear)
        self.constraints.boundary(card, self._scale(card))

    def _step(self, card: Card) -> None:
        if self.open is not None:
            card.fail(
                f"inside of a step; expected *END STEP for the step of line {self.open.card.line}"
            )
        if "PERTURBATION" in card.parameters and (self.steps or self.body.nonlinear):
            # about a first step, a perturbation means that step's stress stiffness in CalculiX,
            # and its loads don't act: the first step of a linear analysis has neither
            card.fail("PERTURBATION about an earlier step, or of a nonlinear deck; expected it in "
                      "the first one of a linear deck")  # fmt: skip
        self.open = _Open(card)

    def _static(self, card: Card) -> None:
        step = self._inside(card)
        step.increments = Increments.read(card, step.card)

    def _end(self, card: Card) -> None:
        step = self._inside(card)
        self.open = None
        increments = step.increments
        if increments is None:
            step.card.fail("no procedure; expected *STATIC in the step")
        interval = self._interval(increments)
        self.time += increments.period
        on_the_way = self._on_the_way(increments, interval)
        *path, state = (self._state(step, interval, time) for time in (*on_the_way, self.time))
        for one in (*path, state) if self.body.nonlinear else ():
            if not one.held_as((*self.steps, *path, state)[0]):
                step.card.fail(
                    "holds other degrees of freedom or displacements in turned axes than what is "
                    "before; expected the same in all steps of a nonlinear deck (*BOUNDARY and "
                    "*EQUATION before the first step, with other values inside of steps)"
                )
        wanted = np.array([self.time])
        if self.body.has_history or (self.body.nonlinear and increments.equal):
            wanted = interval.begin + increments.ends(step.card)
            wanted[-1] = self.time
        wanted = merged(on_the_way, wanted, increments.period)
        self.steps.append(replace(state, path=tuple(path), increments=wanted))
        moment = Moment(self.amplitudes.factors(self.time))
        self.forces.end(moment)
        self.constraints.given.end(moment)
        if self.temperature is not None:
            self.temperature.end(moment)

    def _on_the_way(self, increments: Increments, interval: Interval) -> Float:
        """Total times between which the loads of a nonlinear step go straight."""
        if not self.body.nonlinear:
            return np.zeros(0)
        first = [interval.begin + increments.first] if increments.at_once else []
        corners = self.amplitudes.corners(interval, increments.first)
        times = merged(np.array(first), corners, interval.period)
        return times[times < self.time - 1e-9 * interval.period]

    def _state(self, step: _Open, interval: Interval, time: float) -> Step:
        """What acts at a total time of a step."""
        assert step.increments is not None
        ended = step.increments.at_once or time == self.time
        share = 1.0 if ended else (time - interval.begin) / interval.period
        moment = Moment(self.amplitudes.factors(time), share)
        fixed, prescribed, constraints = self.constraints.assembled(moment)
        self.forces.refuse_loose(fixed | touched(constraints, fixed.shape))
        change = None
        if self.temperature is not None:
            change = self.temperature.at(moment) - self.initial
        forces, pressed = self.forces.nodal_forces(moment), self.forces.pressed(moment)
        loads: tuple[FollowerPressure, ...] = ()
        if pressed is not None and self.body.nonlinear:
            loads = following_pressures(self.body, *pressed)
        elif pressed is not None:
            forces += pressure_forces(self.body, *pressed)
        for one in self.forces.body_forces(moment):
            forces += one
        if self.stress.values:
            forces += self.stress.forces()
        if change is not None and not self.body.nonlinear:
            forces += temperature_forces(self.body, change)
        return Step(
            number=interval.number,
            name=step.card.parameters.get("NAME", ""),
            time=time,
            fixed=fixed,
            prescribed=prescribed,
            forces=forces,
            temperature=change,
            constraints=constraints,
            loads=loads,
        )
