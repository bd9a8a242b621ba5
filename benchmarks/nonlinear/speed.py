"""A cantilever bent to w/L = 0.3, beside CalculiX."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from benchmarks.nonlinear.calculix import calculix
from gpusim.fem import Isotropic, Model, face_force, solve
from gpusim.mesh import box, select_faces
from tests.support.elastica import DistributedLoad, Strip, cantilever

HEADINGS = (
    "program", "mesh", "unknowns", "Newton", "linear", "processor s", "wall s", "error of w",
    "share of CalculiX's",
)  # fmt: skip

_STRIP = Strip(800.0, 40.0, 4.0, 210e3)
_MESHES = ((300, 9, 2), (500, 21, 2))


def bent_cantilever(divisions: tuple[int, int, int]) -> Model:
    """800 x 40 x 4, P L^2 / E I = 1."""
    mesh = box((_STRIP.length, _STRIP.width, _STRIP.height), divisions)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    load = _STRIP.bending / _STRIP.length**2
    end = select_faces(mesh, name="x_max")
    return Model(mesh, Isotropic(_STRIP.E, 0.0), fixed, face_force(mesh, end, (0.0, 0.0, load)))


def speed(repeat: int, peers: bool) -> Iterator[list[str]]:
    """One row of text after the other; the least processor time of ``repeat`` runs counts."""
    load = _STRIP.bending / _STRIP.length**2
    exact = cantilever(_STRIP, (0.0, load), DistributedLoad())[1]
    solve(bent_cantilever((20, 1, 1)), geometry="nonlinear")  # what is loaded once isn't counted
    for divisions in _MESHES:
        mesh = "x".join(map(str, divisions))
        model = bent_cantilever(divisions)
        end = model.mesh.points[:, 0] == _STRIP.length
        other = calculix(model) if peers else None
        runs = []
        for _ in range(repeat):
            wall, processor = time.perf_counter(), time.process_time()
            # from the mesh on, as CalculiX's run
            solution = solve(bent_cantilever(divisions), geometry="nonlinear")
            runs.append((time.process_time() - processor, time.perf_counter() - wall))
        processor, wall = min(runs)
        every = [one for step in solution.steps for one in step.iterations]
        share = "" if other is None else f"{processor / other[1]:.1%}"
        yield ["gpusim", mesh, f"{solution.unknowns:,}", str(len(every)),
               str(solution.iterations), f"{processor:.2f}", f"{wall:.2f}",
               f"{solution.u[end, 2].mean() / exact - 1.0:.4%}", share]  # fmt: skip
        if other is not None:
            u, processor, wall = other
            yield ["CalculiX C3D8I", mesh, f"{solution.unknowns:,}", "", "", f"{processor:.2f}",
                   f"{wall:.2f}", f"{u[end, 2].mean() / exact - 1.0:.4%}", "100%"]  # fmt: skip
