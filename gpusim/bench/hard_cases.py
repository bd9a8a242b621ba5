"""The hard cases of the stability suite: small models, each extreme in one way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic, Model, face_force
from gpusim.mesh import Mesh, box, quadratic, select_faces

__all__ = ["HardCase", "hard_cases"]

Float = npt.NDArray[np.float64]
Triple = tuple[float, float, float]
Counts = tuple[int, int, int]

STEEL = Isotropic(210e9, 0.3)


@dataclass(frozen=True)
class HardCase:
    """One model. ``value`` is what the family varies; ``quick``: part of the small test;
    ``tolerance`` None: the suite's."""

    family: str
    value: float
    build: Callable[[], Model]
    rules: dict[str, str]
    quick: bool = False
    note: str = ""
    tolerance: float | None = None

    @property
    def name(self) -> str:
        rule = " ".join(r if k == "hex8" else f"{k} {r}" for k, r in self.rules.items())
        note = f" {self.note}" if self.note else ""
        return f"{self.family} {self.value:g} {rule}{note}"


def cantilever(
    mesh: Mesh,
    materials: Sequence[Isotropic] = (STEEL,),
    *,
    material_of_cell: npt.NDArray[np.int32] | None = None,
    load: float = 1.0,
) -> Model:
    """Clamped at x_min; two load cases on x_max: mostly along z, mostly along y."""
    low = mesh.bounds[0, 0]
    fixed = np.repeat((mesh.points[:, :1] == low), 3, axis=1)
    end = select_faces(mesh, plane=(mesh.bounds[1], "+x"))
    forces = [
        face_force(mesh, end, np.array([0.3, 0.2, -1.0]) * load),
        face_force(mesh, end, np.array([0.0, 1.0, 0.1]) * load),
    ]
    return Model(mesh, list(materials), material_of_cell=material_of_cell, fixed=fixed,
                 forces=np.stack(forces))  # fmt: skip


def bar(
    size: Triple, divisions: Counts, material: Isotropic = STEEL, load: float = 1.0,
    shift: Triple = (0.0, 0.0, 0.0), scale: float = 1.0,
) -> Model:  # fmt: skip
    mesh = box(tuple(scale * s for s in size), divisions)
    if any(shift):
        mesh = Mesh(mesh.points + np.asarray(shift), mesh.cells, mesh.node_sets, mesh.face_sets)
    return cantilever(mesh, [material], load=load)


def brick20_bar(size: Triple, divisions: Counts, nu: float = 0.3) -> Model:
    """20-node bricks."""
    return cantilever(quadratic(box(size, divisions)), [Isotropic(210e9, nu)])


def pulled_plate(share: float, thickness: float) -> Model:
    """Quadratic tetrahedra; a pull along the plate, and ``share`` of it across, which decides the
    displacement where the plate is thin."""
    mesh = _tets((2.0, 1.0, thickness), (8, 5, 1), second_order=True)
    fixed = np.repeat(mesh.points[:, :1] == 0.0, 3, axis=1)
    end = select_faces(mesh, plane=(mesh.bounds[1], "+x"))
    forces = face_force(mesh, end, np.array([1.0, 0.3, share]))
    return Model(mesh, [STEEL], fixed=fixed, forces=forces)


def tet_bar(size: Triple, divisions: Counts, second_order: bool = False) -> Model:
    return cantilever(_tets(size, divisions, second_order))


def _tets(size: Triple, divisions: Counts, second_order: bool) -> Mesh:
    """Every brick cut into six tetrahedra about its diagonal."""
    bricks = box(size, divisions)
    around = [1, 2, 3, 7, 4, 5]
    corners = [[0, 6, a, b] for a, b in zip(around, around[1:] + around[:1], strict=True)]
    cells = bricks.cells["hex8"][:, corners].reshape(-1, 4)
    p = bricks.points[cells]
    volume = np.linalg.det(p[:, 1:] - p[:, :1])
    cells = np.where((volume < 0.0)[:, None], cells[:, [0, 2, 1, 3]], cells)
    mesh = Mesh(bricks.points, {"tet4": cells})
    return quadratic(mesh) if second_order else mesh


def distorted(amount: float, material: Isotropic = STEEL) -> Model:
    """Inner nodes moved at random, by up to half a cell where ``amount`` is 1."""
    mesh = box((1.5, 1.0, 0.8), (6, 4, 4))
    inner = ((mesh.points > mesh.bounds[0]) & (mesh.points < mesh.bounds[1])).all(axis=1)
    step = 0.1 * amount * np.random.default_rng(7).uniform(-1.0, 1.0, mesh.points.shape)
    return cantilever(mesh.moved(np.where(inner[:, None], step, 0.0)), [material])


def crushed(least: float) -> Model:
    """One inner node pushed along a cell's diagonal until a corner Jacobian is ``least``.

    A corner moved by t along the diagonal of a unit cube has a Jacobian of 1 - 3t there and of
    1 - t at its neighbours.
    """
    mesh = box((4.0, 3.0, 3.0), (4, 3, 3))
    node = int(np.flatnonzero((mesh.points == (2.0, 1.0, 1.0)).all(axis=1))[0])
    step = np.zeros(mesh.points.shape)
    step[node] = (1.0 - least) / 3.0
    return cantilever(mesh.moved(step))


def almost_regular(amount: float) -> Model:
    """A slender regular grid whose nodes are off by up to ``amount`` of a cell."""
    mesh = box((40.0, 1.0, 0.7), (80, 2, 2))
    inner = (mesh.points[:, 0] > 0.0) & (mesh.points[:, 0] < 40.0)
    step = 0.35 * amount * np.random.default_rng(11).uniform(-1.0, 1.0, mesh.points.shape)
    return cantilever(mesh.moved(np.where(inner[:, None], step, 0.0)))


def contrast(ratio: float, layout: str) -> Model:
    """Two materials, E and E*ratio."""
    mesh = box((4.0, 1.5, 1.0), (12, 3, 3))
    centre = mesh.points[mesh.cells["hex8"]].mean(axis=1)
    if layout == "soft root":
        stiff = centre[:, 0] > 1.4
    elif layout == "stiff root":
        stiff = centre[:, 0] < 1.4
    elif layout == "layers":
        stiff = centre[:, 2] > 0.6
    else:
        stiff = np.random.default_rng(3).random(len(centre)) < 0.4
    materials = [Isotropic(1.0, 0.3), Isotropic(ratio, 0.25)]
    return cantilever(mesh, materials, material_of_cell=stiff.astype(np.int32))


def islands(ratio: float, cells: int, share: float) -> Model:
    """A cube of soft cells with a random ``share`` of stiff ones, joined here and there."""
    mesh = box((1.0, 1.0, 1.0), (cells, cells, cells))
    stiff = np.random.default_rng(3).random(mesh.cell_count) < share
    materials = [Isotropic(1.0, 0.3), Isotropic(ratio, 0.25)]
    return cantilever(mesh, materials, material_of_cell=stiff.astype(np.int32))


def graded(ratio: float) -> Model:
    """Elements that shrink by ``ratio`` towards the loaded end, along x and z."""
    mesh = box((1.0, 1.0, 1.0), (16, 2, 4))
    x = _graded(17, ratio)
    z = _graded(5, ratio)
    points = np.array(mesh.points)
    points[:, 0] = 4.0 * x[np.rint(points[:, 0] * 16).astype(int)]
    points[:, 2] = z[np.rint(points[:, 2] * 4).astype(int)]
    return cantilever(Mesh(points, mesh.cells, mesh.node_sets, mesh.face_sets))


def _graded(count: int, ratio: float) -> Float:
    steps = ratio ** -np.linspace(0.0, 1.0, count - 1)
    place = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(place / place[-1])


def barely_held(how: str) -> Model:
    """A block on one small clamp, or on six degrees of freedom."""
    mesh = box((3.0, 2.0, 2.5), (18, 4, 4))
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    if how == "one face":
        corner = (mesh.points[:, 0] == 0.0) & (mesh.points[:, 1] <= 0.5) & (
            mesh.points[:, 2] <= 0.7
        )  # fmt: skip
        fixed[corner] = True
    elif how == "one edge and a node":
        edge = (mesh.points[:, 0] == 0.0) & (mesh.points[:, 1] == 0.0)
        fixed[edge] = True
        fixed[np.flatnonzero(mesh.points[:, 1] == 2.0)[0]] = True
    else:
        nodes = [
            0,
            int(np.argmax(mesh.points @ [1.0, 0, 0])),
            int(np.argmax(mesh.points @ [0, 1.0, 0])),
        ]
        fixed[nodes[0]] = True
        fixed[nodes[1], 1:] = True
        fixed[nodes[2], 2] = True
    end = select_faces(mesh, name="x_max")
    side = select_faces(mesh, name="y_max")
    forces = np.stack(
        [face_force(mesh, end, (0.3, 0.2, -1.0)), face_force(mesh, side, (0.0, 1.0, 0.5))]
    )
    return Model(mesh, [STEEL], fixed=fixed, forces=forces)


def unequal_loads(ratio: float) -> Model:
    """Two load cases whose sizes differ by ``ratio``."""
    model = bar((4.0, 1.0, 0.7), (16, 4, 3))
    return Model(model.mesh, model.materials, fixed=model.fixed,
                 forces=model.load_cases * np.array([1.0, ratio])[:, None, None])  # fmt: skip


def pulled(ratio: float) -> Model:
    """A prescribed displacement ``ratio`` lengths large beside a force that hardly counts."""
    model = bar((4.0, 1.0, 0.7), (16, 4, 3))
    fixed = np.array(model.fixed)
    end = model.mesh.points[:, 0] == 4.0
    fixed[end, 0] = True
    prescribed = np.zeros(fixed.shape)
    prescribed[end, 0] = ratio
    return Model(model.mesh, model.materials, fixed=fixed, prescribed=prescribed,
                 forces=model.load_cases)  # fmt: skip


def two_bodies(ratio: float) -> Model:
    """A stiff block beside a slender, soft strip; both clamped, not connected."""
    block = box((1.0, 1.0, 0.8), (6, 4, 3))
    strip = box((5.0, 0.3, 0.1), (40, 2, 1), (0.0, 2.0, 0.0))
    points = np.concatenate([block.points, strip.points])
    cells = np.concatenate([block.cells["hex8"], strip.cells["hex8"] + block.node_count])
    mesh = Mesh(points, {"hex8": cells})
    material = (np.arange(len(cells)) >= block.cell_count).astype(np.int32)
    fixed = np.repeat(points[:, :1] == 0.0, 3, axis=1)
    forces = np.zeros((2, *points.shape))
    tips = [np.flatnonzero((points[:, 1] < 1.5) & (points[:, 0] == 1.0)),
            np.flatnonzero((points[:, 1] > 1.5) & (points[:, 0] == 5.0))]  # fmt: skip
    for case, nodes in enumerate(tips):
        forces[case, nodes] = np.array([0.2, 0.1, -1.0]) / len(nodes)
    return Model(mesh, [STEEL, Isotropic(210e9 / ratio, 0.3)], material_of_cell=material,
                 fixed=fixed, forces=forces)  # fmt: skip


def hard_cases() -> Iterator[HardCase]:
    """Every case, family by family."""
    modes, bbar, full = {"hex8": "incompatible"}, {"hex8": "bbar"}, {"hex8": "full"}
    for ratio, divisions in ((1.0, (4, 4, 4)), (10.0, (20, 2, 3)), (100.0, (100, 2, 2))):
        yield HardCase("slenderness", ratio, partial(bar, (ratio, 1.0, 0.7), divisions),
                       modes, ratio == 100)  # fmt: skip
    for ratio, note in ((1e3, "cubes"), (1e3, "long cells"), (1e4, "long cells")):
        count = 1000 if note == "cubes" else 100
        yield HardCase("slenderness", ratio, partial(bar, (ratio, 1.0, 0.7), (count, 1, 1)), modes,
                       note=note, quick=True)  # fmt: skip
    for ratio in (10.0, 100.0, 1000.0):
        yield HardCase("aspect", ratio, partial(bar, (1.0, 1.0, 1 / ratio), (6, 5, 2)), modes,
                       ratio == 1000, "flat")  # fmt: skip
        yield HardCase("aspect", ratio, partial(bar, (1.0, 0.9, 0.8), (int(2 * ratio), 2, 2)),
                       modes, note="stack")  # fmt: skip
        yield HardCase("aspect", ratio, partial(bar, (4.0, 4 / ratio, 3 / ratio), (4, 4, 3)), modes,
                       note="needles")  # fmt: skip
    for ratio in (100.0, 1000.0):
        yield HardCase("thin plate", ratio, partial(bar, (ratio, ratio, 1.0), (10, 8, 1)), modes,
                       ratio == 1000)  # fmt: skip
        yield HardCase("thin plate", ratio, partial(bar, (ratio, ratio, 1.0), (10, 8, 1)), full)
    for share, thickness in ((1e-4, 0.03), (1e-6, 0.01)):
        for tolerance in (1e-1, 1e-2, 1e-3):
            yield HardCase("pulled plate", share, partial(pulled_plate, share, thickness),
                           {"tet10": "full"}, thickness == 0.03 and tolerance == 1e-1,
                           f"{thickness:g} thick, to {tolerance:g}", tolerance)  # fmt: skip
    for amount in (0.3, 0.6, 0.9):
        yield HardCase("distortion", amount, partial(distorted, amount), modes)
        yield HardCase("distortion", amount, partial(distorted, amount), full)
    for least in (1e-1, 1e-3, 1e-6, 1e-12):
        yield HardCase("corner Jacobian", least, partial(crushed, least), modes, least == 1e-6)
        yield HardCase("corner Jacobian", least, partial(crushed, least), full)
    for amount in (1e-12, 1e-9, 1e-6, 1e-3):
        yield HardCase("almost regular", amount, partial(almost_regular, amount), modes,
                       amount == 1e-9)  # fmt: skip
    for ratio in (1e2, 1e4, 1e8):
        for layout in ("soft root", "stiff root", "layers", "scattered"):
            yield HardCase("E contrast", ratio, partial(contrast, ratio, layout), modes,
                           ratio == 1e8, layout)  # fmt: skip
    yield HardCase("E contrast", 1e8, partial(islands, 1e8, 8, 0.6), modes, True, "islands")
    yield HardCase("E contrast", 1e6, partial(islands, 1e6, 12, 0.4), modes, note="islands")
    for nu in (-0.9, 0.0, 0.49, 0.4999, 0.49999):
        for rules in (modes, bbar, full):
            material = Isotropic(210e9, nu)
            yield HardCase("nu", nu, partial(bar, (2.0, 1.0, 0.8), (8, 4, 4), material), rules,
                           nu == 0.49999)  # fmt: skip
    for nu in (0.4999, 0.49999):
        rubber = Isotropic(1e6, nu)
        yield HardCase("nu", nu, partial(distorted, 0.6, rubber), bbar, note="distorted")
        yield HardCase("nu", nu, partial(bar, (2.0, 1.0, 0.05), (20, 10, 2), rubber), bbar,
                       note="plate")  # fmt: skip
    for cells in (1e3, 1e6, 1e9):
        shift = (0.25 * cells, -0.21 * cells, 0.37 * cells)
        build = partial(bar, (4.0, 1.0, 0.7), (16, 4, 3), shift=shift)
        yield HardCase("offset in cells", cells, build, modes, cells == 1e6)
    for scale, note in ((1e-6, "um"), (1e-3, "mm"), (1e3, "km")):
        build = partial(bar, (4.0, 1.0, 0.7), (16, 4, 3), scale=scale)
        yield HardCase("unit", scale, build, modes, note=note)
    for load in (1e-12, 1e12, 1e-150, 1e150):
        build = partial(bar, (4.0, 1.0, 0.7), (16, 4, 3), load=load)
        yield HardCase("load", load, build, modes)
    for ratio in (1e6, 1e12):
        yield HardCase("loads apart", ratio, partial(unequal_loads, ratio), modes, ratio == 1e12)
        yield HardCase("prescribed", ratio, partial(pulled, ratio), modes)
    for k, how in enumerate(("one face", "one edge and a node", "six freedoms")):
        yield HardCase("barely held", k, partial(barely_held, how), modes, k == 2, how)
    for ratio in (1e2, 1e4):
        yield HardCase("graded", ratio, partial(graded, ratio), modes, ratio == 1e4)
    for ratio in (1.0, 1e6):
        yield HardCase("two bodies", ratio, partial(two_bodies, ratio), modes, ratio == 1e6)
    yield HardCase("tets", 10.0, partial(tet_bar, (10.0, 1.0, 0.7), (30, 3, 2)), {"tet4": "full"})
    yield HardCase("tets", 100.0, partial(tet_bar, (100.0, 1.0, 0.7), (150, 2, 2)),
                   {"tet4": "full"}, True)  # fmt: skip
    for ratio in (100.0, 1000.0):
        yield HardCase("flat", ratio, partial(tet_bar, (1.0, 1.0, 1 / ratio), (6, 5, 2)),
                       {"tet4": "full"})  # fmt: skip
        yield HardCase("flat", ratio, partial(tet_bar, (1.0, 1.0, 1 / ratio), (4, 3, 1), True),
                       {"tet10": "full"})  # fmt: skip
        for rule in ("full", "reduced"):
            flat = partial(brick20_bar, (1.0, 1.0, 1 / ratio), (4, 3, 1))
            yield HardCase("flat", ratio, flat, {"hex20": rule}, ratio == 100)
    yield HardCase("tets", 100.0, partial(tet_bar, (100.0, 1.0, 0.7), (50, 1, 1), True),
                   {"tet10": "full"}, True)  # fmt: skip
    for rule in ("full", "reduced"):
        for slender in (100.0, 1000.0):
            # two cells wide: a single row of reduced bricks has motions without energy
            bricks = partial(brick20_bar, (slender, 1.0, 0.7), (50, 2, 1))
            yield HardCase("slenderness", slender, bricks, {"hex20": rule})
        yield HardCase("nu", 0.49999, partial(brick20_bar, (2.0, 1.0, 0.8), (4, 2, 2), 0.49999),
                       {"hex20": rule}, True)  # fmt: skip
