"""Bodies of the hard cases of vibration, and what is asked of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.stability.vibration_suite import Answer
from benchmarks.vibration.rayleigh import rayleigh_frequencies
from gpusim.fem import Isotropic, Model, Modes, buckling, face_force, modes, solve
from gpusim.mesh import Mesh, box, select_faces
from tests.support.fem_reference import bar
from tests.support.vibration_reference import dense_buckling, dense_modes

Float = npt.NDArray[np.float64]
Divisions = tuple[int, int, int]
STEEL = Isotropic(210e9, 0.3, density=7850.0)
NONE = np.array([np.nan])
"""Where there is no answer."""


def clamped(mesh: Mesh, *materials: Isotropic, second: float = np.inf) -> Model:
    """At the least x; cells with a middle beyond ``second`` are of the second material. Pulled at
    the greatest x along z, by 1 over all of it."""
    low, high = mesh.bounds
    fixed = np.repeat(mesh.points[:, :1] <= low[0] + 1e-9 * (high[0] - low[0]), 3, axis=1)
    middles = np.concatenate([mesh.points[cells].mean(axis=1) for _, _, cells in mesh.blocks()])
    end = face_force(mesh, select_faces(mesh, plane=(high, "+x")), (0.0, 0.0, 1.0))
    which = (middles[:, 0] > second).astype(np.int32)
    return Model(mesh, list(materials) or [STEEL], fixed, end, material_of_cell=which)


def block(**changes: Any) -> Model:
    """A small one that nothing is wrong with, but for what is changed."""
    return replace(clamped(box((2.0, 1.0, 0.5), (6, 3, 2))), **changes)


def of_modes(found: Modes, expected: Float, source: str) -> Answer:
    """What is said of modes, judged by frequencies."""
    says = "; ".join([*found.warnings, "" if found.converged else found.message]).strip("; ")
    stated = float(found.error_estimate.max(initial=0.0))
    return Answer(found.frequencies, expected, source, stated, found.converged, says,
                  found.unknowns)  # fmt: skip


def beside_dense(build: Callable[[], Model], count: int, **options: Any) -> Answer:
    """Beside all modes of the mesh."""
    model = build()
    exact = dense_modes(model, options.get("formulation")).frequencies[:count]
    found = modes(model, count, **options)
    # free motions of the reference are rounding
    still = exact <= 1e-4 * exact[-1]
    return of_modes(found, np.where(still, 0.0, exact), "dense")


def beside_extended(build: Callable[[], Model], rules: dict[str, str], count: int) -> Answer:
    """Beside energies of the shapes in extended precision: what rounding does to a stiff body."""
    model = build()
    found = modes(model, count, formulation=rules)
    return of_modes(found, rayleigh_frequencies(model, rules, found.shapes), "80 bits")


def slender(length: float, width: float, divisions: Divisions, scale: float = 1.0,
            E: float = 210e9, offset: float = 0.0) -> Answer:  # fmt: skip
    """Two bending modes of a cantilever 1 thick, in its softer plane, by Euler and Bernoulli, in
    units ``scale`` times as small, its clamped end ``offset`` lengths away."""
    mesh = box((length * scale, width * scale, scale), divisions,
               origin=(offset * length * scale,) * 3)  # fmt: skip
    model = clamped(mesh, Isotropic(E, 0.0, density=7850.0))
    fixed = np.array(model.fixed)
    # in its plane
    fixed[:, 1] = True
    found = modes(replace(model, fixed=fixed, prescribed=None), 2)
    waves = np.array([1.8751040687, 4.6940911330]) / (length * scale)
    expected = waves**2 * np.sqrt(E * scale**2 / 12.0 / 7850.0) / (2.0 * np.pi)
    return of_modes(found, expected, "Euler's beam")


def soft_half(contrast: float, stiff_root: bool) -> Answer:
    """Half of a rod ``contrast`` times as stiff as the other: a soft one on a rigid base, or the
    same with energies of the shapes in extended precision."""
    mesh = box((4.0, 1.0, 1.0), (12, 3, 3))
    soft = Isotropic(210e9 / contrast, 0.3, density=7850.0)
    rules = {"hex8": "incompatible"}
    if not stiff_root:
        return beside_extended(partial(clamped, mesh, soft, STEEL, second=2.0), rules, 4)
    model = clamped(mesh, STEEL, soft, second=2.0)
    alone = clamped(box((2.0, 1.0, 1.0), (6, 3, 3)), soft)
    expected = dense_modes(alone).frequencies[:4]
    return of_modes(modes(model, 4, formulation=rules), expected, "the soft half alone, dense")


def free_plate(kind: str, rule: str, divisions: Divisions) -> Answer:
    """Its elastic modes."""
    model, rules = Model(bar(kind, (10.0, 10.0, 0.05), divisions), STEEL), {kind: rule}
    found = modes(model, 12, formulation=rules, tolerance=1e-6)
    elastic = rayleigh_frequencies(model, rules, found.shapes[6:])
    return of_modes(found, np.concatenate([np.zeros(6), elastic]), "80 bits")


def joined_along(shared: str) -> Mesh:
    """Two cubes that share an edge, a corner, or nothing."""
    one = box((1.0, 1.0, 1.0), (2, 2, 2))
    move = {"edge": (1.0, 1.0, 0.0), "corner": (1.0, 1.0, 1.0), "nothing": (3.0, 0.0, 0.0)}
    points = np.concatenate([one.points, one.points + np.array(move[shared])])
    cells = np.concatenate([one.cells["hex8"], one.cells["hex8"] + one.node_count])
    merged, number = np.unique(points.round(9), axis=0, return_inverse=True)
    return Mesh(merged, {"hex8": number.ravel()[cells]})


def held(mesh: Mesh, where: Callable[[Float], npt.NDArray[np.bool_]]) -> Model:
    return Model(mesh, STEEL, np.repeat(where(mesh.points)[:, None], 3, axis=1))


def sliding() -> Model:
    mesh = box((2.0, 1.0, 0.5), (4, 2, 2))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[mesh.points[:, 0] == 0.0, :2] = True
    return Model(mesh, STEEL, fixed)


def unused_node() -> Model:
    mesh = box((2.0, 1.0, 0.5), (4, 2, 2))
    points = np.concatenate([mesh.points, [[5.0, 5.0, 5.0]]])
    fixed = np.repeat(points[:, :1] == 0.0, 3, axis=1)
    fixed[-1] = True
    return Model(Mesh(points, mesh.cells), STEEL, fixed)


def many_unknowns() -> Model:
    return clamped(box((2.0, 1.0, 0.5), (24, 14, 8)))


def pressed(share: float) -> Answer:
    """A column under a share of the load that buckles it: f^2 falls with it."""
    model = column(-1.0)
    factor = float(dense_buckling(model)[0])
    state = solve(column(-share * factor), backend="numpy")
    assert state.model is not None
    still = dense_modes(model).frequencies[0]
    found = modes(state.model, 1, prestress=state)
    expected = np.array([still * np.sqrt(max(1.0 - share, 0.0))]) if share < 1.0 else NONE
    return of_modes(found, expected, "straight line to the dense load")


def column(force: float) -> Model:
    """20 x 1 x 1, moving in its plane, pulled at its end along x by a force."""
    mesh = bar("hex20", (20.0, 1.0, 1.0), (8, 1, 1))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[:, 1] = True
    fixed[mesh.points[:, 0] == 0.0] = True
    end = select_faces(mesh, plane=((20.0, 0.0, 0.0), "+x"))
    return Model(
        mesh, Isotropic(1.0, 0.0, density=1.0), fixed, face_force(mesh, end, (force, 0, 0))
    )


def buckled(model: Model, expected: Float | None = None) -> Answer:
    found = buckling(model, 1)
    expected = dense_buckling(model)[:1] if expected is None else expected
    says = "; ".join([*found.warnings, "" if found.converged else found.message]).strip("; ")
    return Answer(found.factors, expected, "dense", float(found.error_estimate.max()),
                  found.converged, says, found.unknowns)  # fmt: skip
