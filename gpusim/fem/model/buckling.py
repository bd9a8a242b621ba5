"""Buckling loads and shapes by linear theory, and how far they can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

from gpusim.arrays.array_types import Float
from gpusim.fem.model.computation import Computation
from gpusim.fem.model.solution import Solution


@dataclass(frozen=True, eq=False, repr=False)
class Buckling(Computation):
    """Load factors at which a body has a second equilibrium beside the first (linear buckling).

    factors : (n,) times the load, the lowest positive ones first; fewer than asked for where there
        are no more.
    shapes : (n,N,3), each with a greatest displacement of 1.
    reversed_factor : negative: the greatest one of the load the other way around, as exact as the
        others where it may be less than the lowest of these; else a bound that came for nothing: at
        it or before, perhaps at half of it. -inf where none was seen.
    error_estimate : (n,) estimated relative error of the factors as the mesh has them.
    solution : linear statics under the load itself.
    steps : of the iteration. converged, message and others : as all results have them.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> end = gs.mesh.select_faces(bar, name="x_max")
    >>> push = gs.fem.traction(bar, end, (-1e8, 0, 0))
    >>> gs.buckling(gs.Model(bar, gs.Isotropic(210e9, 0.3), fixed, push), count=2).factors.round(2)
    array([4.36, 4.36])
    """

    factors: Float
    shapes: Float
    reversed_factor: float
    error_estimate: Float
    solution: Solution
    steps: int
