"""Small meshes of every cell type for the tests, built without the package's own converters."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from gpusim.mesh import CELL_TYPES, Mesh

Float = npt.NDArray[np.float64]
Long = npt.NDArray[np.int64]

SIZE = (1.0, 0.8, 1.3)
# cell type -> (its quadratic form or itself); every type that exists is reached
KINDS = tuple(CELL_TYPES)


def bricks(divisions: tuple[int, int, int]) -> tuple[Float, Long]:
    """Points and (M,8) cells of a box of ``SIZE``, x fastest."""
    nx, ny, nz = divisions
    axes = [np.linspace(0.0, SIZE[k], divisions[k] + 1) for k in range(3)]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    k, j, i = (part.ravel() for part in np.indices((nz, ny, nx)))
    first = i + (nx + 1) * (j + (ny + 1) * k)
    ring = np.array([0, 1, nx + 2, nx + 1])
    corner = np.concatenate([ring, ring + (nx + 1) * (ny + 1)])
    return np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1), first[:, None] + corner


def shaken(points: Float, amount: float, seed: int = 3) -> Float:
    """The inner nodes of the box moved at random; its surface stays flat."""
    inner = ((points > 1e-9) & (points < np.array(SIZE) - 1e-9)).all(axis=1)
    moved = points.copy()
    moved[inner] += amount * np.random.default_rng(seed).uniform(-1, 1, (int(inner.sum()), 3))
    return moved


def linear_mesh(kind: str, divisions: tuple[int, int, int], amount: float = 0.0) -> Mesh:
    """The box, cut into cells of one linear type."""
    points, hexes = bricks(divisions)
    points = shaken(points, amount)
    if kind == "hex8":
        return Mesh(points, {"hex8": hexes})
    if kind == "wedge6":
        return Mesh(points, {"wedge6": hexes[:, _WEDGES].reshape(-1, 6)})
    if kind == "tet4":
        around = [1, 2, 3, 7, 4, 5]
        pattern = np.array([[0, around[k], around[(k + 1) % 6], 6] for k in range(6)])
        return Mesh(points, {"tet4": hexes[:, pattern].reshape(-1, 4)})
    middle = len(points) + np.arange(len(hexes))
    points = np.concatenate([points, points[hexes].mean(axis=1)])
    base = hexes[:, _INWARD]
    apex = np.broadcast_to(middle[:, None, None], (*base.shape[:2], 1))
    return Mesh(points, {"pyramid5": np.concatenate([base, apex], axis=2).reshape(-1, 5)})


_WEDGES = np.array([[0, 1, 2, 4, 5, 6], [0, 2, 3, 4, 6, 7]])
# faces of a hexahedron as a pyramid inside sees them: counter-clockwise from within
_INWARD = CELL_TYPES["hex8"].faces[:, [0, 3, 2, 1]]


def mixed_mesh(amount: float = 0.0) -> Mesh:
    """Wedges, hexahedra, and pyramids that lead over to tetrahedra, from left to right."""
    points, hexes = bricks((3, 2, 2))
    points = shaken(points, amount)
    column = np.arange(len(hexes)) % 3
    wedges = hexes[column == 0][:, _WEDGES].reshape(-1, 6)
    pyramids, tets = [], []
    middles = []
    for cell in hexes[column == 2]:
        middle = len(points) + len(middles)
        middles.append(points[cell].mean(axis=0))
        for number, face in enumerate(CELL_TYPES["hex8"].faces):
            ring = cell[face[[0, 3, 2, 1]]]
            if number == 5:  # towards the hexahedra
                pyramids.append([*ring, middle])
                continue
            # the diagonal from the least node: neighbours agree on it
            a, b, c, d = np.roll(ring, -int(np.argmin(ring)))
            tets += [[a, b, c, middle], [a, c, d, middle]]
    return Mesh(
        np.concatenate([points, middles]),
        {
            "wedge6": wedges,
            "hex8": hexes[column == 1],
            "pyramid5": np.array(pyramids),
            "tet4": np.array(tets),
        },
    )


def with_middles(mesh: Mesh, kinds: dict[str, str], bulge: float = 0.0) -> Mesh:
    """The quadratic form of a linear mesh, ``kinds`` linear -> quadratic type.

    ``bulge`` moves the new nodes inside the box at random by as much: curved cells.
    """
    points = [*mesh.points]
    number: dict[tuple[int, ...], int] = {}
    cells = {}
    for kind, block in mesh.cells.items():
        rows = []
        for cell in block:
            row = [int(node) for node in cell]
            for group in CELL_TYPES[kinds[kind]].parents:
                key = tuple(sorted(int(cell[corner]) for corner in group))
                if key not in number:
                    number[key] = len(points)
                    points.append(mesh.points[list(key)].mean(axis=0))
                row.append(number[key])
            rows.append(row)
        cells[kinds[kind]] = np.array(rows)
    place = np.array(points)
    place[mesh.node_count :] = shaken(place[mesh.node_count :], bulge, seed=8)
    return Mesh(place, cells)


def mesh_of(
    kind: str, divisions: tuple[int, int, int] = (3, 2, 2), amount: float = 0.0, bulge: float = 0.0
) -> Mesh:
    """The box cut into cells of any one type."""
    base = CELL_TYPES[kind].linear
    mesh = linear_mesh(base, divisions, amount)
    return mesh if kind == base else with_middles(mesh, {base: kind}, bulge)


SERENDIPITY = {"hex8": "hex20", "wedge6": "wedge15", "pyramid5": "pyramid13", "tet4": "tet10"}
