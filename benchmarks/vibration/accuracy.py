"""NAFEMS' natural frequencies, forced vibration, prestress and buckling."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from gpusim.errors import GpusimError
from gpusim.fem import (
    ModalDamping,
    Model,
    Rayleigh,
    buckling,
    harmonic,
    modes,
    random_response,
    solve,
    stress,
    transient,
)
from tests.support.vibration_cases import (
    GuidedColumn,
    ModalCase,
    cantilever_plate,
    deep_beam,
    deep_beam_modes,
    free_plate,
    rhombic_plate,
    solid_plate,
    tapered_membrane,
)
from tests.support.vibration_reference import dense_buckling, dense_modes

Float = npt.NDArray[np.float64]
Result = TypeVar("Result")

HEADINGS = (
    "case", "mesh", "unknowns", "processor s", "wall s", "values", "reference", "error", "wanted",
    "reference is", "off what is published",
)  # fmt: skip
_AGREE = 1e-6
"""Error wanted against references of the same mesh."""


@dataclass(frozen=True)
class Row:
    """NAFEMS' case of a ``number`` on one mesh; ``wanted``: the error that it is to stay below."""

    number: str
    mesh: str
    build: Callable[[], ModalCase]
    wanted: float


ROWS = (
    Row("FV32", "hex20 16x8x1", partial(tapered_membrane, (16, 8, 1)), 3e-2),
    Row("FV32", "hex20 32x16x1", partial(tapered_membrane, (32, 16, 1)), 5e-4),
    Row("FV52", "hex20 4x4x1", solid_plate, 1e-3),
    Row("FV12", "hex20 reduced 16x16x1",
        partial(free_plate, "hex20", (16, 16, 1), "reduced"), 5e-3),
    Row("FV12", "hex20 24x24x1", partial(free_plate, "hex20", (24, 24, 1), "full"), 5e-3),
    Row("FV12", "hex8 48x48x2", partial(free_plate, "hex8", (48, 48, 2), "incompatible"), 5e-3),
    Row("FV16", "hex20 reduced 16x16x1",
        partial(cantilever_plate, "hex20", (16, 16, 1), "reduced"), 5e-3),
    Row("FV16", "hex20 reduced 24x24x1",
        partial(cantilever_plate, "hex20", (24, 24, 1), "reduced"), 5e-3),
    Row("FV22", "hex20 reduced 12x12x2",
        partial(rhombic_plate, "hex20", (12, 12, 2), "reduced"), 1e-2),
    Row("FV22", "hex20 reduced 16x16x2",
        partial(rhombic_plate, "hex20", (16, 16, 2), "reduced"), 5e-3),
    Row("Test 5", "hex20 10x2x2", partial(deep_beam_modes, "hex20", (10, 2, 2), "full"), 1e-2),
    Row("Test 5", "hex20 20x4x4", partial(deep_beam_modes, "hex20", (20, 4, 4), "full"), 1e-2),
    Row("Test 5", "hex8 40x8x8",
        partial(deep_beam_modes, "hex8", (40, 8, 8), "incompatible"), 1e-2),
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Quantity:
    """``values`` found in so many seconds of the processor and of the wall, and what they should
    be; ``error`` where it isn't the greatest relative one; ``message``: what isn't right."""

    case: str
    mesh: str
    unknowns: int
    seconds: tuple[float, float]
    values: Float
    expected: Float
    wanted: float
    source: str
    published: Float | None = None
    given_error: float | None = None
    message: str = ""

    @property
    def error(self) -> float:
        """Greatest, relative."""
        if self.given_error is not None:
            return self.given_error
        return float(np.abs(self.values / self.expected - 1.0).max())

    def row(self) -> list[str]:
        """What is said of it, in the order of `HEADINGS`."""
        off = ""
        if self.published is not None:
            off = f"{np.abs(self.values / self.published - 1.0).max():.1%}"
        error = _percent(self.error) + (f" ({self.message})" if self.message else "")
        return [
            self.case, self.mesh, f"{self.unknowns:,}", *(f"{one:.2f}" for one in self.seconds),
            _numbers(self.values), _numbers(self.expected), error, _percent(self.wanted),
            self.source, off,
        ]  # fmt: skip


def _numbers(values: Float) -> str:
    return " ".join(f"{value:.5g}" for value in np.atleast_1d(values))


def _percent(error: float) -> str:
    return f"{error:.3%}" if error >= 1e-5 else f"{error:.0e}"


def timed(work: Callable[[], Result]) -> tuple[Result, tuple[float, float]]:
    """What ``work`` returns, and its seconds of the processor and of the wall."""
    wall, processor = time.perf_counter(), time.process_time()
    found = work()
    return found, (time.process_time() - processor, time.perf_counter() - wall)


def natural_frequencies(row: Row) -> Quantity:
    """Of a row's case; raises GpusimError where there are none."""
    case = row.build()
    found, seconds = timed(lambda: modes(case.model, case.count, formulation=case.formulation))
    still, elastic = found.frequencies[: case.rigid], found.frequencies[case.rigid : case.count]
    error = float(np.abs(case.errors(found.frequencies)).max())
    if case.rigid and not still.max() <= 1e-4 * elastic[0]:
        error = float("inf")
    return Quantity(
        case.name, row.mesh, found.unknowns, seconds, elastic, case.expected, row.wanted,
        case.source, case.published, error, "" if found.converged else found.message,
    )  # fmt: skip


def forced_beam() -> Iterator[Quantity]:
    """NAFEMS' Tests 5H, 5T and 5R: by all that can find them, beside what is published and beside
    all modes of the same mesh."""
    mesh, model = "hex20 10x2x2", deep_beam()
    middle, top = (_nearest(model, place) for place in ((5.0, 0.0, 0.0), (5.0, 1.0, 0.0)))
    every, forces = dense_modes(model), model.load_cases[0]
    drag, light = Rayleigh(mass=5.36, stiffness=7.46e-5), ModalDamping(0.02)
    source, same = "NAFEMS R0016", "all modes of the mesh, dense"
    size = len(every.angular)

    shaken, seconds = timed(lambda: harmonic(model, [42.65], damping=light, count=16))
    parts = [stress(model, part) for part in (shaken.u[0].real, shaken.u[0].imag)]
    (at_top,) = np.flatnonzero(parts[0].node_of == top)
    bending = abs(parts[0].values[at_top, 0] + 1j * parts[1].values[at_top, 0])
    found = np.array([1e3 * abs(shaken.u[0, middle, 1]), 1e-6 * bending])
    yield Quantity("5H, 16 modes: mm, MPa at 42.65 Hz", mesh, size, seconds, found,
                   np.array([13.45, 241.9]), 0.02, source)  # fmt: skip
    exact = every.harmonic(forces, np.array([42.65]), 0.02)
    yield _beside("5H, 16 modes", mesh, size, seconds, shaken.u, exact, middle, same)

    times, ratios = np.linspace(0.0, 0.02, 201), drag.ratios(every.angular)
    whole = every.step_response(forces, times, np.minimum(ratios, 1.0 - 1e-9))
    static = every.harmonic(forces, np.zeros(1), 0.0)[0].real
    for method, options in (("modal", {"count": 16}), ("newmark", {"step": 1e-4})):
        history, seconds = timed(
            lambda m=method, o=options: transient(model, times=times, method=m, damping=drag, **o)
        )
        u = np.asarray(history.u)
        peak = int(u[:, middle, 1].argmax())
        found = np.array([1e3 * u[peak, middle, 1], times[peak], 1e3 * static[middle, 1]])
        yield Quantity(f"5T, {method}: mm, s, mm at rest", mesh, size, seconds, found,
                       np.array([1.043, 0.0117, 0.538]), 0.02, source)  # fmt: skip
        if method == "modal":
            few = every.lowest(16)
            exact = few.step_response(forces, times, drag.ratios(few.angular))
            exact += static - few.harmonic(forces, np.zeros(1), 0.0)[0].real
            yield _beside("5T, modal", mesh, size, seconds, u, exact, middle,
                          "16 modes, dense, and the statics of the others")  # fmt: skip
            yield _beside("5T, modal", mesh, size, seconds, u, whole, middle, same, 1e-2)
        else:
            exact = every.newmark(forces, 1e-4, 200, ratios)
            yield _beside("5T, newmark", mesh, size, seconds, u, exact, middle,
                          "trapezoidal rule of all modes, dense")  # fmt: skip

    spectrum = ([1.0, 100.0], [1.0, 1.0])
    random, seconds = timed(
        lambda: random_response(model, spectrum, damping=light, frequencies=[42.65], count=16)
    )
    found = 1e6 * random.psd[0, middle, 1:2]
    yield Quantity("5R, 16 modes: mm^2/Hz at 42.65 Hz", mesh, size, seconds, found,
                   np.array([180.90]), 0.02, source)  # fmt: skip
    exact = np.abs(every.harmonic(forces, np.array([42.65]), 0.02)) ** 2
    yield _beside("5R, 16 modes", mesh, size, seconds, random.psd, exact, middle, same)


def _nearest(model: Model, place: tuple[float, float, float]) -> int:
    return int(np.linalg.norm(model.mesh.points - np.array(place), axis=1).argmin())


def _beside(
    case: str, mesh: str, unknowns: int, seconds: tuple[float, float], u: npt.NDArray[np.generic],
    exact: npt.NDArray[np.generic], node: int, source: str, wanted: float = _AGREE,
) -> Quantity:  # fmt: skip
    """Greatest difference of all displacements over the greatest of them."""
    error = float(np.abs(u - exact).max() / np.abs(exact).max())
    values, expected = (np.array([np.abs(one[:, node, 1]).max()]) for one in (u, exact))
    return Quantity(case, mesh, unknowns, seconds, values, expected, wanted, source, None, error)


def prestressed_columns() -> Iterator[Quantity]:
    """Frequencies under half of the load that buckles it, pulled and pressed, and that load."""
    for length, cells in ((20.0, 10), (50.0, 20)):
        column, mesh = GuidedColumn(length), f"hex20 {cells}x1x1"
        for share in (0.5, 0.0, -0.5):
            tension = share * column.engesser
            model = column.model(tension, (cells, 1, 1))

            def vibrate(model: Model = model, loaded: bool = share != 0.0) -> tuple[Float, int]:
                state = solve(model, geometry="nonlinear", backend="numpy") if loaded else None
                found = modes(model, 1, prestress=state)
                return found.frequencies, found.unknowns

            (found, unknowns), seconds = timed(vibrate)
            expected = np.array([column.frequency(tension)])
            yield Quantity(f"column {length:g}x1x1, {share:+g} of its load", mesh, unknowns,
                           seconds, found, expected, 3e-3, "Timoshenko's beam")  # fmt: skip
        model = column.model(-1.0, (cells, 1, 1))
        buckled, seconds = timed(lambda model=model: buckling(model, 3))
        yield Quantity(
            f"column {length:g}x1x1 buckles",
            mesh,
            buckled.unknowns,
            seconds,
            buckled.factors[:1],
            np.array([column.engesser]),
            3e-3,
            "Engesser",
        )
        exact = dense_buckling(model)
        yield Quantity(f"column {length:g}x1x1, three loads", mesh, buckled.unknowns, seconds,
                       buckled.factors, exact[exact > 0.0][:3], _AGREE, "dense")  # fmt: skip


def accuracy(name: str) -> Iterator[list[str]]:
    """One row of text after the other, of cases whose name or number holds ``name``."""
    for row in ROWS:
        if name not in row.number:
            continue
        try:
            yield natural_frequencies(row).row()
        except GpusimError as error:
            yield [row.number, row.mesh, *[""] * 5, str(error), *[""] * 3]
    for group in (forced_beam, prestressed_columns):
        for quantity in group():
            if name in quantity.case:
                yield quantity.row()
