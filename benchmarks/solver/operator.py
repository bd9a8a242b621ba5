"""The stiffness operator alone: what one product moves, and how to repeat it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.bench.solver_cases import Case
from gpusim.fem import Model
from gpusim.fem.assembly.assembly import assemble, model_lattice
from gpusim.fem.assembly.node_graph import Numbering
from gpusim.fem.assembly.system import make_system
from gpusim.fem.device.tet_forces import device_tets, upload_operator
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.matrix_product import Product
from gpusim.gpu import Device

__all__ = ["Probe", "host_probe", "operator_probe"]

Float = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """``apply`` runs products until they are done, on a device ``repeat`` of them in one submit.

    ``nbytes`` moved by one product: every stored byte of the operator once, u read once, K u
    written once. ``stored`` the operator's bytes. ``assembled`` what a product with the whole
    matrix in blocks of float64 would move: 76 bytes a block, and both vectors.
    """

    apply: Callable[[], object]
    repeat: int
    nbytes: int
    stored: int
    assembled: int
    unknowns: int


def operator_probe(case: Case, model: Model, device: Device, repeat: int = 8) -> Probe:
    """The operator of a model, uploaded, times directions as conjugate gradients behind multigrid
    take them: float32 (`gpusim.fem.krylov.cg`)."""
    model = _as_solved(model)
    assembled = assemble(model, resolve_formulation(model, {case.kind: case.rule}))
    rows, before = assembled.rows, device.allocated
    operator = upload_operator(device, assembled, device_tets(device, assembled), 1.0, 1)
    stored = device.allocated - before
    u = np.random.default_rng(1).normal(size=(1, *model.mesh.points.shape))
    source = operator.vector(u, rounded=True)
    result = operator.vector(np.zeros_like(u))

    def apply() -> None:
        with device.recording("bench.operator") as recording:
            for _ in range(repeat):
                operator.record(recording, source, result)
        device.sync()

    blocks = len(rows.neighbour) + rows.node_count
    vectors = 2 * u.nbytes
    return Probe(apply, repeat, stored + vectors, stored, 76 * blocks + vectors, u.size)


def _as_solved(model: Model) -> Model:
    numbering = None if model_lattice(model) is not None else Numbering.of(model)
    return model if numbering is None else numbering.renumbered(model)


def host_probe(case: Case, model: Model) -> Probe:
    """The product that conjugate gradients take on the host: runs of nodes on a lattice whose rows
    repeat, blocks of 3x3 elsewhere, in the solver's own numbers of nodes."""
    model = _as_solved(model)
    assembled = assemble(model, resolve_formulation(model, {case.kind: case.rule}))
    rows, system = assembled.rows, make_system(model, assembled)
    by_runs = None if system.stencil is None else system.stencil.product
    product: Callable[[Float], Float] = by_runs or (Product.of_rows(rows, system.scale))
    u = np.random.default_rng(1).normal(size=(1, model.mesh.points.size))
    blocks = int(rows.degree.sum()) + rows.node_count
    vectors = 2 * u.nbytes
    whole = 76 * blocks
    stored = whole if by_runs is None else by_runs.nbytes
    return Probe(lambda: product(u), 1, stored + vectors, stored, whole + vectors, u.size)
