"""Stress recovery at large displacements: stresses and strains, and what laws tell of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gpusim.arrays.array_types import Float, Long
from gpusim.fem.elements.element_response import ElementResponse
from gpusim.fem.materials.logarithmic_strain import LogarithmicStrain
from gpusim.fem.materials.symmetric_tensors import ENGINEERING
from gpusim.fem.model.model import Model
from gpusim.fem.recovery.stress import Part, Recovery, Stress
from gpusim.parallel.threads import shared

_CHUNK = 512


def cauchy_stress(
    model: Model, responses: Sequence[ElementResponse], u: Float, formulation: Mapping[str, str]
) -> Stress:
    """Cauchy stress of elements that are in equilibrium at ``u`` (N,3), recovered as
    `gpusim.fem.stress` does it.

    ``strains`` are logarithmic ones, along the axes of the body at rest. ``energy`` is that of a
    stress in the linear material at rest, ``volume`` that at rest. ``results`` has second
    Piola-Kirchhoff stress, Green-Lagrange strain and what laws tell.
    """
    return _CauchyRecovery(model, u, formulation, None).of(responses)


class _CauchyRecovery(Recovery):
    def of(self, responses: Sequence[ElementResponse]) -> Stress:
        """With the values that elements have at their points."""
        self._first = {kind: first for kind, first, _ in self.model.mesh.blocks()}
        # name -> cell type -> (M,Q,…) at the points; zero where a law doesn't tell it
        self._told: dict[str, dict[str, Float]] = {}
        for one in responses:
            self._take(one)
        apart = ("cauchy", "volume", "logarithmic_strain")
        self.points, self._volume, self._strain = (self._told.pop(name) for name in apart)
        stored = self._told["energy"].items()
        energy = sum(float(np.vdot(values, self._volume[kind])) for kind, values in stored)
        results = {name: self._averages(values) for name, values in self._told.items()}
        return replace(self.run(), results=results, strain_energy=energy)

    def _take(self, response: ElementResponse) -> None:
        """The values of its points."""

        def values(which: Long) -> dict[str, Float]:
            own = response.point_values(which, self.u)
            logarithmic = LogarithmicStrain(own.strain).components.T.reshape(own.strain.shape)
            return {
                **own.results,
                "cauchy": own.cauchy,
                "volume": own.volume,
                "logarithmic_strain": logarithmic,
                "green_lagrange_strain": own.strain / ENGINEERING,
                "piola_stress": own.piola,
            }

        every, numbers = np.arange(len(response.cells)), response.block.numbers
        assert numbers is not None
        parts = shared(values, [every[at : at + _CHUNK] for at in range(0, len(every), _CHUNK)])
        for name in parts[0]:
            told = np.concatenate([part[name] for part in parts])
            if name not in self._told:
                self._told[name] = {
                    kind: np.zeros((*points.shape[:2], *told.shape[2:]))
                    for kind, points in self.points.items()
                }
            self._told[name][response.name][numbers - self._first[response.name]] = told

    def _points(self, part: Part) -> tuple[Float, Float]:
        return self.points[part.kind][part.cells], self._volume[part.kind][part.cells]

    def _strains(self, values: Float) -> Float:
        return np.asarray(self._averages(self._strain) * ENGINEERING)

    def _averages(self, values: Mapping[str, Float]) -> Float:
        """(P,…) at nodes, of values (M,Q,…) at points."""

        shape = next(iter(values.values())).shape[2:]

        def at_nodes(part: Part) -> Float:
            at_points = values[part.kind][part.cells]
            nodal = self.extrapolated(part, at_points.reshape(*at_points.shape[:2], -1))
            # what is nowhere negative at points may be so where it is extrapolated to
            positive = not shape and (at_points >= 0.0).all()
            return np.maximum(nodal, 0.0) if positive else nodal

        averages = self.averaged(at_nodes, int(np.prod(shape)))
        return np.asarray(averages.reshape(-1, *shape))
