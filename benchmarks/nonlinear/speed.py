"""A cantilever bent to w/L = 0.3 and a waisted plate that yields, beside CalculiX."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.nonlinear.calculix import calculix
from gpusim.fem import J2, Isotropic, Model, Voce, face_force, solve
from gpusim.mesh import Mesh, box, select_faces
from tests.support.elastica import DistributedLoad, Strip, cantilever

HEADINGS = (
    "case", "program", "mesh", "unknowns", "Newton", "linear", "processor s", "wall s", "value",
    "share of CalculiX's",
)  # fmt: skip

Float = npt.NDArray[np.float64]
Divisions = tuple[int, int, int]
_STRIP = Strip(800.0, 40.0, 4.0, 210e3)


def bent_cantilever(divisions: Divisions) -> Model:
    """800 x 40 x 4, P L^2 / E I = 1."""
    mesh = box((_STRIP.length, _STRIP.width, _STRIP.height), divisions)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    load = _STRIP.bending / _STRIP.length**2
    end = select_faces(mesh, name="x_max")
    return Model(mesh, Isotropic(_STRIP.E, 0.0), fixed, face_force(mesh, end, (0.0, 0.0, load)))


def _bend(model: Model, u: Float) -> str:
    """How far the free end is off."""
    load = _STRIP.bending / _STRIP.length**2
    exact = cantilever(_STRIP, (0.0, load), DistributedLoad())[1]
    end = model.mesh.points[:, 0] == _STRIP.length
    return f"w off by {u[end, 2].mean() / exact - 1.0:.4%}"


def waisted_plate(divisions: Divisions) -> Model:
    """100 x 20 x 2, narrower by 30 % in the middle, pulled by 9960 N to a plastic strain of 7 %."""
    plate = box((100.0, 20.0, 2.0), divisions)
    points = plate.points.copy()
    waist = 1.0 - 0.3 * np.exp(-(((points[:, 0] - 50.0) / 12.5) ** 2))
    points[:, 1] = 10.0 + (points[:, 1] - 10.0) * waist
    mesh = Mesh(points, plate.cells)
    fixed = np.repeat(np.isclose(points[:, :1], 0.0), 3, axis=1)
    steel = J2(Isotropic(210e3, 0.3), 250.0, Voce(400.0, 20.0, 100.0))
    pull = face_force(mesh, select_faces(plate, name="x_max"), (9960.0, 0.0, 0.0))
    return Model(mesh, steel, fixed, pull)


def _stretch(model: Model, u: Float) -> str:
    """How far the pulled end moves."""
    return f"end by {u[np.isclose(model.mesh.points[:, 0], 100.0), 0].mean():.4f}"


@dataclass(frozen=True)
class Case:
    """Load steps of a model of some meshes, and what is said of the displacements."""

    name: str
    build: Callable[[Divisions], Model]
    factors: Sequence[float]
    value: Callable[[Model, Float], str]
    meshes: Sequence[Divisions]


CASES = (
    Case("cantilever", bent_cantilever, (1.0,), _bend, ((300, 9, 2), (500, 21, 2))),
    Case("plate that yields", waisted_plate, (0.25, 0.5, 0.75, 1.0), _stretch,
         ((120, 30, 2), (170, 63, 2))),
)  # fmt: skip


def speed(name: str, repeat: int, peers: bool) -> Iterator[list[str]]:
    """One row of text after the other; the least processor time of ``repeat`` runs counts."""
    for case in CASES:
        if name in case.name:
            # what is loaded once isn't counted
            solve(case.build((20, 2, 1)), geometry="nonlinear", factors=case.factors)
            for divisions in case.meshes:
                yield from _rows(case, divisions, repeat, peers)


def _rows(case: Case, divisions: Divisions, repeat: int, peers: bool) -> Iterator[list[str]]:
    model = case.build(divisions)
    other = calculix(model, case.factors[0]) if peers else None
    runs = []
    for _ in range(repeat):
        wall, processor = time.perf_counter(), time.process_time()
        # from the mesh on, as CalculiX's run
        solution = solve(case.build(divisions), geometry="nonlinear", factors=case.factors)
        runs.append((time.process_time() - processor, time.perf_counter() - wall))
    processor, wall = min(runs)
    every = [one for step in solution.steps for one in step.iterations]
    mesh, unknowns = "x".join(map(str, divisions)), f"{solution.unknowns:,}"
    yield [case.name, "gpusim", mesh, unknowns, str(len(every)), str(solution.iterations),
           f"{processor:.2f}", f"{wall:.2f}",
           case.value(model, solution.u),
           "" if other is None else f"{processor / other.processor:.1%}"]  # fmt: skip
    if other is not None:
        yield [case.name, "CalculiX C3D8I", mesh, unknowns, "", "", f"{other.processor:.2f}",
               f"{other.wall:.2f}", case.value(model, other.u),
               "100%"]  # fmt: skip
