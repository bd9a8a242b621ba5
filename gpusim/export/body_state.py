"""A body in one frame, from which its fields follow."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.mesh import Mesh

if TYPE_CHECKING:  # half a second to import, which a window without fields doesn't need
    from gpusim.fem import Model, Stress


@dataclass(frozen=True, eq=False)
class BodyState:
    """A body in one frame, from which its fields follow.

    ``u``: nodal displacements (N, 3), m. ``model``: what it was solved as; None for a body whose
    displacements are given: it has no stress. ``formulation``, ``temperature``: as for
    `gpusim.fem.stress`. What is there already: ``nodal_stress`` (N, 6), Pa, ``nodal_strain`` (N, 6)
    as tensor components, ``nodal_plastic_strain`` (N,), second Piola-Kirchhoff stress and
    Green-Lagrange strain likewise, and ``stored_error_share`` of elements (M,); the elements'
    stress isn't then.
    """

    mesh: Mesh
    u: Float
    model: Model | None = None
    formulation: str | None = None
    temperature: Float | float = 0.0
    nodal_stress: Float | None = None
    stored_error_share: Float | None = None
    nodal_strain: Float | None = None
    nodal_plastic_strain: Float | None = None
    nodal_piola_stress: Float | None = None
    nodal_green_lagrange_strain: Float | None = None

    @property
    def length(self) -> Float:
        """Of the displacements, (N,), m."""
        return np.asarray(np.linalg.norm(self.u, axis=1))

    @cached_property
    def recovered(self) -> Stress:
        """The stress of ``u``. Raises InputError for a body without a model."""
        if self.model is None:
            raise InputError("field: stress and strain; got a body without a material to solve")
        change = self.temperature if np.ndim(self.temperature) or self.temperature else None
        from gpusim import fem

        found: Stress = fem.stress(self.model, self.u, self.formulation, temperature=change)
        return found

    @property
    def stress(self) -> Float:
        """(N, 6), Pa."""
        return self.recovered.nodal if self.nodal_stress is None else self.nodal_stress

    @property
    def error_share(self) -> Float:
        """Of each element (M,) in the error of the stress, 0 to 1."""
        stored = self.stored_error_share
        return self.recovered.error_share if stored is None else stored

    @property
    def strain(self) -> Float:
        """(N, 6) as tensor components; where materials meet that of the greatest stress."""
        return self.recovered.nodal_strain if self.nodal_strain is None else self.nodal_strain

    @property
    def plastic_strain(self) -> Float:
        """(N,), accumulated; zero in a body that doesn't yield."""
        stored = self.nodal_plastic_strain
        return np.zeros(len(self.u)) if stored is None else stored
