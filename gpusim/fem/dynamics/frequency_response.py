"""Frequency-response functions: what one point does per unit of force at another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Complex
from gpusim.fem.dynamics.harmonic import harmonic
from gpusim.fem.model.damping import Damping
from gpusim.fem.model.mass import MASS_RULES
from gpusim.fem.model.model import Model
from gpusim.fem.model.modes import Modes
from gpusim.fem.model.solution import Solution
from gpusim.mesh import Mesh
from gpusim.validation import Count, checked, finite_numbers, is_number, one_of, require

_DERIVATIVES = {"receptance": 0, "mobility": 1, "accelerance": 2}
# of the mesh's extent: a point as near as that to a node is this node
_NEAR = 1e-6


@checked
def frequency_response(
    model: Model,
    frequencies: npt.ArrayLike,
    *,
    at: tuple[npt.ArrayLike, str],
    response: tuple[npt.ArrayLike, str] | None = None,
    kind: Annotated[str, one_of(*_DERIVATIVES)] = "receptance",
    damping: Damping | None = None,
    count: Count = 20,
    modes: Modes | None = None,
    formulation: str | Mapping[str, str] | None = None,
    mass: Annotated[str, one_of(*MASS_RULES)] = "exact",
    prestress: Solution | None = None,
) -> Complex:
    """(F,) complex response of one point per unit of force at another.

    Parameters
    ----------
    model : its own loads don't count.
    frequencies : (F,) Hz, from 0 up.
    at : where the force acts: a node's number, or a point (3,) where one is, and "x", "y" or "z".
    response : what is looked at, likewise; None: the same as ``at``, the driving point.
    kind : "receptance" (displacement over force), "mobility" (velocity) or "accelerance".
    damping, count, modes, formulation, mass, prestress : as for `gpusim.harmonic`.

    Raises InputError for a point without a node, and what `gpusim.harmonic` raises.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> model = gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0), fixed)
    >>> damping, tip = gs.ModalDamping(0.01), ((1, 0, 0), "y")
    >>> h = gs.frequency_response(model, [0.0, 80.0, 160.0], at=tip, damping=damping)
    >>> [f"{1e9 * value:.1f} nm/N" for value in abs(h)]
    ['190.5 nm/N', '2012.1 nm/N', '61.4 nm/N']
    """
    node, axis = _place(model.mesh, at, "frequency response: at")
    seen, along = _place(model.mesh, response or at, "frequency response: response")
    assert model.fixed is not None
    held = bool(model.fixed[node, axis])
    require(not held, "frequency response: at", f"node {node}", "a node that can move")
    force = np.zeros(model.mesh.points.shape)
    force[node, axis] = 1.0
    pushed = replace(model, forces=force, prescribed=None, loads=(), temperature=None)
    found = harmonic(
        pushed, frequencies, damping=damping, count=count, modes=modes, formulation=formulation,
        mass=mass, prestress=prestress,
    )  # fmt: skip
    receptance = found.coordinates @ found.shapes[:, seen, along]
    return np.asarray(receptance * (2j * np.pi * found.frequencies) ** _DERIVATIVES[kind])


def _place(mesh: Mesh, given: Any, what: str) -> tuple[int, int]:
    """A node and an axis."""
    pair = isinstance(given, tuple | list) and len(given) == 2 and isinstance(given[1], str)
    fits = pair and given[1] in ("x", "y", "z")
    require(fits, what, repr(given), "(a node or point, 'x', 'y' or 'z')")
    place, axis = given[0], "xyz".index(given[1])
    if np.ndim(place) == 0:
        fits = is_number(place) and place in range(mesh.node_count)
        require(fits, what, repr(place), f"a node from 0 to {mesh.node_count - 1}, or a point (3,)")
        return int(place), axis
    point = finite_numbers(place, what, [(3,)], "a node's number, or a point (3,)")
    away = np.linalg.norm(mesh.points - point, axis=1)
    node = int(np.argmin(away))
    near = away[node] <= _NEAR * float(np.ptp(mesh.bounds, axis=0).max())
    require(bool(near), what, f"a point {away[node]:.3g} from node {node}", "a point with a node")
    return node, axis
