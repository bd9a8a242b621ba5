"""Transients: a body's response in time, by modes or step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.damping import Damping, Rayleigh, StructuralDamping
from gpusim.fem.model.history import (
    ENERGIES,
    FilePath,
    History,
    ModalMotion,
    State,
    Superposition,
    interpolated,
    storage,
    stored,
)
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.record import Record, increasing
from gpusim.fem.procedures.initial_value_problem import (
    Initial,
    InitialValueProblem,
    Loads,
    checked_model,
    initial_state,
    load_factors,
    with_moving_ground,
)
from gpusim.fem.procedures.modal_superposition import ModalResponse, modal_superposition
from gpusim.fem.procedures.modes import modes
from gpusim.fem.procedures.nonlinear_motion import NonlinearMotion
from gpusim.fem.procedures.time_integration import (
    METHODS,
    LinearMotion,
    Motion,
    Scheme,
    StepSize,
    time_steps,
)
from gpusim.parallel.blas_threads import one_blas_thread
from gpusim.validation import Count, Rule, Share, checked, is_number, one_of, require

Tolerance = Annotated[float, Rule("a number in (0, 1)", lambda value: 0.0 < value < 1.0)]
Progress = Callable[[int, float], None]

# of a step, by which an instant may be past its end
_SAME = 1e-9
# steps between two outputs, where nobody says how long they are
_SUBSTEPS = 4
# instants of modes, and frames of a body, that are worked on at a time
_INSTANTS, _FRAMES = 1024, 16
# share of an energy from which on a warning says that modes lack it
_LACKING = 0.01
# of the greatest displacement, in a step, from which on a warning says so
_WARNED_ERROR = 1e-3


@checked
def transient(
    model: Model,
    *,
    times: npt.ArrayLike,
    loads: Loads | None = None,
    method: Annotated[str, one_of("modal", *METHODS)] = "modal",
    damping: Damping | None = None,
    initial: Initial | None = None,
    base: Record | None = None,
    count: Count = 20,
    step: float | str | None = None,
    spectral_radius: Share = 0.9,
    tolerance: Tolerance = 1e-5,
    formulation: str | Mapping[str, str] | None = None,
    mass: Annotated[str, one_of(*MASS_RULES)] = "exact",
    geometry: Annotated[str, one_of("linear", "nonlinear")] = "linear",
    file: FilePath = None,
    progress: Progress | None = None,
) -> History:
    """Response in time."""
    at, names = increasing(times, "transient: times"), resolve_formulation(model, formulation)
    _check_damping(damping, method, geometry)
    first = _first_step(at, step)
    checked_model(model)
    factors = load_factors(loads, len(model.load_cases), at, first)
    problem = InitialValueProblem(model, names, mass, factors, *initial_state(model, initial))
    problem = with_moving_ground(problem, base)
    options = Options("auto", None, "numpy", tolerance, None, None, None, names, Clock())
    with one_blas_thread():
        if method == "modal":
            found = modes(model, count=count, formulation=names, mass=mass)
            response = modal_superposition(problem, found, damping, options)
            fields = superposed(response, at, file)
        else:
            scheme, rayleigh = Scheme.named(method, spectral_radius), damping or Rayleigh()
            problem.require_fine(first)
            moving = LinearMotion if geometry == "linear" else NonlinearMotion
            moved: Motion = moving(problem, scheme, rayleigh, options)
            adaptive = step == "adaptive"
            error = tolerance * moved.size(at[-1] - at[0]) if adaptive else np.inf
            steps = partial(time_steps, moved, control=StepSize(first, adaptive, error))
            fields = integrated(moved, steps, at, file, progress)
    options.clock.mark("response")
    return History(times=at, method=method, timings=options.clock.timings, model=model, **fields)


def _first_step(times: Float, step: float | str | None) -> float:
    """Of constant steps, or the longest of adaptive ones."""
    if step is None or step == "adaptive":
        return float(np.diff(times).min()) / _SUBSTEPS
    fits = is_number(step) and 0.0 < step < np.inf
    require(fits, "transient: step", repr(step), "a time above 0, 'adaptive', or None")
    return float(step)


def _check_damping(damping: Damping | None, method: str, geometry: str) -> None:
    """What can't be had in time, or with a method."""
    if damping is None:
        return
    what, got = "transient: damping", repr(damping)
    harmonic = isinstance(damping, StructuralDamping)
    require(not harmonic, what, got, "Rayleigh or ModalDamping: that of structures is harmonic")
    if method != "modal":
        require(isinstance(damping, Rayleigh), what, got, "Rayleigh, or method='modal'")
    if geometry == "nonlinear":
        require(damping.stiffness == 0.0, what, got, "stiffness=0: that would damp rotations")


def superposed(response: ModalResponse, times: Float, file: FilePath) -> dict[str, Any]:
    """Fields of a `History`: nothing that is as large as the body is kept for every instant, but in
    a file."""
    parts = np.array_split(times, 1 + len(times) // _INSTANTS)
    states = [(part, response.modes.at(part)) for part in parts]
    series = [
        Superposition(np.concatenate(amplitudes), response.shapes)
        for amplitudes in zip(*(response.amplitudes(*one) for one in states), strict=True)
    ]
    energies = zip(*(response.energies(*one) for one in states), strict=True)
    fields: dict[str, Any] = dict(zip("uva", series, strict=True))
    fields |= {name: np.concatenate(one) for name, one in zip(ENERGIES, energies, strict=True)}
    if file is not None:
        with storage(times, response.shapes.shape[1], file) as data:
            for name, values in fields.items():
                for first in range(0, len(times), _FRAMES):
                    frames = slice(first, first + _FRAMES)
                    data[name][frames] = values[frames]
    return stored(fields, file) | {
        "message": f"{len(response.modes.oscillators.angular)} modes",
        "modal": ModalMotion(response.shapes, response),
        "warnings": tuple(
            f"modes lack {share:.2g} of the energy of the {what}; more of them (count=...) lack "
            "less"
            for what, share in response.lacking.items()
            if share > _LACKING
        ),
    }


def integrated(
    motion: Motion,
    steps: Callable[[State], Iterable[tuple[State, float]]],
    times: Float,
    file: FilePath,
    progress: Progress | None,
) -> dict[str, Any]:
    """Fields of a `History`: states at ``times``, of the ``steps`` from the first one, and their
    errors."""
    worst, greatest, k = 0.0, 0.0, 1
    before = motion.begin(times[0])
    energies: Float | None = motion.energies(before)
    with storage(times, len(motion.displacements(before.u)), file) as fields:
        _keep(fields, 0, motion, before, energies)
        for number, (after, error) in enumerate(steps(before), 1):
            slack = _SAME * (after.time - before.time)
            worst, greatest = np.fmax(worst, error), max(greatest, float(np.abs(after.u).max()))
            if times[k] > after.time + slack:
                energies = None
            else:
                first = motion.energies(before) if energies is None else energies
                energies = motion.energies(after)
            while k < len(times) and times[k] <= after.time + slack:
                share = min((times[k] - before.time) / (after.time - before.time), 1.0)
                state = interpolated(before, after, share)
                _keep(fields, k, motion, state, (1.0 - share) * first + share * energies)
                k += 1
            if progress is not None:
                progress(number, after.time)
            if k == len(times):
                break
            before = after
    message = f"{number} steps, {motion.message}"
    worst /= greatest if greatest > 0.0 else 1.0
    warnings = ()
    if not worst <= _WARNED_ERROR:
        warnings = (
            f"a step is {worst:.1%} of the greatest displacement off: a shorter one, or "
            "step='adaptive', resolves more of the motion",
        )
    return {**stored(fields, file), "message": message, "warnings": warnings}


def _keep(fields: dict[str, Any], k: int, motion: Motion, state: State, energies: Float) -> None:
    """Write a state as the ``k``-th."""
    for name, x in zip("uva", (state.u, state.v, state.a), strict=True):
        fields[name][k] = motion.displacements(x)
    for name, value in zip(ENERGIES, [*energies, *state.gains], strict=True):
        fields[name][k] = value
