"""A body in one frame, from which its fields follow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.mesh import Mesh

if TYPE_CHECKING:  # half a second to import, which a window without fields doesn't need
    from gpusim.fem import Model, Stress


KNOWN = ("stress", "strain", "error", "plastic", "piola", "green")
"""Of a body: stress (N, 6) in Pa, strain (N, 6) as tensor components, elements' shares (M,) in the
error of the stress, accumulated plastic strain (N,), second Piola-Kirchhoff stress (N, 6) and
Green-Lagrange strain (N, 6)."""


def known_of(found: Stress) -> dict[str, Float]:
    """Of a load step, by the names of `KNOWN`."""
    told = map(found.nodal_results.get, ("plastic_strain", "piola_stress", "green_lagrange_strain"))
    every = zip(KNOWN, (found.nodal, found.nodal_strain, found.error_share, *told), strict=True)
    return {name: values for name, values in every if values is not None}


@dataclass(frozen=True, eq=False)
class BodyState:
    """A body in one frame, from which its fields follow.

    ``u``: nodal displacements (N, 3), m. ``model``: what it was solved as; None for a body whose
    displacements are given: it has no stress. ``formulation``, ``temperature``: as for
    `gpusim.fem.stress`. ``known``: what is there already, by the names of `KNOWN`; the elements'
    stress isn't then.
    """

    mesh: Mesh
    u: Float
    model: Model | None = None
    formulation: str | None = None
    temperature: Float | float = 0.0
    known: Mapping[str, Float] = field(default_factory=dict)

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
        return self.known["stress"] if "stress" in self.known else self.recovered.nodal

    @property
    def error_share(self) -> Float:
        """Of each element (M,) in the error of the stress, 0 to 1."""
        return self.known["error"] if "error" in self.known else self.recovered.error_share

    @property
    def strain(self) -> Float:
        """(N, 6) as tensor components; where materials meet that of the greatest stress."""
        return self.known["strain"] if "strain" in self.known else self.recovered.nodal_strain

    @property
    def plastic_strain(self) -> Float:
        """(N,), accumulated; zero in a body that doesn't yield."""
        return self.known["plastic"] if "plastic" in self.known else np.zeros(len(self.u))
