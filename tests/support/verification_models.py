"""Published problems as meshes and models: MacNeal & Harder's beam, Cook's membrane, LE1, LE10.

Every problem is built from a structured block of the unit cube, cut into the wanted cells, and
mapped; midside nodes lie on straight edges in the beams and the membrane, and on the true curve in
the elliptic plates. Loads are consistent; units are those of the publication.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem import Isotropic, Model, face_force, nodal_force, pressure, solve
from gpusim.fem.recovery.stress import stress
from gpusim.mesh import CELL_TYPES, Mesh, box, quadratic, select_faces, split

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Problem:
    """A model with several load cases, and the quantity that each is judged by.

    ``values`` takes displacements (L,N,3) and the formulation, and returns one number per quantity
    named in ``published``.
    """

    name: str
    model: Model
    published: dict[str, float]
    values: Callable[[Float, str], dict[str, float]]

    def solved(self, formulation: str) -> dict[str, float]:
        """Our values, from the NumPy backend."""
        solution = solve(self.model, backend="numpy", formulation=formulation, tolerance=1e-7)
        assert solution.converged
        u = solution.u if solution.u.ndim == 3 else solution.u[None]
        return self.values(u, formulation)


def unit_block(kind: str, divisions: tuple[int, int, int]) -> Mesh:
    """The unit cube in hexahedra, or in the wedges or tetrahedra that they are cut into."""
    mesh = box((1.0, 1.0, 1.0), divisions)
    linear = CELL_TYPES[kind].linear
    if linear != "hex8":
        mesh = split(mesh, linear)
    return mesh if kind == linear else quadratic(mesh, serendipity=CELL_TYPES[kind].serendipity)


def mapped(mesh: Mesh, place: Callable[[Float], Float], straight: bool) -> Mesh:
    """The mesh with its nodes at ``place(unit coordinates)``; with ``straight`` edges the nodes
    between corners are put into their middle."""
    points = place(mesh.points)
    if straight:
        for kind, _, block in mesh.blocks():
            for column, group in enumerate(CELL_TYPES[kind].parents, CELL_TYPES[kind].corners):
                points[block[:, column]] = points[block[:, list(group)]].mean(axis=1)
    return Mesh(points, mesh.cells, mesh.node_sets, mesh.face_sets)


def node_at(mesh: Mesh, place: tuple[float, float, float]) -> int:
    """The number of the node there."""
    distance = np.linalg.norm(mesh.points - np.array(place), axis=1)
    assert distance.min() <= 1e-9
    return int(np.argmin(distance))


def slender_beam(kind: str, shape: str, across: int = 1, lean: float = 1.0) -> Problem:
    """MacNeal & Harder, Finite Elements in Analysis and Design 1 (1985) 3: 6 x 0.2 x 0.1.

    Six cells along the beam and ``across`` over depth and thickness. ``shape``: "rectangular",
    "trapezoidal" or "parallelogram" (sides at 45 degrees in the plane of the depth; ``lean`` is the
    tangent of that). Tip displacements are mean values over the end; the twist is by opposite
    forces on its edges.
    """
    slope = 0.0 if shape == "rectangular" else lean

    def place(unit: Float) -> Float:
        x, y, z = 6.0 * unit[:, 0], 0.2 * unit[:, 1] - 0.1, 0.1 * unit[:, 2]
        column = np.round(x)
        inner = (column > 0.5) & (column < 5.5)
        turn = np.where(column % 2 > 0.5, 1.0, -1.0) if shape == "trapezoidal" else 1.0
        return np.stack([x + np.where(inner, slope * turn * y, 0.0), y, z], axis=1)

    mesh = mapped(unit_block(kind, (6, across, across)), place, straight=True)
    fixed = np.repeat(mesh.points[:, :1] <= 1e-9, 3, axis=1)
    end = select_faces(mesh, name="x_max")
    tip = end.node_numbers()
    low, high = (tip[np.abs(mesh.points[tip, 1] - y) <= 1e-9] for y in (-0.1, 0.1))
    couple = nodal_force(mesh, high, (0.0, 0.0, 5.0)) + nodal_force(mesh, low, (0.0, 0.0, -5.0))
    forces = np.stack([*(face_force(mesh, end, axis) for axis in np.eye(3)), couple])

    def values(u: Float, _: str) -> dict[str, float]:
        mean = [float(u[case, tip, case].mean()) for case in range(3)]
        twist = float(u[3, high, 2].mean() - u[3, low, 2].mean()) / 0.2
        return dict(zip(published, [*mean, twist], strict=True))

    published = {"extension": 3e-5, "in-plane": 0.1081, "out-of-plane": 0.4321, "twist": 0.03208}
    model = Model(mesh, [Isotropic(1e7, 0.3)], fixed=fixed, forces=forces)
    return Problem(f"slender beam, {shape}", model, published, values)


def cook_membrane(kind: str, n: int) -> Problem:
    """Cook, J. Structural Division 100 (1974) 1851, as a slab of thickness 1, free to thin.

    Judged by the displacement in the middle of the loaded side.
    """

    def place(unit: Float) -> Float:
        x, s = 48.0 * unit[:, 0], unit[:, 1]
        low, high = 44.0 * x / 48.0, 44.0 + 16.0 * x / 48.0
        return np.stack([x, low + s * (high - low), unit[:, 2]], axis=1)

    mesh = mapped(unit_block(kind, (n, n, 1)), place, straight=True)
    fixed = np.repeat(mesh.points[:, :1] <= 1e-9, 3, axis=1)
    # clamped in the plane only, so that the slab thins everywhere: plane stress
    fixed[:, 2] = mesh.points[:, 2] <= 1e-9
    end = select_faces(mesh, name="x_max")
    model = Model(mesh, [Isotropic(1.0, 1.0 / 3.0)], fixed=fixed,
                  forces=face_force(mesh, end, (0.0, 1.0, 0.0)))  # fmt: skip
    middle = node_at(mesh, (48.0, 52.0, 0.0))
    return Problem(
        "Cook's membrane", model, {"deflection": 23.96},
        lambda u, _: {"deflection": float(u[0, middle, 1])},
    )  # fmt: skip


def elliptic_plate(kind: str, divisions: tuple[int, int, int], thick: bool) -> Problem:
    """NAFEMS LE10 (``thick``) and LE1: a quarter of an elliptic plate with an elliptic hole.

    Judged by the nodal stress yy at D, the end of the hole's long axis (on the loaded side).
    """
    height = 0.6 if thick else 0.1

    def place(unit: Float) -> Float:
        # closer together towards the hole, towards D, and towards the upper and lower sides
        radius, angle = unit[:, 0] ** 1.2, 0.5 * np.pi * unit[:, 1] ** 1.3
        level = 2.0 * unit[:, 2] - 1.0
        z = 0.5 * height * np.sign(level) * np.abs(level) ** (0.6 if thick else 1.0)
        a, b = 2.0 + 1.25 * radius, 1.0 + 1.75 * radius
        x, y = a * np.cos(angle), b * np.sin(angle)
        return np.stack([np.where(unit[:, 1] == 1.0, 0.0, x), y, z], axis=1)

    mesh = mapped(unit_block(kind, divisions), place, straight=False)
    x, y, z = mesh.points.T
    fixed = np.zeros(mesh.points.shape, dtype=bool)
    fixed[:, 0], fixed[:, 1] = x <= 1e-12, y <= 1e-12
    outer = (x / 3.25) ** 2 + (y / 2.75) ** 2 >= 1.0 - 1e-9
    if thick:
        fixed[outer, :2] = True
        fixed[outer & (np.abs(z) <= 1e-9), 2] = True
        forces = pressure(mesh, select_faces(mesh, name="z_max"), 1.0)
    else:
        fixed[:, 2] = z <= -0.5 * height + 1e-12
        forces = pressure(mesh, select_faces(mesh, name="x_max"), -10.0)
    model = Model(mesh, [Isotropic(210e3, 0.3)], fixed=fixed, forces=forces)
    corner = node_at(mesh, (2.0, 0.0, 0.5 * height))

    def values(u: Float, formulation: str) -> dict[str, float]:
        return {"stress yy at D": float(stress(model, u[0], formulation).nodal[corner, 1])}

    published = {"stress yy at D": -5.38 if thick else 92.7}
    name = "LE10 thick plate" if thick else "LE1 elliptic membrane"
    return Problem(name, model, published, values)
