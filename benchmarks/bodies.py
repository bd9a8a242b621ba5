"""Bodies that `benchmarks.faces` cuts finer and finer: the shape stays, the faces get smaller."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import gpusim as gs
from gpusim.mesh import boundary_faces, select_faces
from gpusim.mesh import crane as crane_mesh

Array = npt.NDArray[np.float64]
Numbers = npt.NDArray[np.int64]


def plate(faces: int, paint: gs.paint.Paint | None = None) -> gs.Surface:
    """A plate of 1 x 0.66 with gentle bumps, painted with squares if with nothing else, in about
    ``faces`` quads."""
    rows = max(int(np.sqrt(faces / 1.5)), 2)
    columns = max(faces // rows, 2)
    x, z = np.linspace(-0.5, 0.5, columns + 1), np.linspace(-0.33, 0.33, rows + 1)
    flat = np.stack(np.meshgrid(x, [0.0], z, indexing="ij"), axis=-1).reshape(-1, 3)
    bumpy = flat.copy()
    bumpy[:, 1] = 0.01 * np.sin(7.0 * flat[:, 0]) * np.cos(5.0 * flat[:, 2])
    number = np.arange(len(flat)).reshape(columns + 1, rows + 1)
    quads = np.stack([number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]], -1)
    return gs.Surface(bumpy, quads.reshape(-1, 4), paint or gs.paint.Checker(0.05), reference=flat)


def bent_sheet(faces: int) -> gs.Surface:
    """A smaller plate, bent, before the place of the wall."""
    flat = plate(faces)
    points = flat.points * [0.6, 1.0, 0.6]
    points[:, 1] += 0.05 * np.sin(4.0 * flat.points[:, 0]) - 0.1
    return gs.Surface(points, flat.faces, gs.paint.Plain(0.5))


def beam(faces: int) -> gs.Surface:
    """The skin of a bent beam of 1 x 0.1 x 0.1 in about ``faces`` quads, squares on its front."""
    across = max(int(np.sqrt(faces / 42.0)), 1)
    cells = np.array([10 * across, across, across])
    corners, quads, way = _skin(np.ones(cells, bool))
    rest = corners / cells * [1.0, 0.1, 0.1] - [0.5, 0.05, 0.05]
    points = rest - [0.0, 0.0, 0.08] * (rest[:, :1] + 0.5) ** 2
    return gs.Surface(
        points, quads, {"front": gs.paint.Checker(0.02), "rest": gs.paint.Plain(0.6)},
        region=np.where(way == 3, 0, 1).astype(np.int32), reference=rest,
    )  # fmt: skip


def rod(faces: int) -> gs.Surface:
    """The skin of a bent round bar of 1 x 0.16 in about ``faces`` quads, closed by round ends."""
    around = max(int(np.sqrt(2.0 * faces)), 8)
    along = max(faces // around, 8)
    turn = np.arange(around) * (2.0 * np.pi / around)
    place = np.sin(np.linspace(-0.5 * np.pi, 0.5 * np.pi, along + 2)[1:-1])
    radius = 0.08 * np.sqrt(1.0 - place**16)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cuts = [np.insert(r * ring, 0, 0.5 * at, axis=1) for at, r in zip(place, radius, strict=True)]
    points = np.concatenate([*cuts, [[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]]])
    points[:, 1] -= 0.1
    points[:, 2] -= 0.05 * (points[:, 0] + 0.5) ** 2
    first = np.arange(around)
    after = np.roll(first, -1)
    none, last = np.full(around, -1), around * (along - 1)
    ends = [
        np.stack([np.full(around, len(points) - 2), after, first, none], axis=1),
        np.stack([np.full(around, len(points) - 1), first + last, after + last, none], axis=1),
    ]
    return gs.Surface(points, np.concatenate([_rings(along, around), *ends]), gs.paint.Plain(0.5))


def wall() -> gs.Surface:
    """Behind the bodies but for the crane."""
    corners = [[-1.0, 0.4, -0.8], [1.0, 0.4, -0.8], [1.0, 0.4, 0.8], [-1.0, 0.4, 0.8]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), gs.paint.Plain())


def crane_wall() -> gs.Surface:
    """Behind the crane."""
    corners = [[-0.6, 0.15, -0.36], [1.2, 0.15, -0.36], [1.2, 0.15, 0.94], [-0.6, 0.15, 0.94]]
    return gs.Surface(np.array(corners), np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.55))


def tube(faces: int) -> gs.Surface:
    """An open tube of 1 x 0.2, slightly bent, in about ``faces`` quads: its near half hides its far
    half."""
    around = max(int(np.sqrt(0.63 * faces)), 8)
    turn = np.arange(around) * (2.0 * np.pi / around)
    place = np.linspace(-0.5, 0.5, max(faces // around, 2) + 1)
    ring = 0.1 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate([np.insert(ring, 0, x, axis=1) for x in place])
    points[:, 1] -= 0.1
    points[:, 2] -= 0.05 * (points[:, 0] + 0.5) ** 2
    return gs.Surface(points, _rings(len(place), around), gs.paint.Plain(0.5))


def flanges(faces: int) -> gs.Surface:
    """The skin of a bent I beam of 1 x 0.16 x 0.16 in about ``faces`` quads: its flanges darken
    its web."""
    across = 7 * max(round(0.16 * np.sqrt(faces / 0.96) / 7.0), 1)
    part = np.arange(across) * 7 // across
    section = (part[:, None] == 3) | (part == 0) | (part == 6)
    cells = np.array([round(across / 0.16), across, across])
    corners, quads, _ = _skin(np.broadcast_to(section, cells))
    points = corners / cells * [1.0, 0.16, 0.16] - [0.5, 0.18, 0.08]
    points[:, 2] -= 0.05 * (points[:, 0] + 0.5) ** 2
    return gs.Surface(points, quads, gs.paint.Plain(0.5))


def eggs(faces: int) -> gs.Surface:
    """A sheet with bumps that a low lamp's light doesn't get behind, in about ``faces`` quads."""
    flat = plate(faces)
    points = flat.points * [0.6, 1.0, 0.6]
    x, z = flat.points[:, 0], flat.points[:, 2]
    points[:, 1] = -0.1 + 0.012 * np.sin(60.0 * x) * np.sin(60.0 * z)
    return gs.Surface(points, flat.faces, gs.paint.Plain(0.5))


def crane(faces: int) -> gs.Surface:
    """The skin of the tower crane of `examples/crane.toml` in about ``faces`` quads, bent much as
    its load bends it: steel with markers."""
    times = np.sqrt(faces / 6600.0)
    through, across = (max(round(times * n), 1) for n in (2, 6))
    mesh = crane_mesh(element_size=0.003 / times, through=through, across=across)
    rest = mesh.points
    x, up = np.maximum(rest[:, 0], 0.0) / 0.597, np.maximum(rest[:, 2], 0.0) / 0.562
    bent = rest.copy()
    bent[:, 0] += 0.012 * up**2
    bent[:, 2] -= 0.0325 * x * (0.6 + 0.4 * x) * (rest[:, 2] > 0.5617)
    outside = boundary_faces(mesh)
    skin = gs.Skin(mesh, outside)
    region = np.zeros(len(outside), np.int32)
    line = np.linspace(0.0, 1.0, 10)[:, None]
    steel = {"albedo": 0.56, "roughness": 0.65, "metallic": 1.0}
    paints: dict[str, gs.paint.Paint] = {"steel": gs.paint.Plain(**steel)}
    frames = {}
    for number, (name, place, bounds) in enumerate(
        (
            ("column", [0.003, 0.025] + line * [0.0, 0.531], {"z_min": 0.0, "z_max": 0.562}),
            ("beam", [0.036, 0.564] + line * [0.558, 0.0], {"z_min": 0.562}),
        ),
        start=1,
    ):
        own = select_faces(mesh, normal="-y", bounds=bounds, faces=outside)
        region[skin.numbers(own)] = number
        frames[name] = gs.PaintFrame(
            np.array([0.0, -0.02, 0.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
        )
        paints[name] = gs.paint.Markers(
            place, 0.006 if number == 1 else 0.004, ground=0.56, roughness=0.65, metallic=1.0
        )
    surface = skin.surface(paints, region, frames, "crane")
    return skin.moved(surface, bent - rest)


def _rings(rings: int, around: int) -> Numbers:
    """Quads (n, 4) between ``rings`` closed rows of ``around`` points."""
    first = np.arange(around)
    row = around * np.arange(rings - 1)[:, None]
    after = np.roll(first, -1)
    quads = np.stack([first + row, after + row, after + row + around, first + row + around], -1)
    return np.asarray(quads.reshape(-1, 4))


def _skin(filled: npt.NDArray[np.bool_]) -> tuple[Array, Numbers, Numbers]:
    """Corners (n, 3), in cells, and quads (m, 4) of the skin of the cells that are ``filled``
    (x, y, z), wound outwards; and which way (m,) each looks: +x, -x, +y, -y, +z, -z."""
    padded = np.pad(filled, 1)
    quads, ways = [], []
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for way in (1, -1):
            bare = padded & ~np.roll(padded, -way, axis=axis)
            corner = np.argwhere(bare) - 1
            corner[:, axis] += way == 1
            own = np.repeat(corner[:, None], 4, axis=1)
            own[:, [1, 2], first] += 1
            own[:, [2, 3], second] += 1
            quads.append(own[:, ::way])
            ways.append(np.full(len(own), len(ways)))
    corners, number = np.unique(np.concatenate(quads).reshape(-1, 3), axis=0, return_inverse=True)
    return corners.astype(float), number.reshape(-1, 4), np.concatenate(ways)
