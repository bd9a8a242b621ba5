"""Quadratic tetrahedra that the device multiplies by without their matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gpusim.errors import NotConverged
from gpusim.fem import Isotropic, Model, Orthotropic, solve
from gpusim.fem.assembly.assembly import Assembled, assemble
from gpusim.fem.device.stiffness import DeviceStiffness
from gpusim.fem.device.tet_elements import TetTexels, tet_elements
from gpusim.fem.device.tet_forces import (
    DeviceTets,
    apply_tets,
    device_tets,
    operator_bytes,
    upload_operator,
)
from gpusim.fem.model.model import resolve_formulation
from gpusim.fem.sparse.stiffness_product import apply_stiffness
from gpusim.gpu import Device
from gpusim.mesh import Mesh, box, quadratic, split

STEEL, RUBBER = Isotropic(210e3, 0.3), Isotropic(12.0, 0.45)


def tets(bent: str) -> Mesh:
    """Irregular tet10 far from the origin; ``bent`` "none", "some" or "all" of them."""
    rng = np.random.default_rng(12)
    corners = split(box((3.0, 1.7, 1.1), (4, 3, 3)))
    mesh = quadratic(corners.moved(40.0 + 0.1 * rng.random(corners.points.shape)))
    middle = np.arange(mesh.node_count) >= corners.node_count
    middle &= mesh.points[:, 0] > {"none": 50.0, "some": 42.0, "all": 0.0}[bent]
    return mesh.moved(np.where(middle[:, None], 0.03 * rng.random(mesh.points.shape), 0.0))


def two_materials(mesh: Mesh) -> Model:
    return Model(
        mesh,
        [STEEL, RUBBER],
        fixed=np.zeros(mesh.points.shape, dtype=bool),
        material_of_cell=(np.arange(mesh.cell_count) % 3 == 0).astype(np.int32),
    )


def assembled(model: Model, rule: str | None = None) -> Assembled:
    return assemble(model, resolve_formulation(model, rule))


@pytest.mark.parametrize(
    ("bent", "real"),
    [("none", "f64"), ("some", "f64"), ("all", "f64"), ("none", "double_single"),
     pytest.param("some", "double_single", marks=pytest.mark.slow),
     ("all", "double_single")],
)  # fmt: skip
def test_the_product_is_that_of_the_matrix(bent: str, real: str) -> None:
    device = Device(real)
    model = two_materials(tets(bent))
    whole = assembled(model)
    elements = device_tets(device, whole)
    assert elements is not None
    straight = len(elements.straight)
    expected = {"none": straight == len(elements.cells), "all": straight == 0}
    assert expected.get(bent, 0 < straight < len(elements.cells))
    u = np.random.default_rng(3).normal(size=(2, *model.mesh.points.shape))
    wanted = apply_stiffness(whole.rows, u)
    scale = float(2.0**18)
    operator = upload_operator(device, whole, elements, scale, 2)
    assert isinstance(operator, DeviceTets)
    result = operator.vector(np.zeros_like(u))
    with device.recording("test") as recording:
        operator.record(recording, operator.vector(u), result)
    largest = np.abs(wanted).max()
    assert np.abs(apply_tets(elements, u) - wanted).max() <= 1e-13 * largest
    assert np.abs(scale * result.read(2) - wanted).max() <= 1e-12 * largest


def test_a_body_that_moves_as_a_whole_feels_nothing(device: Device) -> None:
    model = two_materials(tets("some"))
    whole = assembled(model)
    points = model.mesh.points
    turn = np.cross([0.3, -0.2, 0.5], points - points.mean(axis=0))
    u = np.stack([np.broadcast_to([0.7, -1.1, 0.4], points.shape), turn])
    scale = float(np.abs(whole.rows.diagonal).max())
    operator = upload_operator(device, whole, device_tets(device, whole), scale, 2)
    result = operator.vector(np.zeros_like(u))
    with device.recording("test") as recording:
        operator.record(recording, operator.vector(u), result)
    found = result.read(2)
    assert (found[0] == 0.0).all()
    assert np.abs(found[1]).max() <= 1e-12


def test_other_elements_keep_their_matrices(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = tets("some")
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    wood = Orthotropic((10e3, 1e3, 800.0), (0.3, 0.2, 0.02), (700.0, 60.0, 600.0))
    bent = Model(mesh, [STEEL], fixed=fixed)
    linear = split(box((1.0, 1.0, 1.0), (3, 3, 3)))
    linear = linear.moved(0.05 * np.random.default_rng(1).random(linear.points.shape))
    repeated = quadratic(split(box((1.0, 1.0, 1.0), (4, 4, 4))))
    for model, rule in (
        (replace(bent, materials=[STEEL, wood]), None),
        (bent, "exact"),
        (Model(linear, [STEEL], fixed=np.zeros(linear.points.shape, dtype=bool)), None),
        (Model(repeated, [STEEL], fixed=np.zeros(repeated.points.shape, dtype=bool)), None),
    ):
        whole = assembled(model, rule)
        assert device_tets(device, whole) is None
        operator = upload_operator(device, whole, None, 1.0, 1)
        assert isinstance(operator, DeviceStiffness)
    assert device_tets(device, assembled(bent)) is not None
    # straight elements are the same by both rules
    straight = Model(tets("none"), [STEEL], fixed=fixed)
    assert device_tets(device, assembled(straight, "exact")) is not None
    # what doesn't fit a texture can't be split, as rows of blocks can
    monkeypatch.setitem(device.limits, "max-texture-dimension-2d", 1)
    assert device_tets(device, assembled(bent)) is None


def test_memory_is_a_small_part_of_the_matrix(device: Device) -> None:
    mesh = quadratic(split(box((1.0, 1.0, 1.0), (12, 12, 12))))
    rng = np.random.default_rng(2)
    mesh = mesh.moved(0.002 * rng.random(mesh.points.shape))
    whole = assembled(Model(mesh, [STEEL], fixed=np.zeros(mesh.points.shape, dtype=bool)))
    elements = tet_elements(whole.groups)
    assert elements is not None and len(elements.straight) == 0
    before = device.allocated
    operator = DeviceTets(device, elements, mesh.node_count, 1.0, 1)
    assert operator.texels.count == mesh.cell_count
    assert device.allocated - before == operator_bytes(whole, elements)
    # curved ones take 30 % more than straight ones
    assert operator_bytes(whole, elements) <= 0.25 * operator_bytes(whole, None)


@pytest.mark.parametrize("real", ["f64", pytest.param("double_single", marks=pytest.mark.slow)])
def test_the_solution_is_that_of_the_host(real: str) -> None:
    mesh = tets("some")
    low = mesh.points[:, 0] <= np.sort(mesh.points[:, 0])[40]
    rng = np.random.default_rng(7)
    model = replace(
        two_materials(mesh),
        fixed=np.repeat(low[:, None], 3, axis=1),
        forces=rng.normal(size=(2, *mesh.points.shape)),
        prescribed=np.where(low[:, None], 1e-3 * mesh.points, 0.0),
    )
    host = solve(model, backend="numpy", method="multigrid", tolerance=1e-8)
    found = solve(model, Device(real), method="multigrid", tolerance=1e-8)
    assert found.converged
    assert found.backend == "gpu"
    assert np.abs(found.u - host.u).max() <= 1e-7 * np.abs(host.u).max()


def test_a_value_that_is_not_finite_is_seen(
    device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = TetTexels.__init__

    def damaged(self: TetTexels, *arguments: object) -> None:
        write(self, *arguments)  # type: ignore[arg-type]
        self.roots.write(np.full((1, 4), np.nan, dtype=np.float32), self.roots.count // 2)

    monkeypatch.setattr(TetTexels, "__init__", damaged)
    mesh = tets("none")
    fixed = np.repeat(mesh.points[:, :1] < 40.3, 3, axis=1)
    forces = np.ones(mesh.points.shape)
    with pytest.raises(NotConverged, match="finite"):
        solve(Model(mesh, [STEEL], fixed=fixed, forces=forces), device, method="multigrid")
