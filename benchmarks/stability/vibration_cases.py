"""The hard cases of vibration, family by family."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.stability.nonlinear_suite import WARNED
from benchmarks.stability.suite import TOLD
from benchmarks.stability.vibration_bodies import (
    NONE,
    STEEL,
    beside_dense,
    beside_extended,
    block,
    buckled,
    clamped,
    column,
    free_plate,
    held,
    joined_along,
    many_unknowns,
    of_modes,
    pressed,
    slender,
    sliding,
    soft_half,
    unused_node,
)
from benchmarks.stability.vibration_suite import Answer, VibrationCase
from gpusim.fem import (
    Isotropic,
    ModalDamping,
    Model,
    Rayleigh,
    Record,
    harmonic,
    modes,
    random_response,
    solve,
    transient,
)
from gpusim.mesh import box
from tests.support.fem_reference import bar
from tests.support.vibration_reference import dense_buckling, dense_modes

__all__ = ["vibration_cases"]

Float = npt.NDArray[np.float64]


def _shapes() -> Iterator[VibrationCase]:
    """Proportions, units, places, contrasts, incompressibility."""
    for length, cells in ((50, 40), (100, 80), (1000, 200), (10000, 400)):
        ask = partial(slender, length, 1.0, (cells, 1, 1))
        yield VibrationCase("slenderness", f"{length}", ask, 5e-3, same_mesh=False,
                            quick=length == 1000)  # fmt: skip
    for aspect in (10, 100, 1000):
        ask = partial(slender, 200.0, 2.5 * aspect, (80, 1, 1))
        yield VibrationCase("aspect of cells", f"{aspect}", ask, 5e-3, same_mesh=False,
                            quick=aspect == 1000)  # fmt: skip
    for name, scale, E in (("um", 1e-6, 210e9), ("mm", 1e-3, 210e9), ("km", 1e3, 210e9),
                           ("light seconds", 3e8, 210e9), ("weak", 1.0, 1e-6)):  # fmt: skip
        ask = partial(slender, 100.0, 1.0, (80, 1, 1), scale, E)
        yield VibrationCase("units", name, ask, 5e-3, same_mesh=False, quick=name == "um")
    for offset in (1e3, 1e6):
        ask = partial(slender, 50.0, 1.0, (40, 1, 1), offset=offset)
        yield VibrationCase("offset", f"{offset:g} lengths", ask, 5e-3, same_mesh=False)
    yield VibrationCase("offset", "a free block, 1e6 lengths", partial(beside_dense, lambda: Model(
        box((2.0, 1.0, 0.5), (4, 2, 2), origin=(2e6, 2e6, -2e6)), STEEL), 9), 1e-6)  # fmt: skip
    for contrast in (1e4, 1e6, 1e8):
        yield VibrationCase("E contrast", f"{contrast:g}, stiff root", partial(
            soft_half, contrast, True), 10.0 / contrast + 1e-6, same_mesh=False,
            quick=contrast == 1e8)  # fmt: skip
        yield VibrationCase("E contrast", f"{contrast:g}, stiff tip", partial(
            soft_half, contrast, False), quick=contrast == 1e6)  # fmt: skip
    for nu in (0.49, 0.4999, 0.499999):
        rubber = Isotropic(1e6, nu, density=1000.0)
        yield VibrationCase("nearly incompressible", f"{nu:g}", partial(
            beside_extended, partial(clamped, box((2.0, 1.0, 1.0), (6, 3, 3)), rubber),
            {"hex8": "bbar"}, 6), quick=nu == 0.4999)  # fmt: skip
    for kind, divisions in (("hex20", (3, 2, 2)), ("tet10", (3, 1, 1)), ("wedge15", (3, 2, 2))):
        yield VibrationCase("elements", kind, partial(
            beside_dense, partial(clamped, bar(kind, (2.0, 1.0, 0.5), divisions)), 8))  # fmt: skip
    for kind, rule, cells in (("hex8", "incompatible", 12), ("hex20", "reduced", 8)):
        ask = partial(free_plate, kind, rule, (cells, cells, 1))
        yield VibrationCase("slenderness", f"free plate of width/thickness 200, {kind}", ask, 1e-7,
                            quick=True)  # fmt: skip


def _free() -> Iterator[VibrationCase]:
    """Free bodies, hinges, mechanisms, motions without stiffness."""
    small = partial(box, (2.0, 1.0, 0.5), (4, 2, 2))
    yield VibrationCase("free", "a block", partial(
        beside_dense, lambda: Model(small(), STEEL), 10), quick=True)  # fmt: skip
    for shared, count in (("nothing", 14), ("edge", 9), ("corner", 11)):
        yield VibrationCase("free", f"two cubes that share {shared}", partial(
            beside_dense, lambda s=shared: Model(joined_along(s), STEEL), count),
            quick=shared == "edge")  # fmt: skip
    yield VibrationCase("free", "a hinge", partial(beside_dense, lambda: held(
        small(), lambda p: (p[:, 0] == 0.0) & (p[:, 2] == 0.0)), 5), quick=True)  # fmt: skip
    yield VibrationCase("free", "held at one node", partial(beside_dense, lambda: held(
        small(), lambda p: (p == 0.0).all(axis=1)), 6))  # fmt: skip
    yield VibrationCase("free", "slides along z", partial(beside_dense, sliding, 4))
    yield VibrationCase("mechanism", "a cube held, one hangs on its edge", partial(
        beside_dense, lambda: held(joined_along("edge"), lambda p: p[:, 0] == 0.0), 4),
        quick=True)  # fmt: skip
    yield VibrationCase("mechanism", "hex20 reduced, a single row", partial(
        _without_answer, lambda: clamped(bar("hex20", (6.0, 1.0, 1.0), (6, 1, 1))),
        formulation="reduced"), ending=TOLD, cause="reduced|stiffness", quick=True)  # fmt: skip
    yield VibrationCase("mesh", "a node of no cell", partial(beside_dense, unused_node, 4), 1e-8)


def _without_answer(build: Callable[[], Model], count: int = 4, **options: Any) -> Answer:
    found = modes(build(), count, **options)
    return of_modes(found, NONE, "none")


def _nonsense() -> Iterator[VibrationCase]:
    """Questions about modes that have no answer."""
    materials = {
        "zero density": lambda: Isotropic(210e9, 0.3, density=0.0),
        "negative density": lambda: Isotropic(210e9, 0.3, density=-1.0),
        "density NaN": lambda: Isotropic(210e9, 0.3, density=np.nan),
        "no density": lambda: Isotropic(210e9, 0.3),
    }
    for name, material in materials.items():
        yield VibrationCase("mass", name, partial(
            _without_answer, lambda m=material: block(materials=[m()])), ending=TOLD,
            cause="density", quick=name in ("zero density", "negative density"))  # fmt: skip
    wanted: dict[str, tuple[dict[str, Any], str]] = {
        "no modes": ({"count": 0}, "count"),
        "more modes than unknowns": ({"count": 10_000}, "unknowns"),
        "a band with 10,000 modes": ({"band": (0.0, 1e9)}, "narrower band"),
        "a band the wrong way around": ({"band": (10.0, 5.0)}, "band"),
        "a band of NaN": ({"band": (0.0, np.nan)}, "band"),
        "tolerance NaN": ({"tolerance": np.nan}, "tolerance"),
    }
    for name, (options, cause) in wanted.items():
        many = name.startswith("a band with")
        yield VibrationCase("modes", name, partial(
            _without_answer, many_unknowns if many else block, **options), ending=TOLD, cause=cause,
            quick=not many)  # fmt: skip
    yield VibrationCase("modes", "a band without modes", lambda: of_modes(
        modes(block(), band=(0.0, 1.0)), np.zeros(0), "none"))  # fmt: skip
    yield VibrationCase("prestress", "beyond buckling", partial(pressed, 1.5), ending=TOLD,
                        cause="stable|buckling|definite", quick=True)  # fmt: skip
    yield VibrationCase("prestress", "0.9 of buckling", partial(pressed, 0.9), 0.1,
                        same_mesh=False)  # fmt: skip
    yield VibrationCase("prestress", "of another model", lambda: of_modes(
        modes(block(), 3, prestress=solve(block(), backend="numpy")), NONE, "none"), ending=TOLD,
        cause="prestress")  # fmt: skip


def _buckling() -> Iterator[VibrationCase]:
    yield VibrationCase("buckling", "a column", lambda: buckled(column(-1.0)), 1e-6, quick=True)
    yield VibrationCase("buckling", "pulled", lambda: buckled(column(1.0), NONE), ending=TOLD,
                        cause="stiffens|positive", quick=True)  # fmt: skip
    changes: dict[str, tuple[Callable[[Model], Model], str]] = {
        "no load": (lambda m: replace(m, forces=None), "load"),
        "no supports": (lambda m: replace(m, fixed=None, prescribed=None), "free"),
        "two load cases": (lambda m: replace(m, forces=np.stack([m.load_cases[0]] * 2)), "case"),
    }
    for name, (change, cause) in changes.items():
        yield VibrationCase("buckling", name, lambda c=change: buckled(c(column(-1.0)), NONE),
                            ending=TOLD, cause=cause, quick=name == "no load")  # fmt: skip
    yield VibrationCase("buckling", "a load of 1e-100", lambda: buckled(
        column(-1e-100), dense_buckling(column(-1.0))[:1] * 1e100), 1e-6)  # fmt: skip


def _response(**options: Any) -> Answer:
    """The end's displacement after half a period of the first mode, under a load that acts from the
    beginning on: the sum of all modes."""
    model = block()
    every = dense_modes(model)
    half = 0.5 / every.frequencies[0]
    times = options.pop("times", np.linspace(0.0, 1.0, 51))
    damping, expected = options.get("damping"), NONE
    if not options.pop("nonsense", False):
        ratio = np.zeros(len(every.angular)) if damping is None else damping.ratios(every.angular)
        expected = every.step_response(model.load_cases[0], np.array([half]), ratio)[0, -1, 2:]
    found = transient(model, times=half * np.asarray(times), **options)
    value = np.asarray(found.u[len(found.times) - 1])[-1, 2:]
    says = "; ".join(found.warnings)
    return Answer(value, expected, "all modes, dense", says=says)


def _in_time() -> Iterator[VibrationCase]:
    """Steps, records, loads, dampings."""
    close: dict[str, tuple[dict[str, Any], float]] = {
        "all modes": ({"method": "modal", "count": 60}, 1e-3),
        "newmark": ({"method": "newmark"}, 5e-3),
        "hht": ({"method": "hht"}, 2e-2),
        "generalized-alpha": ({"method": "generalized-alpha"}, 2e-2),
        "adaptive": ({"method": "newmark", "step": "adaptive", "tolerance": 1e-6}, 5e-3),
        "damped": ({"method": "newmark", "damping": Rayleigh(10.0, 1e-6)}, 5e-3),
    }
    for name, (options, tolerance) in close.items():
        yield VibrationCase("in time", name, partial(_response, **options), tolerance,
                            quick=name == "newmark")  # fmt: skip
    yield VibrationCase("steps", "of a period", partial(
        _response, method="newmark", times=[0.0, 2.0, 4.0], step=2e-3), ending=WARNED,
        cause="shorter", tolerance=10.0)  # fmt: skip
    wrong: dict[str, tuple[dict[str, Any], str]] = {
        "step longer than all of it": ({"method": "newmark", "step": 1e3}, "step"),
        "step 0": ({"method": "newmark", "step": 0.0}, "step"),
        "step NaN": ({"method": "newmark", "step": np.nan}, "step"),
        "times that go back": ({"times": [0.0, 1.0, 0.5]}, "times"),
        "times of NaN": ({"times": [0.0, np.nan]}, "times"),
        "one instant": ({"times": [0.0]}, "times"),
        "loads of NaN": ({"loads": np.full(51, np.nan)}, "loads"),
        "loads of too few instants": ({"loads": np.ones(7)}, "loads"),
        "negative damping": ({"damping": "negative"}, "damping|Damping|Rayleigh"),
        "velocity of NaN": ({"initial": "velocity"}, "initial"),
        "no such method": ({"method": "euler"}, "method"),
    }
    for name, (options, cause) in wrong.items():
        yield VibrationCase("in time", name, partial(_asked_wrongly, options), ending=TOLD,
                            cause=cause, quick=name in ("step NaN", "loads of NaN"))  # fmt: skip
    yield VibrationCase("records", "NaN in a record", lambda: _ground([0.0, np.nan, 1.0]),
                        ending=TOLD, cause="Record", quick=True)  # fmt: skip
    yield VibrationCase("records", "ends too early", lambda: _ground([0.0, 1.0, 1.0], 0.5),
                        ending=TOLD, cause="base|times")  # fmt: skip


def _asked_wrongly(options: dict[str, Any]) -> Answer:
    given = dict(options)
    if given.get("damping") == "negative":
        given["damping"] = Rayleigh(-1.0, 0.0)
    if given.get("initial") == "velocity":
        zero = np.zeros_like(block().mesh.points)
        given["initial"] = (zero, np.full_like(zero, np.nan))
    return _response(nonsense=True, **given)


def _ground(values: list[float], end: float = 1.0) -> Answer:
    table = np.zeros((3, 3))
    table[:, 0] = values
    record = Record(np.array([0.0, 0.5 * end, end]), table)
    found = transient(block(), times=np.linspace(0.0, 1.0, 11), base=record)
    return Answer(np.asarray(found.u[10])[-1], np.full(3, np.nan), "none")


def _in_frequency() -> Iterator[VibrationCase]:
    """Resonances without damping, frequencies and spectra that make no sense."""
    light = ModalDamping(0.02)
    yield VibrationCase("in frequency", "at a resonance", partial(_amplitude, light, 1.0), 1e-3,
                        quick=True)  # fmt: skip
    yield VibrationCase("in frequency", "a resonance that nothing damps", partial(
        _amplitude, None, 1.0), ending=TOLD, cause="resonance|damp")  # fmt: skip
    for name, share in (("NaN", np.nan), ("below zero", -1.0)):
        yield VibrationCase("in frequency", f"a frequency {name}", partial(
            _amplitude, light, share), ending=TOLD, cause="frequenc")  # fmt: skip
    yield VibrationCase("in frequency", "beyond the last mode", partial(
        _amplitude, light, 1e3), ending=TOLD, cause="mode|count", quick=True)  # fmt: skip
    spectra = {"below zero": ([1.0, 10.0], [1.0, -1.0]), "NaN": ([1.0, 10.0], [1.0, np.nan]),
               "from 0 Hz": ([0.0, 10.0], [1.0, 1.0]), "that goes back": ([10.0, 1.0], [1.0, 1.0]),
               "of one frequency": ([1.0], [1.0])}  # fmt: skip
    for name, psd in spectra.items():
        yield VibrationCase("in frequency", f"a spectrum {name}", partial(_spectrum, psd),
                            ending=TOLD, cause="psd", quick=name == "NaN")  # fmt: skip


def _amplitude(damping: ModalDamping | None, share: float) -> Answer:
    """Of the end, at a ``share`` of the first frequency."""
    model = block()
    every = dense_modes(model)
    at = share * every.frequencies[:1]
    if damping is None:
        at, expected = modes(model, 1).frequencies, NONE
    elif not 0.0 < share < 100.0:
        expected = NONE
    else:
        ratios = damping.ratios(every.angular)
        expected = np.abs(every.harmonic(model.load_cases[0], at, ratios))[0, -1, 2:]
    found = harmonic(model, at, damping=damping)
    return Answer(found.amplitude[0, -1, 2:], expected, "all modes, dense")


def _spectrum(psd: tuple[list[float], list[float]]) -> Answer:
    found = random_response(block(), psd, damping=ModalDamping(0.02))
    return Answer(found.rms[-1], np.full(3, np.nan), "none")


def vibration_cases() -> Iterator[VibrationCase]:
    """Every case, family by family."""
    for family in (_shapes, _free, _nonsense, _buckling, _in_time, _in_frequency):
        yield from family()
