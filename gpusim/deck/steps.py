"""The history of a deck: what each step adds, changes or removes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.deck.amplitudes import Amplitudes, Interval, Moment, Ramped, Scale
from gpusim.deck.constraints import Axes, Constraints, read_tie
from gpusim.deck.dynamics import Dynamics
from gpusim.deck.forces import Forces, following_pressures, pressure_forces
from gpusim.deck.increments import Increments, merged
from gpusim.deck.initial_state import InitialMotion, InitialStress, temperature_forces
from gpusim.deck.materials import Body
from gpusim.deck.modal_dynamics import HarmonicDynamics, ModalDynamics, read_modal_damping
from gpusim.deck.procedures import Frequency, LinearBuckling, Static, last_static
from gpusim.deck.step import Motion, Procedure, Step
from gpusim.fem import FollowerPressure
from gpusim.fem.model.constraints import touched
from gpusim.fem.model.damping import Damping
from gpusim.mesh.formats.abaqus.cards import Card, number, whole
from gpusim.validation import require


@dataclass(eq=False)
class _Open:
    """The step being read; ``seen`` holds the keywords of its loads: OP counts at their first."""

    card: Card
    procedure: Procedure | None = None
    perturbation: bool = False
    seen: set[str] = field(default_factory=set)


_PROCEDURES: dict[str, Callable[[Card, Card], Procedure]] = {
    "STATIC": Static.read,
    "FREQUENCY": Frequency.read,
    "BUCKLE": LinearBuckling.read,
    "MODALDYNAMIC": ModalDynamics.read,
    "STEADYSTATEDYNAMICS": HarmonicDynamics.read,
    "DYNAMIC": Dynamics.read,
}


class History:
    """Reads supports, loads and steps in their order; ``steps`` holds the finished ones.

    A load or support stays in later steps until it is given again, or removed by the first card
    of its keyword with OP=NEW. Within one step, forces on the same degree of freedom and
    pressures on the same face add up. Ramps end at their full value.
    """

    def __init__(self, body: Body, axes: Axes) -> None:
        self.body = body
        self.constraints = Constraints(body.content, axes)
        self.forces, self.quadrature = Forces(body, axes), Forces(body, axes)
        nodes = body.mesh.node_count
        self.stress, self.motion = InitialStress(body), InitialMotion(body)
        self.damping: Damping | None = None
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
            **dict.fromkeys(_PROCEDURES, self._procedure),
            "MODALDAMPING": self._modal_damping,
            "BASEMOTION": self._base_motion,
            "ENDSTEP": self._end,
            "CLOAD": self._loads(Forces.read_nodal, Forces.clear_nodal),
            "DLOAD": self._loads(Forces.read_distributed, Forces.clear_distributed),
            "DSLOAD": self._loads(Forces.read_surface, Forces.clear_distributed),
            "TEMPERATURE": self._temperature,
        }

    def _loads(
        self, read: Callable[[Forces, Card, Scale], None], clear: Callable[[Forces], None]
    ) -> Callable[[Card], None]:
        def reader(card: Card) -> None:
            forces, case = self.forces, card.parameters.get("LOADCASE", "1")
            if case != "1":
                harmonic = isinstance(self._inside(card).procedure, HarmonicDynamics)
                expected = "1, or 2 in a step with *STEADY STATE DYNAMICS"
                require(harmonic and case == "2", f"{card.where()}: LOAD CASE", case, expected)
                forces = self.quadrature
            self._renew(card, partial(clear, forces))
            read(forces, card, self._scale(card))

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
        procedure = self._inside(card).procedure
        if procedure is None and card.parameters.get("AMPLITUDE", ""):
            card.fail("an amplitude before the procedure, which says how long the step is; "
                      "expected it after that")  # fmt: skip
        return self.amplitudes.scale(card, self._interval(procedure))

    def _interval(self, procedure: Procedure | None) -> Interval:
        if isinstance(procedure, HarmonicDynamics):
            # what amplitudes are over
            return Interval(len(self.steps) + 1, 0.0, procedure.greatest)
        increments = Increments() if procedure is None else procedure.increments
        return Interval(len(self.steps) + 1, self.time, increments.period)

    def _initial(self, card: Card) -> None:
        kind = card.parameters.get("TYPE", "").upper()
        if kind == "STRESS":
            require(not self.body.nonlinear, f"{card.where()}: in a nonlinear deck", kind, "none")
            self.stress.read(card)
            return
        if kind in ("DISPLACEMENT", "VELOCITY"):
            self.motion.read(card, self.constraints.axes.rows)
            return
        if kind != "TEMPERATURE":
            card.fail(f"TYPE={kind} isn't supported; expected TEMPERATURE, STRESS, DISPLACEMENT "
                      "or VELOCITY")  # fmt: skip
        for nodes, value in self._node_values(card):
            self.initial[nodes] = value

    def _temperature(self, card: Card) -> None:
        if isinstance(self._inside(card).procedure, LinearBuckling):
            card.fail("in a step with *BUCKLE; expected forces, or a static analysis")
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
        self.open = _Open(card)

    def _procedure(self, card: Card) -> None:
        step = self._inside(card)
        step.procedure = procedure = _PROCEDURES[card.keyword](card, step.card)
        step.perturbation = "PERTURBATION" in step.card.parameters
        problem = procedure.unfit(self.steps, step.perturbation) or self._unfit(step, procedure)
        if problem:
            card.fail(problem)
        # what a state is stressed by isn't there again for perturbations of it
        if procedure.fresh or (step.perturbation and procedure.moves):
            self.forces.clear()
            self.quadrature.clear()
            if self.temperature is not None:
                self.temperature.clear()
            if step.perturbation:
                self.constraints.given.clear()

    def _unfit(self, step: _Open, procedure: Procedure) -> str:
        """What speaks against a procedure in this deck, if anything."""
        body, about, moves = self.body, step.perturbation, isinstance(procedure, Dynamics)
        spun = any(one.kind == "CENTRIF" for one in self.forces.bodies)
        ramp = step.card.parameters.get("AMPLITUDE", "").upper() == "RAMP"
        stressed = bool(self.stress.values) and not isinstance(procedure, Static)
        thrown = bool(self.motion.where) and not self.steps and not moves
        problems = [
            (about and body.nonlinear and not self.steps,
             "PERTURBATION in the first step of a nonlinear deck"),
            (about and spun, "PERTURBATION about a state with CENTRIF, which changes with motion"),
            (about and body.has_history,
             "PERTURBATION about metal, of whose state only its stress is known"),
            (stressed, "initial stress, which other steps than *STATIC don't know"),
            (thrown, f"motion before the first step ({self.motion.where}), which isn't *DYNAMIC"),
            (moves and body.nonlinear and body.damping.stiffness > 0.0,
             "BETA of *DAMPING at large displacements, where it would damp rotations"),
            (procedure.moves and ramp,
             "AMPLITUDE=RAMP of *STEP; expected loads that are there at once"),
            (body.nonlinear and isinstance(procedure, LinearBuckling),
             "*BUCKLE at large displacements; expected linear statics"),
        ]  # fmt: skip
        return next((text for found, text in problems if found), "")

    def _modal_damping(self, card: Card) -> None:
        self._inside(card)
        self.damping = read_modal_damping(card)

    def _base_motion(self, card: Card) -> None:
        """All supports in a direction move alike, those in the others rest."""
        step = self._inside(card)
        if not isinstance(step.procedure, ModalDynamics | HarmonicDynamics):
            card.fail("outside of modal superposition; expected *MODAL DYNAMIC or *STEADY STATE "
                      "DYNAMICS before it in the step")  # fmt: skip
        where, kind = card.where(), card.parameters.get("TYPE", "DISPLACEMENT").upper()
        axis = whole(card.parameters.get("DOF", "0"), where)
        require(1 <= axis <= 3, f"{where}: DOF", axis, "1, 2 or 3")
        named = card.parameters.get("AMPLITUDE", "")
        require(bool(named), f"{where}: AMPLITUDE", "none", "the name of one")
        turned = bool(self.constraints.axes.rows)
        require(not turned, f"{where}: supports", "some in turned axes", "none with *TRANSFORM")
        scale = self.amplitudes.scale(card, self._interval(step.procedure))
        if kind == "ACCELERATION":
            swept = isinstance(step.procedure, HarmonicDynamics) and step.procedure.least > 0.0
            require(swept, f"{where}: TYPE", kind, "DISPLACEMENT but in steady states above 0 Hz")
            scale = self.amplitudes.integrated(scale)
        if card.keyword not in step.seen:
            self.constraints.given.clear()
        step.seen.add(card.keyword)
        self.constraints.given.put((self.constraints.fixed[:, axis - 1], axis - 1), 1.0, scale)

    def _end(self, card: Card) -> None:
        step = self._inside(card)
        self.open = None
        procedure = step.procedure
        if procedure is None:
            step.card.fail("no procedure; expected *STATIC in the step, or another one")
        interval, begin = self._interval(procedure), self.time
        self.time += procedure.increments.period
        on_the_way = self._on_the_way(procedure, interval)
        *path, state = (
            replace(
                self._state(step, self._moment(procedure, interval, time), self.forces), time=time
            )
            for time in (*on_the_way, self.time)
        )
        motion = self._motion(step, interval) if procedure.moves else None
        of_motion = [] if motion is None else motion.cases
        self._refuse_pulled(step, of_motion)
        for one in (*path, state, *of_motion) if self.body.nonlinear else of_motion:
            if not one.held_as((*self.steps, *path, state)[0] if self.body.nonlinear else state):
                step.card.fail(
                    "holds other degrees of freedom or displacements in turned axes than what is "
                    "before; expected the same in all steps of a nonlinear deck (*BOUNDARY and "
                    "*EQUATION before the first step, with other values inside of steps)"
                )
        about = last_static(self.steps) if step.perturbation else None
        for other in (about, procedure.superposes(self.steps)):
            if other is not None and not state.held_as(other):
                step.card.fail(f"other supports than in step {other.number}, about which it is, or "
                               "whose modes it superposes; expected the same")  # fmt: skip
        increments, wanted = procedure.increments, np.array([self.time])
        stepped = self.body.has_history or (self.body.nonlinear and increments.equal)
        if stepped or procedure.moves:
            wanted = begin + increments.ends(step.card)
            wanted[-1] = self.time
        wanted = merged(on_the_way, wanted, increments.period)
        self.steps.append(replace(
            state, path=tuple(path), increments=wanted, motion=motion, damping=self.damping,
            perturbation=step.perturbation,
        ))  # fmt: skip
        moment = Moment(self.amplitudes.factors(self.time))
        self.forces.end(moment)
        self.constraints.given.end(moment)
        if self.temperature is not None:
            self.temperature.end(moment)

    def _refuse_pulled(self, step: _Open, cases: Sequence[Step]) -> None:
        """What can't act where the body moves."""
        turned = any(one.right.any() for case in cases for one in case.constraints)
        pulled = turned or any(case.prescribed.any() for case in cases)
        if pulled and (turned or step.perturbation or isinstance(step.procedure, Dynamics)):
            step.card.fail("displacements of supports; expected none with *DYNAMIC, in turned axes "
                           "or about a stressed state")  # fmt: skip
        if any(case.temperature is not None and case.temperature.any() for case in cases):
            step.card.fail("a changed temperature where the body moves; expected *STATIC")

    def _motion(self, step: _Open, interval: Interval) -> Motion:
        """What acts in it, sorted by what it follows."""
        acting = [
            (self._state(step, moment, forces, alone=ahead), course, ahead)
            for moment, course in self.amplitudes.courses()
            # superposition forgets what followed the time of an earlier step, as CalculiX does
            if course.step in (0, interval.number) or isinstance(step.procedure, Dynamics)
            for ahead, forces in ((False, self.forces), (True, self.quadrature))
        ]
        acting = [one for one in acting if not one[0].idle] or acting[:1]
        modal = isinstance(step.procedure, ModalDynamics)
        again = modal and any(isinstance(one.procedure, ModalDynamics) for one in self.steps)
        if again and any(course.number and not course.step for _, course, _ in acting):
            step.card.fail("an amplitude over total time in a second step with *MODAL DYNAMIC, "
                           "where programs differ; expected one over its own time")  # fmt: skip
        return Motion(interval.begin, *zip(*acting, strict=True))

    def _on_the_way(self, procedure: Procedure, interval: Interval) -> Float:
        """Total times between which the loads of a nonlinear step go straight."""
        increments = procedure.increments
        if not self.body.nonlinear or procedure.moves:
            return np.zeros(0)
        first = [interval.begin + increments.first] if increments.at_once else []
        corners = self.amplitudes.corners(interval, increments.first)
        times = merged(np.array(first), corners, interval.period)
        return times[times < self.time - 1e-9 * interval.period]

    def _moment(self, procedure: Procedure, interval: Interval, time: float) -> Moment:
        ended = procedure.increments.at_once or time == self.time
        share = 1.0 if ended else (time - interval.begin) / interval.period
        return Moment(self.amplitudes.factors(time), share)

    def _state(self, step: _Open, moment: Moment, own: Forces, *, alone: bool = False) -> Step:
        """What acts at a moment of a step: forces, and unless they are looked at ``alone`` all
        else."""
        assert step.procedure is not None
        fixed, prescribed, constraints = self.constraints.assembled(moment)
        own.refuse_loose(fixed | touched(constraints, fixed.shape))
        change = None
        if self.temperature is not None and not alone:
            change = self.temperature.at(moment) - moment.factors[0] * self.initial
        forces, pressed = own.nodal_forces(moment), own.pressed(moment)
        followers: Callable[[], tuple[FollowerPressure, ...]] = tuple
        if pressed is not None:
            followers = partial(following_pressures, self.body, *pressed)
        if pressed is not None and not self.body.nonlinear:
            forces += pressure_forces(self.body, *pressed)
        for one in own.body_forces(moment):
            forces += one
        if self.stress.values and not alone:
            forces += moment.factors[0] * self.stress.forces()
        if change is not None and not self.body.nonlinear:
            forces += temperature_forces(self.body, change)
        return Step(
            number=len(self.steps) + 1,
            name=step.card.parameters.get("NAME", ""),
            time=self.time,
            fixed=fixed,
            prescribed=0.0 * prescribed if alone else prescribed,
            forces=forces,
            temperature=change,
            constraints=constraints,
            procedure=step.procedure,
            loads=followers() if self.body.nonlinear else (),
            followers=followers,
        )
