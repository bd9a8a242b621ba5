"""Stress recovery at large displacements: Cauchy stress and logarithmic strain of elements."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gpusim.arrays.array_types import Float
from gpusim.fem.elements.element_response import ElementResponse
from gpusim.fem.materials.j2 import J2
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

    ``strains`` are logarithmic ones, along the axes of the body at rest. Energies are those of a
    stress in the linear material at rest, volumes those at rest.
    """
    return _CauchyRecovery(model, responses, u, formulation).run()


class _CauchyRecovery(Recovery):
    def __init__(
        self,
        model: Model,
        responses: Sequence[ElementResponse],
        u: Float,
        formulation: Mapping[str, str],
    ) -> None:
        super().__init__(model, u, formulation, None)
        self._first = {kind: first for kind, first, _ in model.mesh.blocks()}
        sizes = {kind: array.shape[:2] for kind, array in self.points.items()}
        self._weight = {kind: np.zeros(size) for kind, size in sizes.items()}
        self._strain = {kind: np.zeros((*size, 6)) for kind, size in sizes.items()}
        self._plastic = {kind: np.zeros((*size, 1)) for kind, size in sizes.items()}
        self._flows = False
        for one in responses:
            self._take(one)

    def _take(self, response: ElementResponse) -> None:
        """The values of its points, and the plastic strain of metal."""
        kind, block = response.name, response.block
        assert block.numbers is not None
        place = block.numbers - self._first[kind]
        # the last number of its history
        state = response.snapshot().state if isinstance(block.law, J2) else None

        def take(start: int) -> None:
            which = np.arange(start, min(start + _CHUNK, len(place)))
            values, own = response.point_values(which, self.u), place[which]
            self.points[kind][own], self._weight[kind][own] = values.cauchy, values.volume
            strain = LogarithmicStrain(values.strain).components.T * ENGINEERING
            self._strain[kind][own] = strain.reshape(values.strain.shape)
            if state is not None:
                self._plastic[kind][own] = state[which, :, -1:]

        self._flows |= state is not None
        shared(take, list(range(0, len(place), _CHUNK)))

    def _points(self, part: Part) -> tuple[Float, Float]:
        return self.points[part.kind][part.cells], self._weight[part.kind][part.cells]

    def _strains(self, values: Float) -> Float:
        return self._averages(self._strain, 6)

    def _plastic_strains(self) -> Float | None:
        # what never falls below zero at points may do so where it is extrapolated to
        return np.maximum(self._averages(self._plastic, 1)[:, 0], 0.0) if self._flows else None

    def _averages(self, values: Mapping[str, Float], count: int) -> Float:
        def at_nodes(part: Part) -> Float:
            return self.extrapolated(part, values[part.kind][part.cells])

        return self.averaged(list(self.parts()), at_nodes, count)
