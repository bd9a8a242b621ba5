"""The bodies of the stability suite: small models, each extreme in one way."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic, Model, face_force
from gpusim.mesh import Mesh, box, quadratic, select_faces

Float = npt.NDArray[np.float64]
Triple = tuple[float, float, float]
Counts = tuple[int, int, int]

STEEL = Isotropic(210e9, 0.3)


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
