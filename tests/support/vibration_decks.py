"""Decks of small bodies that vibrate or buckle; CalculiX runs them as well.

Motions are printed at all nodes of the end XMAX, in global axes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import gpusim as gs
from tests.support.nonlinear_decks import (
    CLAMPED,
    STEEL,
    Lines,
    bar,
    end_force,
    pressure,
    wedges,
    written,
)

PRINTED = ["*NODE PRINT, NSET=XMAX, GLOBAL=YES", "U"]
EXACT = ["*CONTROLS, PARAMETERS=FIELD", "1.E-9, 1.E-9"]
# loads that go up, down to a fifth, and up again
HAMMER = ["*AMPLITUDE, NAME=HAMMER", "0., 0., 2.E-5, 1., 3.E-5, 0.2, 2.E-4, 0.4"]
TENSION, DAMPED = 500.0, [*STEEL, "*DAMPING, ALPHA=3000., BETA=2.E-6"]
_BRICKS = bar(8, 6, 2, 1, quadratic=False)
_CURVED = bar(8, 3, 1, 1)
# a single row of C3D20R is a mechanism
_ROWS = bar(8, 3, 2, 2)


def step(*cards: str, head: str = "*STEP, INC=1000", printed: Sequence[str] = PRINTED) -> Lines:
    """A step of these cards."""
    return [head, *cards, *printed, "*END STEP"]


def modes(count: int = 6, head: str = "*STEP") -> Lines:
    """A step that asks for natural frequencies."""
    return step("*FREQUENCY, STORAGE=YES", str(count), head=head, printed=())


def along(mesh: gs.Mesh, force: float, axis: int, of: str = "") -> Lines:
    """*CLOAD on the end, with parameters."""
    first, *rest = end_force(mesh, force, axis)
    return [first + of, *rest]


def _frequencies(mesh: gs.Mesh, kind: str = "") -> str:
    return written(mesh, STEEL, [modes()], kind, CLAMPED)


def _stretched(head: str, force: float, kind: str = "C3D20R") -> str:
    energy = ["*EL PRINT, ELSET=BODY, TOTALS=ONLY", "ENER"]
    pulled = step("*STATIC", *along(_ROWS, force, 0), *EXACT, head=head, printed=energy)
    return written(_ROWS, STEEL, [pulled, modes(head="*STEP, PERTURBATION")], kind, CLAMPED)


def _pressed() -> str:
    """About linear statics, in which CalculiX lets pressures follow as well."""
    pressed = step("*STATIC", *pressure(_BRICKS, "-z", 30.0), printed=())
    return written(_BRICKS, STEEL, [pressed, modes(head="*STEP, PERTURBATION")], "", CLAMPED)


def _about() -> str:
    """Motion about a stretched state, whose loads aren't there again."""
    about = "*STEP, PERTURBATION"
    steps = [
        step("*STATIC", *along(_BRICKS, TENSION, 0), printed=()),
        modes(head=about),
        step("*MODAL DYNAMIC", "4.E-6, 6.E-5", *along(_BRICKS, -1.0, 2), head=about),
    ]
    return written(_BRICKS, STEEL, steps, "", CLAMPED)


def _buckled(mesh: gs.Mesh, kind: str) -> str:
    pressed = step("*BUCKLE", "3, 1.E-6", *along(mesh, -100.0, 0), printed=())
    return written(mesh, STEEL, [pressed], kind, CLAMPED)


def _superposed(*cards: str, before: Sequence[str] = ()) -> str:
    """Modes, and a step in which they are superposed."""
    return written(_BRICKS, STEEL, [modes(), step(*cards)], "", [*HAMMER, *before, *CLAMPED])


def _modal() -> str:
    """Hit, with damping of some modes; then pushed to a side; then with damping of another kind."""
    steps = [
        modes(),
        step("*MODAL DYNAMIC", "4.E-6, 6.E-5", "*MODAL DAMPING", "1, 2, 0.05", "4, 4, 0.3",
             *along(_BRICKS, -1.0, 2, ", AMPLITUDE=HAMMER")),
        step("*MODAL DYNAMIC", "4.E-6, 2.E-5", *along(_BRICKS, 1.0, 1, ", OP=NEW")),
        step("*MODAL DYNAMIC", "2.E-6, 2.E-5", "*MODAL DAMPING, RAYLEIGH", ",, 3000., 2.E-6"),
    ]  # fmt: skip
    return written(_BRICKS, STEEL, steps, "", [*HAMMER, *CLAMPED])


def _modal_let_go() -> str:
    """Bent by a force, which is taken away."""
    steps = [
        modes(),
        step("*STATIC", *along(_BRICKS, 5.0, 2), printed=()),
        step("*MODAL DYNAMIC", "4.E-6, 4.E-5", *along(_BRICKS, 0.0, 2, ", OP=NEW")),
    ]
    return written(_BRICKS, STEEL, steps, "", CLAMPED)


def _steady(*cards: str) -> str:
    return _superposed("*STEADY STATE DYNAMICS", "10000., 30000., 4, 2.", *cards)


def _loss() -> str:
    """Two load cases a quarter of a period apart, one of which grows with frequency."""
    band = step("*STEADY STATE DYNAMICS", "5000., 40000., 3",
                "*MODAL DAMPING", "1, 6, 0.02", *along(_BRICKS, 1.0, 2),
                *along(_BRICKS, -3.0, 1, ", LOAD CASE=2, AMPLITUDE=SWEEP"))  # fmt: skip
    sweep = ["*AMPLITUDE, NAME=SWEEP", "0., 1., 20000., 3., 40000., 1."]
    material = [*STEEL, "*DAMPING, STRUCTURAL=0.03"]
    return written(_BRICKS, material, [modes(), band], "", [*sweep, *CLAMPED])


def _shaken(kind: str) -> str:
    unit = ["*AMPLITUDE, NAME=UNIT", "0., 1., 1.E6, 1."]
    return _superposed(
        "*STEADY STATE DYNAMICS", "10000., 30000., 4, 2.", "*MODAL DAMPING, RAYLEIGH",
        ",, 3000., 2.E-7", f"*BASE MOTION, DOF=3, AMPLITUDE=UNIT, TYPE={kind}", before=unit,
    )  # fmt: skip


def _direct(
    dynamic: str, *cards: str, before: Sequence[str] = (), head: str = "*STEP, INC=1000",
    mesh: gs.Mesh = _BRICKS, kind: str = "", material: Sequence[str] = STEEL,
) -> str:  # fmt: skip
    steps = [step(*dynamic.split("\n"), *EXACT, *cards, head=head)]
    return written(mesh, [*material], steps, kind, [*HAMMER, *before, *CLAMPED])


def _let_go() -> str:
    """Bent by a force, which is taken away."""
    energy = ["*EL PRINT, ELSET=BODY, TOTALS=ONLY", "ENER"]
    steps = [
        step("*STATIC", *EXACT, *along(_BRICKS, 500.0, 2), head="*STEP, NLGEOM", printed=energy),
        step("*DYNAMIC, DIRECT", "4.E-6, 4.E-5", *EXACT, *along(_BRICKS, 0.0, 2, ", OP=NEW")),
    ]
    return written(_BRICKS, STEEL, steps, "", CLAMPED)


def _again() -> str:
    """Two steps; what isn't given again stays as it was at the end of the first."""
    hit = along(_BRICKS, -1.0, 2, ", AMPLITUDE=HAMMER")
    steps = [step("*DYNAMIC, DIRECT", "4.E-6, 4.E-5", *EXACT, *cards) for cards in (hit, ())]
    return written(_BRICKS, STEEL, steps, "", [*HAMMER, *CLAMPED])


DECKS: dict[str, Callable[[], str]] = {
    "modes_c3d8": lambda: _frequencies(_BRICKS),
    "modes_c3d20": lambda: _frequencies(_CURVED),
    "modes_c3d20r": lambda: _frequencies(_ROWS, "C3D20R"),
    "modes_c3d4": lambda: _frequencies(gs.mesh.split(bar(3, 4, 2, 2, quadratic=False))),
    "modes_c3d10": lambda: _frequencies(
        gs.mesh.quadratic(gs.mesh.split(bar(4, 3, 1, 1, quadratic=False)))
    ),
    "modes_c3d6": lambda: _frequencies(wedges(bar(3, 4, 2, 2, quadratic=False))),
    "modes_c3d15": lambda: _frequencies(
        gs.mesh.quadratic(wedges(bar(4, 3, 1, 1, quadratic=False)))
    ),
    "modes_pulled": lambda: _stretched("*STEP", TENSION),
    "modes_pulled_far": lambda: _stretched("*STEP, NLGEOM", TENSION),
    "modes_pressed": _pressed,
    "modal_about": _about,
    "buckled_c3d8": lambda: _buckled(_BRICKS, "C3D8"),
    "buckled_c3d20r": lambda: _buckled(_ROWS, "C3D20R"),
    "modal": _modal,
    "modal_let_go": _modal_let_go,
    "steady_rayleigh": lambda: _steady(
        "*MODAL DAMPING, RAYLEIGH", ",, 3000., 2.E-7", *along(_BRICKS, -1.0, 2)
    ),
    "steady_loss": _loss,
    "steady_displacement": lambda: _shaken("DISPLACEMENT"),
    "steady_acceleration": lambda: _shaken("ACCELERATION"),
    "direct": lambda: _direct(
        "*DYNAMIC, DIRECT\n4.E-6, 6.E-5", *along(_BRICKS, -1.0, 2), material=DAMPED
    ),
    "direct_alpha": lambda: _direct(
        "*DYNAMIC, DIRECT, ALPHA=-0.2\n4.E-6, 6.E-5",
        *along(_ROWS, -1.0, 2, ", AMPLITUDE=HAMMER"), mesh=_ROWS, kind="C3D20R",
    ),
    "growing": lambda: _direct("*DYNAMIC\n4.E-6, 6.E-5", *along(_BRICKS, -1.0, 2)),
    "thrown": lambda: _direct(
        "*DYNAMIC, DIRECT\n4.E-6, 4.E-5",
        before=["*INITIAL CONDITIONS, TYPE=VELOCITY", "ALL, 3, -1000.",
                "*INITIAL CONDITIONS, TYPE=DISPLACEMENT", "XMAX, 2, 0.01"],
    ),
    "again": _again,
    "far": lambda: _direct(
        "*DYNAMIC, DIRECT\n4.E-6, 4.E-5", *along(_BRICKS, 300.0, 2), head="*STEP, NLGEOM",
        material=[*STEEL, "*DAMPING, ALPHA=3000."],
    ),
    "let_go": _let_go,
}  # fmt: skip
"""By name: what a test compares."""
