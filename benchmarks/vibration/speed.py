"""Modes of 10,000 to 350,000 unknowns beside other programs, and steps of time beside CalculiX."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_matrix

from benchmarks.solver.cases import CASES
from benchmarks.solver.problem import free_matrix
from benchmarks.vibration.peers import (
    EIGENSOLVERS,
    Run,
    calculix_modes,
    calculix_steps,
    eigensolvers,
)
from benchmarks.vibration.rayleigh import rayleigh_frequencies
from gpusim.bench.solver_cases import Case
from gpusim.fem import Model, Modes, mass_matrix, modes, solve, transient

Float = npt.NDArray[np.float64]

# t/mm^3, with MPa and mm
DENSITY = 7.85e-9
SIZES = {
    "small": ("beam-10k", "cube-10k", "bracket-15k"),
    "100k": ("beam-100k", "cube-100k", "bracket-123k"),
    "300k": ("beam-300k", "cube-345k"),
}
# modes that are guards of the reference
_GUARDS = 4

MODES_HEADINGS = (
    "case", "modes", "program", "unknowns", "processor s", "wall s", "error of f", "stated",
    "gpusim over it, processor and wall",
)  # fmt: skip


@dataclass(frozen=True)
class SpeedCase:
    """A case of the solver benchmark, its model with a density, the formulation of its cells."""

    case: Case
    model: Model
    rules: dict[str, str]

    @property
    def name(self) -> str:
        """Of the case."""
        return self.case.name

    @property
    def unknowns(self) -> str:
        """As it is written."""
        return f"{3 * self.model.mesh.node_count - int(np.asarray(self.model.fixed).sum()):,}"

    def matrices(self) -> tuple[csr_matrix, csr_matrix]:
        """Stiffness and mass of the nodes that aren't clamped, assembled by the benchmarks."""
        assert self.model.fixed is not None
        free = np.repeat(~self.model.fixed.all(axis=1), 3)
        mass = csr_matrix(mass_matrix(self.model)[free][:, free])
        return free_matrix(self.case, self.model), mass

    @classmethod
    def of(cls, case: Case) -> SpeedCase:
        """With steel's density."""
        model = case.model()
        steel = replace(case.material, density=DENSITY)
        return cls(case, replace(model, materials=[steel]), {case.kind: case.rule})


def speed_cases(size: str, name: str) -> Iterator[SpeedCase]:
    """Of one of `SIZES`, whose names hold ``name``."""
    by_name = {case.name: case for case in CASES}
    for one in SIZES[size]:
        if name in one:
            yield SpeedCase.of(by_name[one])


def modes_speed(
    size: str, name: str, count: int, repeat: int, peers: bool, limit: float
) -> Iterator[list[str]]:
    """One row of text after the other; the least processor time of ``repeat`` runs counts."""
    for case in speed_cases(size, name):
        reference = reference_frequencies(case, count)
        own, found = best_modes(case, count, repeat)
        yield _row(case, count, own, reference, own, found)
        if not peers:
            continue
        for other in eigensolvers(*case.matrices(), count, EIGENSOLVERS, limit):
            yield _row(case, count, own, reference, other, None)
        other = calculix_modes(case.model, case.rules, count, limit)
        yield _row(case, count, own, reference, other, None)


def reference_frequencies(case: SpeedCase, count: int) -> Float:
    """(count,) Hz: of tight shapes, in extended precision."""
    tight = modes(case.model, count + _GUARDS, formulation=case.rules, tolerance=1e-9)
    return rayleigh_frequencies(case.model, case.rules, tight.shapes)[:count]


def best_modes(case: SpeedCase, count: int, repeat: int) -> tuple[Run, Modes]:
    """From the model on, as a user has it."""
    runs = []
    for _ in range(repeat):
        wall, processor = time.perf_counter(), time.process_time()
        found = modes(case.model, count, formulation=case.rules)
        runs.append((time.process_time() - processor, time.perf_counter() - wall))
    program = f"gpusim, {found.method}"
    return Run(
        program, found.frequencies, *min(runs), "" if found.converged else found.message
    ), found


def _row(
    case: SpeedCase, count: int, own: Run, reference: Float, run: Run, found: Modes | None
) -> list[str]:
    head = [case.name, str(count), run.program, case.unknowns]
    if run.values is None:
        return [*head, "", "", "", "", run.failed]
    error = _error(run.values, reference)
    stated = "" if found is None else f"{found.error_estimate.max():.0e}"
    share = own.processor / run.processor
    times = [f"{run.processor:.2f}", f"{run.wall:.2f}"]
    return [
        *head,
        *times,
        error,
        stated,
        run.failed or f"{share:.0%}, {own.wall / run.wall:.0%} wall",
    ]


def _error(values: Float, reference: Float) -> str:
    if len(values) != len(reference):
        return f"{len(values)} modes"
    return f"{np.abs(np.sort(values) / reference - 1.0).max():.0e}"


STEPS_HEADINGS = (
    "case", "program", "unknowns", "steps", "processor s", "wall s", "ms a step",
    "iterations a step", "static solves", "differs", "gpusim over it, a step",
)  # fmt: skip
_PERIOD = 100.0
"""Steps in the first period."""


def steps_speed(
    size: str, name: str, count: int, peers: bool, limit: float, theirs: int = 10
) -> Iterator[list[str]]:
    """``count`` steps of the trapezoidal rule under a load that acts at once; CalculiX takes
    ``theirs``."""
    for case in speed_cases(size, name):
        if case.name.startswith("bracket"):
            continue
        (frequency,) = modes(case.model, 1, formulation=case.rules).frequencies
        step = 1.0 / (_PERIOD * frequency)
        processor = time.process_time()
        solve(case.model, formulation=case.rules, backend="numpy")
        static = time.process_time() - processor
        own, ours, told = newmark(case, step, count, theirs)
        yield [case.name, own.program, case.unknowns, str(count), f"{own.processor:.2f}",
               f"{own.wall:.2f}", f"{1e3 * own.processor / count:.1f}", told,
               f"{own.processor / static:.0f}", "", ""]  # fmt: skip
        if not peers:
            continue
        other = calculix_steps(case.model, case.rules, step, theirs, limit)
        if other.values is None:
            yield [case.name, other.program, case.unknowns, str(theirs), *[""] * 6, other.failed]
            continue
        differs = np.abs(other.values - ours).max() / np.abs(ours).max()
        share = (own.processor / count) / (other.processor / theirs)
        yield [case.name, other.program, case.unknowns, str(theirs), f"{other.processor:.2f}",
               f"{other.wall:.2f}", f"{1e3 * other.processor / theirs:.1f}", "", "",
               f"{differs:.0e}", f"{share:.1%}"]  # fmt: skip


def newmark(case: SpeedCase, step: float, count: int, early: int) -> tuple[Run, Float, str]:
    """A run from the model on, displacements (N,3) after ``early`` steps, and its iterations."""
    wall, processor = time.perf_counter(), time.process_time()
    times = step * np.array([0.0, early, count])
    history = transient(case.model, times=times, step=step, method="newmark",
                        formulation=case.rules)  # fmt: skip
    processor, wall = time.process_time() - processor, time.perf_counter() - wall
    return Run("gpusim, Newmark", None, processor, wall), history.u[1], history.message
