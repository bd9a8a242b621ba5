"""The history of a deck: what each step adds, changes or removes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.deck.amplitudes import Amplitudes, Scale
from gpusim.deck.constraints import Axes, Constraints, read_tie
from gpusim.deck.deck import Step
from gpusim.deck.forces import Forces
from gpusim.deck.initial_state import InitialStress, temperature_forces
from gpusim.deck.materials import Body
from gpusim.fem.model.constraints import touched
from gpusim.mesh.formats.abaqus.cards import Card, number


@dataclass(eq=False)
class _Open:
    """The step being read; ``seen`` holds the keywords of its loads: OP counts at their first."""

    card: Card
    period: float = 1.0
    static: bool = False
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
        self.temperature: Float | None = None
        self.warmth_follows = np.zeros(nodes, dtype=np.int32)
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
        return self.amplitudes.scale(card, len(self.steps) + 1, self._inside(card).period)

    def _initial(self, card: Card) -> None:
        kind = card.parameters.get("TYPE", "").upper()
        if kind == "STRESS":
            self.stress.read(card)
            return
        if kind != "TEMPERATURE":
            card.fail(f"TYPE={kind} isn't supported; expected TEMPERATURE or STRESS")
        for nodes, value in self._node_values(card):
            self.initial[nodes] = value

    def _temperature(self, card: Card) -> None:
        self._inside(card)
        if self.temperature is None:
            self.temperature = self.initial.copy()
        self._renew(card, self._clear_temperature)
        scale = self._scale(card)
        for nodes, value in self._node_values(card):
            self.temperature[nodes] = scale.factor * value
            self.warmth_follows[nodes] = scale.follows

    def _clear_temperature(self) -> None:
        assert self.temperature is not None
        self.temperature[:] = self.initial
        self.warmth_follows[:] = 0

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
        if "PERTURBATION" in card.parameters and self.steps:
            # about a first step, a perturbation means that step's stress stiffness in CalculiX,
            # and its loads don't act: the first step of a linear analysis has neither
            card.fail("PERTURBATION about an earlier step; expected it in the first one")
        self.open = _Open(card)

    def _static(self, card: Card) -> None:
        step = self._inside(card)
        step.static = True
        for line, row in card.rows():
            if len(row) > 1 and row[1]:
                step.period = number(row[1], card.where(line))
            if not step.period > 0.0:
                card.fail(f"time of the step; got {step.period:g}; expected > 0", line)
            break

    def _end(self, card: Card) -> None:
        step = self._inside(card)
        self.open = None
        if not step.static:
            step.card.fail("no procedure; expected *STATIC in the step")
        self.time += step.period
        factors = self.amplitudes.factors(self.time)
        fixed, prescribed, constraints = self.constraints.assembled(factors)
        self.forces.refuse_loose(fixed | touched(constraints, fixed.shape))
        forces = self.forces.total(factors)
        if self.stress.values:
            forces += self.stress.forces()
        change = None
        if self.temperature is not None:
            change = self.temperature * factors[self.warmth_follows] - self.initial
            forces += temperature_forces(self.body, change)
        self.steps.append(
            Step(
                number=len(self.steps) + 1,
                name=step.card.parameters.get("NAME", ""),
                time=self.time,
                fixed=fixed,
                prescribed=prescribed,
                forces=forces,
                temperature=change,
                constraints=constraints,
            )
        )
