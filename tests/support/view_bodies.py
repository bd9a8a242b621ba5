"""A small crane, solved, with the surfaces of its scene: a wall behind it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

import gpusim as gs
from gpusim.surface.surface import Surface


@dataclass(frozen=True, eq=False)
class SmallCrane:
    """``surface``: at rest; ``moved``: magnified."""

    model: gs.Model
    solution: gs.Solution
    skin: gs.Skin
    surface: Surface
    moved: Surface
    wall: Surface


@cache
def small_crane() -> SmallCrane:
    """The crane of the example, coarse; its elements are crooked once it has moved."""
    mesh = gs.mesh.crane(element_size=0.02, through=1, across=3)
    fixed = np.repeat(mesh.points[:, 2:] <= 1e-9, 3, axis=1)
    top = gs.mesh.select_faces(mesh, normal="+z")
    top = top[mesh.points[top.nodes[:, :4]].mean(axis=1)[:, 0] > 0.49]
    forces = gs.fem.face_force(mesh, top, total=(0.0, 0.0, -13.0))
    model = gs.Model(mesh, gs.Isotropic(210e9, 0.3), fixed=fixed, forces=forces)
    solution = gs.solve(model, backend="numpy")
    faces = gs.mesh.boundary_faces(mesh)
    skin = gs.Skin(mesh, faces)
    side = (faces.normals[:, 1] < -0.9).astype(np.int32)
    paints = {"steel": gs.paint.Plain(0.5), "side": gs.paint.Plain(0.3)}
    surface = skin.surface(paints, side, {}, "crane")
    corners = np.array([[-0.6, 0.15, -0.3], [1.2, 0.15, -0.3], [1.2, 0.15, 1.0], [-0.6, 0.15, 1.0]])
    wall = Surface(corners, np.array([[0, 1, 2, 3]]), gs.paint.Plain(0.7), name="wall")
    moved = skin.moved(surface, 20.0 * solution.u)
    return SmallCrane(model, solution, skin, surface, moved, wall)


def camera_before(distortion: list[float] | None = None) -> gs.Camera:
    """It sees the crane and the wall from the side, off its middle."""
    return gs.Camera.from_lens(
        (36.0, 24.0), 30.0, (231, 154), (-0.35, -1.0, 0.75), (0.27, 0.0, 0.27),
        distortion=distortion, principal_point_offset_mm=(0.7, -0.4),
    )  # fmt: skip
