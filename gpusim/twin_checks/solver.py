"""Stages of the solver against NumPy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from scipy.sparse import bsr_matrix, csr_matrix, random_array

from gpusim.arrays.array_types import Bool, Float
from gpusim.fem.assembly.assembly import assemble
from gpusim.fem.assembly.element_batches import model_groups
from gpusim.fem.device.block_texels import BlockTexels
from gpusim.fem.device.interpolation import DeviceWeights, apply_weights
from gpusim.fem.device.linear_combination import _NAMES, DeviceSum, weighted_sum
from gpusim.fem.device.node_texels import node_texels, pair, read_nodes, vector_texels
from gpusim.fem.device.relaxation import relax_nodes, relaxation
from gpusim.fem.device.stiffness import DeviceProduct, DeviceStiffness
from gpusim.fem.device.tet_elements import TetElements, TetTexels, tet_elements
from gpusim.fem.device.tet_forces import DeviceTets, apply_tets, element_forces
from gpusim.fem.device.tet_forces_single import SingleForces
from gpusim.fem.krylov.cg import DeviceCG, NumpyCG, _BlockJacobi
from gpusim.fem.materials.isotropic import Isotropic
from gpusim.fem.model.model import Model, resolve_formulation
from gpusim.fem.multigrid.smoothers import Relaxation
from gpusim.fem.sparse.block_rows import BlockRows, invert_blocks
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.gpu import Device, Pair, Pairs, Tolerance, twin_check
from gpusim.mesh import Mesh, box, quadratic, split

SINGLE_SUMS = Tolerance(2e-5, 1e-5, "float32 sums of about a hundred products of order one")
REAL_SUMS = Tolerance(1e-11, 1e-11, "f64 or double-single sums of about a hundred products")


def check_elements() -> tuple[TetElements, int]:
    """Straight and curved elements of two materials for a check, and how many nodes they have."""
    rng = np.random.default_rng(4)
    corners = split(box((1.0, 0.4, 0.7), (4, 3, 3)))
    mesh = quadratic(corners.moved(0.02 * rng.random(corners.points.shape)))
    middle = (np.arange(mesh.node_count) >= corners.node_count) & (mesh.points[:, 0] > 0.6)
    mesh = mesh.moved(np.where(middle[:, None], 0.01 * rng.random(mesh.points.shape), 0.0))
    model = Model(
        mesh,
        [Isotropic(1.0, 0.3), Isotropic(2.0, -0.1)],
        fixed=np.zeros(mesh.points.shape, dtype=bool),
        material_of_cell=(np.arange(mesh.cell_count) % 2).astype(np.int32),
    )
    elements = tet_elements(model_groups(model, resolve_formulation(model, None)))
    assert elements is not None and len(elements.straight) and len(elements.curved)
    return elements, mesh.node_count


def _boxes(divisions: tuple[int, int, int], rng: np.random.Generator) -> tuple[Mesh, Mesh]:
    """A box of equal bricks, and one with moved nodes: every row is different."""
    regular = box((1.0, 0.4, 0.7), divisions)
    return regular, regular.moved(0.02 * rng.random(regular.points.shape))


def _rows(mesh: Mesh) -> BlockRows:
    """Its stiffness, held nowhere."""
    model = Model(mesh, [Isotropic(1.0, 0.3)], fixed=np.zeros(mesh.points.shape, dtype=bool))
    return assemble(model, resolve_formulation(model, None)).rows


def _relaxed(
    device: Device,
    texels: BlockTexels | TetTexels,
    apply: Callable[[Float], Float],
    inverse: Float,
    free: Bool,
) -> Pairs:
    x, before, b = np.random.default_rng(3).normal(size=(3, 2, *free.shape))
    step = Relaxation(0.3, 0.7)
    smoother = relaxation(device, texels, inverse, 2, "fem.check")
    x_in, before_in, b_in, *out = (smoother.vector("fem.check.vector") for _ in range(7))
    for texture, values in ((x_in, x), (before_in, before), (b_in, b)):
        texture.write(node_texels(values))
    with device.recording("fem.check") as recording:
        smoother.relax(recording, x_in, before_in, b_in, step, out[0])
        smoother.relax(recording, x_in, None, b_in, step, out[1])
        smoother.residual(recording, x_in, b_in, out[2])
        smoother.begin(recording, b_in, out[3], 0.7)
    wanted = (
        relax_nodes(apply, inverse, x, before, b, step),
        relax_nodes(apply, inverse, x, None, b, step),
        np.where(free, b - apply(x), 0.0),
        0.7 * np.matmul(inverse, b[..., None])[..., 0],
    )
    for texture, value in zip(out, wanted, strict=True):
        yield Pair(read_nodes(texture, 2), value)


def _products(
    device: Device, operator: DeviceStiffness | DeviceTets, u: Float
) -> Iterator[tuple[Float, Float]]:
    """``u`` (2,N,3) as the device has it, exact and rounded, and what the operator makes of it."""
    result = operator.vector(np.zeros_like(u))
    for rounded in (False, True):
        source = operator.vector(u, rounded=rounded)
        with device.recording("fem.check") as recording:
            operator.record(recording, source, result)
        yield source.read(2), result.read(2)


@twin_check("fem/device/stiffness", REAL_SUMS)
def _stiffness(device: Device) -> Pairs:
    rng = np.random.default_rng(5)
    for mesh in _boxes((7, 6, 5), rng):
        rows = _rows(mesh)
        u = rng.normal(size=(2, *mesh.points.shape))
        for given, got in _products(device, DeviceStiffness(device, rows, 1.0, 2), u):
            yield Pair(got, apply_stiffness(rows, given), part="apply")
    # the kernel's plain form, as coarse levels use it: any matrix, not square
    dense = rng.normal(size=(36, 24)) * (rng.random((36, 24)) < 0.3)
    x = rng.normal(size=(2, 8, 3))
    product = DeviceProduct(device, bsr_matrix(dense, blocksize=(3, 3)), 2, "fem.check")
    source, image = pair(device, 2, 8, "fem.check.x"), product.vector()
    source.write(x)
    with device.recording("fem.check") as recording:
        product.record(recording, source, image)
    wanted = (x.reshape(2, 24) @ dense.T).reshape(2, 12, 3)
    yield Pair(image.read(2), wanted, Tolerance(1e-12, 1e-12, "sums of ten products"), "plain")


@twin_check("fem/device/tet_forces", REAL_SUMS)
def _tet_forces(device: Device) -> Pairs:
    elements, nodes = check_elements()
    u = np.random.default_rng(6).normal(size=(2, nodes, 3))
    for given, got in _products(device, DeviceTets(device, elements, nodes, 1.0, 2), u):
        yield Pair(got, apply_tets(elements, given))


@twin_check("fem/device/tet_forces_single", SINGLE_SUMS)
def _tet_forces_single(device: Device) -> Pairs:
    elements, nodes = check_elements()
    x = np.random.default_rng(7).normal(size=(2, nodes, 3))
    texels = TetTexels(device, elements, nodes, 1.0, "fem.check")
    vector = vector_texels(device, 2, nodes, "fem.check.x")
    vector.write(node_texels(x))
    forces = SingleForces(device, texels)
    with device.recording("fem.check") as recording:
        forces.record(recording, vector, 1)
    found = texels.forces.read()[:-2].reshape(-1, 5, 3, 4)[:, :, :2, :3]
    yield Pair(found.reshape(-1, 10, 3), element_forces(elements, x[1]))


@twin_check("fem/device/relaxation", SINGLE_SUMS)
def _relaxation(device: Device) -> Pairs:
    rng = np.random.default_rng(9)
    for mesh in _boxes((9, 6, 5), rng):
        rows = _rows(mesh)
        free = mesh.points > mesh.points.min(axis=0)
        inverse = invert_blocks(rows.diagonal[rows.row_class], free)
        texels = BlockTexels(device, rows, 1.0, "fem.check", exact=False)
        yield from _relaxed(device, texels, partial(apply_stiffness, rows), inverse, free)
    elements, nodes = check_elements()
    free = rng.random((nodes, 3)) < 0.9
    blocks = np.eye(3) + 0.1 * rng.normal(size=(nodes, 3, 3))
    inverse = blocks * free[:, :, None] * free[:, None]
    of_elements = TetTexels(device, elements, nodes, 1.0, "fem.check")
    yield from _relaxed(device, of_elements, partial(apply_tets, elements), inverse, free)


@twin_check("fem/device/interpolation")
def _interpolation(device: Device) -> Pairs:
    rng = np.random.default_rng(10)
    weights = csr_matrix(random_array((70, 33), density=0.1, rng=rng))
    free = rng.random((70, 3)) < 0.8
    v, x = rng.normal(size=(2, 33, 3)), rng.normal(size=(2, 70, 3))
    spread = DeviceWeights(device, weights, free, 2, "fem.check")
    source = vector_texels(device, 2, 33, "fem.check.v")
    base, plain, added = (vector_texels(device, 2, 70, "fem.check.x") for _ in range(3))
    source.write(node_texels(v))
    base.write(node_texels(x))
    with device.recording("fem.check") as recording:
        spread.record(recording, source, plain)
        spread.record(recording, source, added, base)
    wanted = apply_weights(weights, free, v)
    yield Pair(read_nodes(plain, 2), wanted, part="apply")
    yield Pair(read_nodes(added, 2), x + wanted, part="add")


@twin_check("fem/device/linear_combination", Tolerance(1e-13, 1e-13, "sums of four products"))
def _linear_combination(device: Device) -> Pairs:
    rng = np.random.default_rng(11)
    values = {name: rng.normal(size=(2, 70, 3)) for name in _NAMES}
    factors = dict(zip(_NAMES, (1.5, -0.3, 0.7, -1.0), strict=True))
    adder = DeviceSum(device, 70, 2)
    vectors = {name: pair(device, 2, 70, "fem.check") for name in _NAMES}
    out = pair(device, 2, 70, "fem.check")
    for name, vector in vectors.items():
        vector.write(values[name])
    with device.recording("fem.check") as recording:
        adder.record(recording, out, **{name: (factors[name], vectors[name]) for name in _NAMES})
    yield Pair(out.read(2), weighted_sum({name: (factors[name], values[name]) for name in _NAMES}))


@twin_check("fem/krylov/cg")
def _cg(device: Device) -> Pairs:
    rng = np.random.default_rng(8)
    mesh = box((1.0, 0.4, 0.7), (5, 4, 3))
    rows = _rows(mesh)
    free = np.repeat(mesh.points[:, :1] > 0.0, 3, axis=1)
    shape = (2, *free.shape)
    jacobi = _BlockJacobi(invert_blocks(rows.diagonal[rows.row_class], free))
    b = np.where(free, rng.normal(size=shape), 0.0).reshape(2, -1)
    twin = NumpyCG(lambda v: apply_stiffness(rows, v.reshape(shape)).reshape(2, -1), jacobi)
    operator = DeviceStiffness(device, rows, 1.0, 2)
    ready = jacobi.upload(device, operator, 2)
    active = np.array([True, True])
    start, history, x = twin.begin(b), twin.run(6, active), twin.correction()
    loop = DeviceCG(device, operator, ready, 2)
    rounded = "the preconditioner is rounded to float32, and iterations amplify that"
    yield Pair(loop.begin(b), start, Tolerance(0.0, 1e-6, rounded), "start")
    yield Pair(loop.run(6, active), history, Tolerance(1e-12, 2e-5, rounded), "history")
    yield Pair(loop.correction(), x, Tolerance(1e-5, 1e-5, rounded), "x")
