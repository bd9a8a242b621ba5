"""Modes of vibration: frequencies and shapes, and how far they can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.model.computation import Computation


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Computation):
    """Natural frequencies and mode shapes; units are the model's.

    frequencies : (n,) Hz, the lowest first: 0 for rigid-body modes.
    shapes : (n,N,3), mass-normalised: u.M u = 1; the greatest displacement of each is positive.
    participation : (n,6) factors u.M r, where r moves all nodes, those of supports too, by 1 along
        x y z, or turns them by 1 rad about x y z through the ``centre`` (3,) of mass.
    effective_mass : (n,6), their squares: what of ``total_mass`` (6,), three masses and three
        moments of inertia about the centre, a mode takes up.
    error_estimate : (n,) estimated relative error of the frequencies as the mesh has them, rounding
        and what the error of a prestress does included; the mesh's own isn't in it. Shapes are off
        by about its root, as angles; where frequencies differ by less than a half per cent, so that
        any small change of the body mixes their shapes, their common span is.
    rigid : names of the rigid-body modes, which come first and are exact.
    below : how many lower ones were left out, as of a band.
    steps : of the iteration. converged, message and others : as all results have them.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(8, 1, 1))
    >>> free = gs.modes(gs.Model(bar, gs.Isotropic(210e9, 0.3, density=7850.0)), count=8)
    >>> free.rigid[2:4]
    ('translation z', 'rotation about x')
    >>> free.frequencies.round(1)
    array([  0. ,   0. ,   0. ,   0. ,   0. ,   0. , 527.1, 527.1])
    >>> (free.effective_mass.sum(axis=0) / free.total_mass).round(6)
    array([1., 1., 1., 1., 1., 1.])
    """

    frequencies: Float
    shapes: Float
    participation: Float
    effective_mass: Float
    total_mass: Float
    centre: Float
    error_estimate: Float
    rigid: tuple[str, ...]
    steps: int
    below: int = 0

    @property
    def angular(self) -> Float:
        """(n,) rad/s."""
        return 2.0 * np.pi * self.frequencies
