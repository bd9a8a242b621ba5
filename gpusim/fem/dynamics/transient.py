"""Transients: a body's response in time, by modes or step by step."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.dynamics.initial_value_problem import (
    Initial,
    InitialValueProblem,
    Loads,
    drifts,
    initial_state,
    load_factors,
    with_moving_ground,
)
from gpusim.fem.dynamics.modal_superposition import ModalMotion, modal_superposition
from gpusim.fem.dynamics.nonlinear_motion import NonlinearMotion
from gpusim.fem.dynamics.phase_error import PhaseError
from gpusim.fem.dynamics.time_integration import (
    METHODS,
    LinearMotion,
    Scheme,
    time_steps,
)
from gpusim.fem.eigenvalues.modes import modes
from gpusim.fem.linear.solve_plan import Clock, Options
from gpusim.fem.model.damping import Damping, ModalDamping, Rayleigh
from gpusim.fem.model.history import (
    ENERGIES,
    FilePath,
    History,
    State,
    Superposition,
    interpolated,
    storage,
    written,
)
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.model.record import Record, increasing
from gpusim.fem.model.supports import check_still
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
# error of each solution, at most: that of adaptive steps may be greater
_SOLUTION = 1e-5
# of the sum of a load over time, that steps may miss; of the whole time, how short they may get
_MISSED, _FINEST = 0.05, 1e-6
# of the greatest displacement, in a step, from which on a warning says so
_WARNED_ERROR = 1e-3
# of a cycle, by which vibration may lag at the end without a word
_WARNED_LAG = 0.01


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
    """Response of a body to loads over time, by linear theory or at large displacements.

    Parameters
    ----------
    model : see `gpusim.Model`; its materials need densities.
    times : (T,) increasing; the first one is when it begins.
    loads : factors of the model's load cases, linear in between: (T,), or (T,L) of L cases, at
        ``times``; or a `Record` with times of its own (an impact; a moving load, one case a place).
        None: 1 from the first instant on.
    method : "modal": of ``count`` modes, exact between instants at which loads bend; or steps by
        "newmark" (trapezoidal rule), "hht" or "generalized-alpha", of second order.
    damping : `Rayleigh`, or with "modal" `ModalDamping`.
    initial : None: at rest. A `Solution` that is let go, or displacement and velocity, (N,3) each.
    base : accelerations of the ground, a `Record` (R,3); displacements are relative to it.
    step : length of steps; None: a quarter of the shortest between ``times``, or less where loads
        ask for it; "adaptive": that at most, and none is more than ``tolerance`` of the greatest
        displacement off.
    spectral_radius : what "hht" and "generalized-alpha" leave in a step of motions that are much
        too quick for it: 1 all, 0 nothing.
    tolerance : error of the solution of each step, relative.
    formulation, mass : see `gpusim.modes`. geometry : "linear" or "nonlinear".
    file : HDF5 file that the history is streamed to. progress : called with (steps, time).

    Raises InputError for wrong arguments, steps too long for the loads and histories larger than
    memory, NotConverged for a step that can't be found or adds energy to the body: it is too long.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> push = gs.fem.face_force(bar, gs.mesh.select_faces(bar, name="x_max"), total=(0, 0, 1e3))
    >>> model = gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0), fixed, push)
    >>> times = np.linspace(0, 0.012, 61)
    >>> history = gs.transient(model, times=times, damping=gs.ModalDamping(0.02))
    >>> f"{np.asarray(history.u)[:, -1, 2].max() / gs.solve(model).u[-1, 2]:.2f}"
    '1.90'
    """
    check_still(model, "transient")
    at, names = increasing(times, "transient: times"), resolve_formulation(model, formulation)
    _check_fit(method, damping, geometry, step)
    factors = load_factors(loads, len(model.load_cases), at)
    problem = InitialValueProblem(model, names, mass, factors, *initial_state(model, initial))
    problem = with_moving_ground(problem, base)
    sharp = min(tolerance, _SOLUTION)
    options = Options("auto", None, "numpy", sharp, None, None, None, names, Clock())
    with one_blas_thread():
        if method == "modal":
            found = modes(model, count, formulation=names, mass=mass)
            fields = superposed(modal_superposition(problem, found, damping, options), at, file)
            fields["unknowns"] = found.unknowns
        else:
            rayleigh = damping if isinstance(damping, Rayleigh) else Rayleigh()
            first = _step_length(problem, at, step)
            kind = LinearMotion if geometry == "linear" else NonlinearMotion
            motion = kind(problem, Scheme.named(method, spectral_radius), rayleigh, options)
            error = tolerance * motion.size(at[-1] - at[0]) if step == "adaptive" else np.inf
            states = time_steps(motion, first, error, motion.begin(at[0]))
            fields = integrated(motion, states, at, file, progress)
    fields["warnings"] += tuple(drifts(model, base, at))
    options.clock.mark("response")
    return History(times=at, method=method, timings=options.clock.timings, model=model, **fields)


def _step_length(problem: InitialValueProblem, times: Float, step: float | str | None) -> float:
    """Of constant steps, or the longest of adaptive ones: where none is given, one that misses
    little of the loads. Raises InputError for one that misses more."""
    given, what, whole = is_number(step), "transient: step", float(np.ptp(times))
    length = float(step) if given else float(np.diff(times).min()) / _SUBSTEPS  # type: ignore[arg-type]
    fits = (given or step in (None, "adaptive")) and 0.0 < length < np.inf
    require(fits, what, repr(step), "a time above 0, 'adaptive', or None")
    require(length <= whole, f"{what}, too long", length, f"at most {whole:.6g}, all of it")
    while (missed := problem.missed(length)) > _MISSED:
        got = f"{length:.3g}, which misses {missed:.0%} of a load in between"
        fits = not given and length > _FINEST * whole
        require(fits, f"{what}, too long", got, f"{_MISSED:.0%} at most")
        length *= 0.5
    return length


def _check_fit(method: str, damping: Damping | None, geometry: str, step: Any) -> None:
    """Raises InputError for what a method can't do."""
    by_modes, expected = method == "modal", "None: it takes no steps"
    require(not by_modes or step is None, "transient: step of method 'modal'", step, expected)
    fits, what = geometry == "linear" or not by_modes, "transient: method at large displacements"
    require(fits, what, method, f"one of {', '.join(METHODS)}")
    known = isinstance(damping, Rayleigh | None) or (by_modes and isinstance(damping, ModalDamping))
    expected = "Rayleigh, or of modes ModalDamping; that of structures is harmonic"
    require(known, "transient: damping", repr(damping), expected)
    turning = geometry != "linear" and isinstance(damping, Rayleigh) and damping.stiffness > 0.0
    expected = "stiffness=0 at large displacements: it would damp rotations"
    require(not turning, "transient: damping", repr(damping), expected)


def superposed(motion: ModalMotion, times: Float, file: FilePath) -> dict[str, Any]:
    """Fields of a `History`: nothing that is as large as the body is kept for every instant, but in
    a file."""
    parts = np.array_split(times, 1 + len(times) // _INSTANTS)
    *amplitudes, energies = zip(*(motion.coordinates(part) for part in parts), strict=True)
    series = [Superposition(np.concatenate(one), motion.shapes) for one in amplitudes]
    fields: dict[str, Any] = dict(zip("uva", series, strict=True))
    fields |= dict(zip(ENERGIES, np.hstack(energies), strict=True))
    if file is not None:
        with storage(times, motion.shapes.shape[1], file) as data:
            for name, values in fields.items():
                for first in range(0, len(times), _FRAMES):
                    frames = slice(first, first + _FRAMES)
                    data[name][frames] = values[frames]
    return written(fields, file) | {
        "message": f"{len(motion.modes.angular)} modes",
        "modal": motion,
        "warnings": tuple(
            f"modes lack {share:.2g} of the energy of the {what}; more of them (count=...) lack "
            "less"
            for what, share in motion.lacking.items()
            if share > _LACKING
        ),
    }


def integrated(
    motion: LinearMotion,
    states: Iterator[tuple[State, float]],
    times: Float,
    file: FilePath,
    progress: Progress | None,
) -> dict[str, Any]:
    """Fields of a `History` at ``times``, of ``states`` one step after the other from the first
    instant on, and their errors."""
    worst, greatest, k = 0.0, 0.0, 1
    before, _ = next(states)
    phase = PhaseError(motion.scheme)
    with storage(times, len(motion.displacements(before.u)), file) as fields:
        _keep(fields, 0, motion, (before.u, before.v, before.a), motion.energies(before))
        for number, (after, error) in enumerate(states, 1):
            slack = _SAME * (after.time - before.time)
            phase.add(before, after)
            worst, greatest = np.fmax(worst, error), max(greatest, float(np.abs(after.u).max()))
            while k < len(times) and times[k] <= after.time + slack:
                share = min((times[k] - before.time) / (after.time - before.time), 1.0)
                begin, end = motion.energies(before), motion.energies(after)
                state, energies = interpolated(before, after, share), begin + share * (end - begin)
                _keep(fields, k, motion, state, energies)
                k += 1
            if progress is not None:
                progress(number, after.time)
            if k == len(times):
                break
            before = after
    worst /= greatest if greatest > 0.0 else 1.0
    warnings = [
        f"{text}: a shorter step (step_s of scenes; of gs.transient also step='adaptive') resolves "
        "more of the motion"
        for text, poor in (
            (f"a step is {worst:.1%} of the greatest displacement off", worst > _WARNED_ERROR),
            (f"vibration at {phase.frequency:.3g} Hz, the mean, lags by {phase.cycles:.1%} of a "
             "cycle at the end", phase.cycles > _WARNED_LAG),
        )
        if poor
    ]  # fmt: skip
    how = {
        "message": f"{number} steps, {motion.message}; {phase.cycles:.1e} cycles late at the end",
        "warnings": tuple(warnings),
        "unknowns": int(motion.equation.unknown.sum()),
    }
    return written(fields, file) | how


def _keep(
    fields: dict[str, Any], k: int, motion: LinearMotion, state: Iterable[Float], energies: Float
) -> None:
    """Write u, v, a and energies as the ``k``-th."""
    for name, x in zip("uva", state, strict=True):
        fields[name][k] = motion.displacements(x)
    for name, value in zip(ENERGIES, energies, strict=True):
        fields[name][k] = value
