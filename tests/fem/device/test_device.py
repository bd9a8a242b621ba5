"""The solver's device part: layouts of the matrix, the V-cycle, and what it costs in iterations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse import bsr_matrix

from gpusim.errors import NotConverged
from gpusim.fem import Isotropic, Model, solve
from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.assembly.system import make_system
from gpusim.fem.device.block_texels import SLICE, BlockTexels, RowSlices, rows_of_matrix
from gpusim.fem.device.node_texels import Arena, node_texels, pair, read_nodes, vector_texels
from gpusim.fem.device.relaxation import ColumnRelaxation, relaxation
from gpusim.fem.device.stiffness import DeviceProduct, DeviceStiffness
from gpusim.fem.device.tet_forces import device_tets, upload_operator
from gpusim.fem.krylov.cg import DeviceCG
from gpusim.fem.krylov.multigrid_preconditioner import Multigrid
from gpusim.fem.linear.device_solver import device_bytes
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.multigrid.column_blocks import Columns
from gpusim.fem.multigrid.hierarchy import Hierarchy, build_hierarchy
from gpusim.fem.multigrid.smoothers import Relaxation
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.gpu import Device
from gpusim.mesh import CELL_TYPES, Mesh, box, quadratic, split

_TETS = ((0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6))


def tetrahedra(mesh: Mesh, kind: str) -> Mesh:
    """Six tetrahedra for each hex8."""
    corner = np.concatenate([mesh.cells["hex8"][:, list(one)] for one in _TETS])
    if kind == "tet4":
        return Mesh(mesh.points, {"tet4": corner})
    edges = CELL_TYPES["tet10"].parents
    ends = np.sort(np.concatenate([corner[:, list(one)] for one in edges]), axis=1)
    unique, number = np.unique(ends, axis=0, return_inverse=True)
    middle = len(mesh.points) + number.reshape(len(edges), -1).T
    points = np.concatenate([mesh.points, mesh.points[unique].mean(axis=1)])
    return Mesh(points, {"tet10": np.concatenate([corner, middle], axis=1)})


def irregular(cells: tuple[int, int, int]) -> Mesh:
    mesh = box((1.0, 0.7, 0.9), cells)
    inside = mesh.points[:, :1] > 0.0
    shift = 0.02 * np.random.default_rng(3).random(mesh.points.shape)
    return mesh.moved(np.where(inside, shift, 0.0))


def irregular_plate(cells: tuple[int, int, int]) -> Mesh:
    """Flat cells: columns across them are smoothed as a whole."""
    mesh = irregular(cells)
    return Mesh(mesh.points * [1.0, 1.0, 0.08], mesh.cells)


def clamped(mesh: Mesh, nu: float = 0.3, cases: int = 1) -> Model:
    fixed = np.isclose(mesh.points[:, :1], 0.0).repeat(3, axis=1)
    # one unknown of its own: packs may not mix it with free neighbours
    fixed[np.argmax(mesh.points @ np.array([1.0, 0.3, 0.2])), 1] = True
    forces = np.zeros((cases, *mesh.points.shape))
    end = mesh.points[:, 0] >= mesh.points[:, 0].max() - 1e-9
    forces[:, end] = np.array([0.1, 1.0, -0.3])
    forces[1:, end, 2] = 5.0
    return Model(mesh, [Isotropic(1e3, nu)], fixed=fixed, forces=forces)


def bent_tetrahedra() -> Mesh:
    """Irregular tet10, some of them curved: the device multiplies by their elements."""
    corners = irregular((6, 4, 5))
    mesh = quadratic(split(corners))
    middle = (np.arange(mesh.node_count) >= corners.node_count) & (mesh.points[:, 0] > 0.7)
    shift = 0.01 * np.random.default_rng(8).random(mesh.points.shape)
    return mesh.moved(np.where(middle[:, None], shift, 0.0))


def assembled_and_hierarchy(model: Model) -> tuple[Assembled, Hierarchy, np.ndarray]:
    assert model.fixed is not None
    assembled = assemble(model, resolve_formulation(model, None))
    system = replace(make_system(model, assembled), scale=1024.0, stencil=None)
    hierarchy = build_hierarchy(assembled, system, model.mesh.points)
    return assembled, hierarchy, ~model.fixed


MESHES = {
    "lattice": lambda: box((1.0, 0.7, 0.9), (13, 9, 11)),
    "flat": lambda: irregular_plate((12, 11, 3)),
    "irregular": lambda: irregular((7, 6, 8)),
    "tet4": lambda: tetrahedra(box((1.0, 0.7, 0.9), (7, 5, 6)), "tet4"),
    "tet10": lambda: tetrahedra(box((1.0, 0.7, 0.9), (5, 3, 4)), "tet10"),
    "bent": bent_tetrahedra,
}


def product(device: Device, rows: BlockRows, u: np.ndarray) -> np.ndarray:
    operator = DeviceStiffness(device, rows, 1.0, len(u))
    result = operator.vector(np.zeros_like(u))
    with device.recording("test") as recording:
        operator.record(recording, operator.vector(u), result)
    return result.read(len(u))


@pytest.mark.parametrize("most", [10**9, 600])
def test_slices_hold_every_row(most: int) -> None:
    model = clamped(MESHES["irregular"]())
    rows = assemble(model, resolve_formulation(model, None)).rows
    count = 0
    for part in RowSlices.of(rows.degree).parts(most):
        assert part.block_texels <= most
        assert (part.fours <= np.repeat(part.head, SLICE)[: len(part.nodes)]).all()
        listed, ((_, (high, low)),) = part.neighbours(rows), part.blocks(rows, 2.0, True)
        texels = high.astype(np.float64) + low
        for first, fours, block, node in part.info().tolist():
            neighbours = listed[first::SLICE][:fours].ravel()
            blocks = texels[block::SLICE][: 9 * fours].reshape(-1, 3, 3).transpose(0, 2, 1)
            own = slice(rows.start[node], rows.start[node + 1])
            degree = rows.degree[node]
            assert (neighbours[:degree] == rows.neighbour[own]).all()
            assert (neighbours[degree:] == node).all()
            number = rows.row_class[node]
            table = rows.table[rows.table_start[number] : rows.table_start[number + 1]]
            # two float32 hold 48 bits
            np.testing.assert_allclose(2.0 * blocks[:degree], table, rtol=2e-14)
            assert (blocks[degree:] == 0.0).all()
        count += len(part.nodes)
    assert count == rows.node_count


@pytest.mark.parametrize("name", ["lattice", "tet10"])
def test_coarse_matrices_become_rows_of_differences(name: str) -> None:
    _, hierarchy, _ = assembled_and_hierarchy(clamped(MESHES[name]()))
    rng = np.random.default_rng(4)
    for level in hierarchy.levels:
        if level.inverse.shape[1] != 3:
            continue
        matrix = level.product.matrix
        rows = rows_of_matrix(matrix)
        x = rng.normal(size=(rows.node_count, 3))
        still = np.concatenate([x, np.zeros((1, 3))])
        number = np.repeat(np.arange(rows.node_count), rows.degree)
        slot = np.arange(len(number)) - np.repeat(rows.start[:-1], rows.degree)
        blocks = rows.table[rows.table_start[rows.row_class[number]] + slot]
        force = np.matmul(blocks, (still[rows.neighbour] - x[number])[..., None])[..., 0]
        total = np.zeros_like(x)
        np.add.at(total, number, force)
        assert np.abs(total.ravel() - matrix @ x.ravel()).max() <= 1e-12
    if name == "lattice":
        assert rows_of_matrix(hierarchy.levels[0].product.matrix).class_count == 27


def test_parts_split_at_the_texture_limit_give_the_same_product(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    model = clamped(MESHES["irregular"]())
    rows = assemble(model, resolve_formulation(model, None)).rows
    u = np.random.default_rng(1).normal(size=(2, *model.mesh.points.shape))
    whole = product(device, rows, u)
    monkeypatch.setitem(device.limits, "max-texture-dimension-2d", 4)
    operator = DeviceStiffness(device, rows, 1.0, 2)
    assert len(operator.texels.parts) > 2
    result = operator.vector(np.zeros_like(u))
    with device.recording("test") as recording:
        operator.record(recording, operator.vector(u), result)
    assert (result.read(2) == whole).all()


@pytest.mark.parametrize("name", ["lattice", "irregular", "bent"])
def test_rounded_vectors_are_read_as_they_are(device: Device, name: str) -> None:
    model = clamped(MESHES[name]())
    assembled = assemble(model, resolve_formulation(model, None))
    operator = upload_operator(device, assembled, device_tets(device, assembled), 1024.0, 1)
    u = np.random.default_rng(7).normal(size=(1, *model.mesh.points.shape))
    found = []
    for rounded, values in (
        (True, u),
        (False, u.astype(np.float32).astype(np.float64)),
        (False, u),
    ):
        source = operator.vector(values, rounded=rounded)
        assert (source.low is None) == rounded
        result = operator.vector(np.zeros_like(u))
        with device.recording("test") as recording:
            operator.record(recording, source, result)
        found.append(result.read(1))
    assert (found[0] == found[1]).all()
    assert (found[0] != found[2]).any()


@pytest.mark.parametrize("limit", [8192, 2])
def test_any_matrix_times_a_vector(
    device: Device, monkeypatch: pytest.MonkeyPatch, limit: int
) -> None:
    rng = np.random.default_rng(6)
    dense = np.kron(rng.random((90, 70)) < 0.4, np.ones((3, 3))) * rng.normal(size=(270, 210))
    dense[30:33] = 0.0
    x = rng.normal(size=(3, 70, 3))
    monkeypatch.setitem(device.limits, "max-texture-dimension-2d", limit)
    matrix = DeviceProduct(device, bsr_matrix(dense, blocksize=(3, 3)), 3, "test")
    assert (len(matrix.texels.parts) > 1) == (limit == 2)
    source, result = pair(device, 3, 70, "test"), matrix.vector()
    source.write(x)
    with device.recording("test") as recording:
        matrix.record(recording, source, result)
    wanted = (x.reshape(3, -1) @ dense.T).reshape(3, 90, 3)
    assert np.abs(result.read(3) - wanted).max() <= 1e-11
    assert (result.read(3)[:, 10] == 0.0).all()


@pytest.mark.parametrize("real", ["f64", "double_single"])
@pytest.mark.parametrize("name", sorted(MESHES))
def test_the_cycle_is_that_of_the_host(name: str, real: str) -> None:
    device = Device(real)
    model = clamped(MESHES[name](), cases=2)
    assembled, hierarchy, free = assembled_and_hierarchy(model)
    multigrid = Multigrid(hierarchy)
    assert (hierarchy.levels[0].smoother is not None) == (name == "flat")
    b = np.where(free, np.random.default_rng(5).normal(size=(2, *free.shape)), 0.0)
    wanted = multigrid.apply(b.reshape(2, -1)).reshape(b.shape)
    with Arena(device) as arena:
        elements = device_tets(arena, assembled)
        assert (elements is not None) == (name == "bent")
        operator = upload_operator(arena, assembled, elements, 1024.0, 2)
        ready = multigrid.upload(arena, operator, 2)
        source, result = (vector_texels(arena, 2, len(free), "test") for _ in range(2))
        source.write(node_texels(b))
        found = []
        for _ in range(2):
            with device.recording("test") as recording:
                ready.record(recording, source, result)
            found.append(read_nodes(result, 2))
    assert (found[0] == found[1]).all(), "the same bits on every run"
    assert np.abs(found[0] - wanted).max() <= 1e-5 * np.abs(wanted).max()
    assert (found[0][:, ~free] == 0.0).all()


@pytest.mark.parametrize("nu", [0.3, 0.49])
@pytest.mark.parametrize("name", sorted(MESHES))
def test_float32_costs_no_iterations(device: Device, name: str, nu: float) -> None:
    model = clamped(MESHES[name](), nu)
    host = solve(model, backend="numpy", method="multigrid")
    found = solve(model, device, method="multigrid")
    assert host.converged
    assert found.converged
    assert abs(found.iterations - host.iterations) <= 1
    scale = np.abs(host.u).max()
    assert np.abs(found.u - host.u).max() <= 1e-7 * scale


def test_float32_serves_slender_bodies_too(device: Device) -> None:
    model = clamped(box((60.0, 1.0, 1.0), (120, 3, 2)))
    host = solve(model, backend="numpy", method="multigrid")
    found = solve(model, device, method="multigrid")
    assert host.converged
    assert found.converged
    assert abs(found.iterations - host.iterations) <= 2
    assert np.abs(found.u - host.u).max() <= 1e-6 * np.abs(host.u).max()


@pytest.mark.parametrize("name", ["lattice", "irregular", "tet10", "bent"])
@pytest.mark.parametrize("cases", [1, 3])
def test_memory_asked_for_is_memory_taken(device: Device, name: str, cases: int) -> None:
    model = clamped(MESHES[name](), cases=cases)
    assembled, hierarchy, free = assembled_and_hierarchy(model)
    multigrid = Multigrid(hierarchy)
    before = device.allocated
    with Arena(device) as arena:
        elements = device_tets(arena, assembled)
        operator = upload_operator(arena, assembled, elements, 1024.0, cases)
        ready = multigrid.upload(arena, operator, cases)
        loop = DeviceCG(arena, operator, ready, cases)
        loop.begin(np.zeros((cases, free.size)))
        taken = device.allocated - before
    asked = device_bytes(assembled, elements, cases, multigrid)
    assert taken <= asked <= 2.0 * taken
    assert device.allocated == before


def test_a_value_that_is_not_finite_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = BlockTexels.__init__

    def damaged(self: BlockTexels, *arguments: object, **options: object) -> None:
        write(self, *arguments, **options)  # type: ignore[arg-type]
        texels = self.parts[0].blocks
        texels.write(np.full((1, 4), np.nan, dtype=np.float32), texels.count // 4)

    monkeypatch.setattr(BlockTexels, "__init__", damaged)
    with pytest.raises(NotConverged, match="finite"):
        solve(clamped(MESHES["irregular"]()), device, method="multigrid")


def test_steps_by_columns_are_those_of_the_host(device: Device) -> None:
    model = clamped(irregular_plate((6, 5, 3)), cases=2)
    _, hierarchy, free = assembled_and_hierarchy(model)
    level = hierarchy.levels[0]
    assert isinstance(level.smoother, Columns)
    texels = BlockTexels(device, rows_of_matrix(level.product.matrix), 1.0, "test", exact=False)
    matrix = relaxation(device, texels, level.inverse, 2, "test")
    x, before, b = (np.where(free, one, 0.0) for one in
                    np.random.default_rng(6).normal(size=(3, 2, *free.shape)))  # fmt: skip
    step = Relaxation(0.3, 0.7)

    def product(apply: Callable[[np.ndarray], np.ndarray], v: np.ndarray) -> np.ndarray:
        return apply(v.reshape(2, -1)).reshape(v.shape)

    scaled = product(level.smoother.apply, np.where(free, b - product(level.product, x), 0.0))
    wanted = [
        0.7 * product(level.smoother.apply, b),
        x + step.keep * (x - before) + step.gain * scaled,
        x + step.keep * x + step.gain * scaled,
    ]
    inverse = level.smoother.matrix.copy()
    for corrupt in (False, True):
        inverse.data[40, 1, 1] *= 1.2 if corrupt else 1.0
        smoother = ColumnRelaxation(device, matrix, inverse, level.inverse, 2, "test")
        x_in, before_in, b_in, *out = (smoother.vector("test") for _ in range(6))
        for texture, values in ((x_in, x), (before_in, before), (b_in, b)):
            texture.write(node_texels(values))
        with device.recording("test") as recording:
            smoother.begin(recording, b_in, out[0], 0.7)
            smoother.relax(recording, x_in, before_in, b_in, step, out[1])
            smoother.relax(recording, x_in, None, b_in, step, out[2])
        for one, value in zip(out, wanted, strict=True):
            off = np.abs(read_nodes(one, 2) - value).max() / np.abs(value).max()
            assert (off <= 2e-6) != corrupt
