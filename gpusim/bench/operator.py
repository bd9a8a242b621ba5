"""The stiffness operator alone on the device: what one product moves, and how to repeat it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gpusim.bench.cases import Case
from gpusim.fem import Model
from gpusim.fem.assembly import assemble
from gpusim.fem.formulation import resolve_formulation
from gpusim.fem.stiffness import DeviceStiffness
from gpusim.gpu import Device

__all__ = ["Probe", "operator_probe"]


@dataclass(frozen=True)
class Probe:
    """``apply`` runs products until the device is idle again, ``repeat`` of them in one submit.

    ``nbytes`` moved by one product: every stored byte of the operator once, u read once, K u
    written once. ``stored`` the operator's bytes. ``assembled`` what a product with the whole
    matrix in blocks of float64 would move: 76 bytes a block, and both vectors.
    """

    apply: Callable[[], None]
    repeat: int
    nbytes: int
    stored: int
    assembled: int
    unknowns: int


def operator_probe(case: Case, model: Model, device: Device, repeat: int = 8) -> Probe:
    """The operator of a model, uploaded."""
    rows = assemble(model, resolve_formulation(model, {case.kind: case.rule})).rows
    before = device.allocated
    operator = DeviceStiffness(device, rows, 1.0, 1)
    stored = device.allocated - before
    u = np.random.default_rng(1).normal(size=(1, *model.mesh.points.shape))
    source = operator.vector(u)
    result = operator.vector(np.zeros_like(u))

    def apply() -> None:
        with device.recording("bench.operator") as recording:
            for _ in range(repeat):
                operator.record(recording, source, result)
        device.sync()

    blocks = len(rows.neighbour) + rows.node_count
    vectors = 2 * u.nbytes
    return Probe(apply, repeat, stored + vectors, stored, 76 * blocks + vectors, u.size)
