"""The cases of the solver benchmark: gpusim's own, uneven bricks, a bracket by gmsh."""

from __future__ import annotations

from functools import partial

import numpy as np

from gpusim.bench.solver_cases import CASES as BOX_CASES
from gpusim.bench.solver_cases import STEEL, Case
from gpusim.errors import InputError
from gpusim.mesh import Mesh, box

__all__ = ["CASES"]


def _uneven(label: str, size: str, n: int) -> Case:
    """A cube no two of whose bricks are alike, as a mesher leaves them."""
    return Case(
        f"uneven-{label}", "uneven", size, "hex8", "incompatible", STEEL,
        partial(uneven_bricks, 100.0, n), (0.0, 300.0, -1000.0), (n, n, n), (100.0,) * 3,
    )  # fmt: skip


def uneven_bricks(length: float, n: int) -> Mesh:
    """A cube of n^3 hex8 whose inner nodes are moved by up to a tenth of a cell along each axis."""
    mesh = box((length,) * 3, (n,) * 3)
    low, high = mesh.bounds
    inner = ((mesh.points > low) & (mesh.points < high)).all(axis=1)
    move = np.random.default_rng(1).uniform(-0.1, 0.1, mesh.points.shape) * length / n
    return mesh.moved(np.where(inner[:, None], move, 0.0))


def bracket(length: float) -> Mesh:
    """An L-shaped bracket with a hole in its base, tet10, meshed by gmsh with cells of ``length``.

    The base lies on z = 0 from x = 0, the arm stands at the far end and is loaded on its side.
    """
    try:
        import gmsh
    except ImportError:
        raise InputError(
            "bench: the bracket needs gmsh; got no such module; expected `pip install gmsh`, or "
            "another --case"
        ) from None
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.option.setNumber("Mesh.MeshSizeMin", length)
        gmsh.option.setNumber("Mesh.MeshSizeMax", length)
        solids = gmsh.model.occ
        base = solids.addBox(0, 0, 0, 100, 60, 12)
        arm = solids.addBox(88, 0, 0, 12, 60, 80)
        hole = solids.addCylinder(40, 30, -1, 0, 0, 14, 11)
        body, _ = solids.fuse([(3, base)], [(3, arm)])
        solids.cut(body, [(3, hole)])
        solids.synchronize()
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(2)
        gmsh.option.setNumber("Mesh.SecondOrderLinear", 1)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, nodes = gmsh.model.mesh.getElementsByType(11)
    finally:
        gmsh.finalize()
    number = np.zeros(int(tags.max()) + 1, dtype=np.int64)
    number[tags] = np.arange(len(tags))
    cells = number[nodes].reshape(-1, 10)
    # gmsh counts the last two edges the other way round than VTK
    cells = cells[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
    used, compact = np.unique(cells, return_inverse=True)
    return Mesh(
        coordinates.reshape(-1, 3)[used], {"tet10": compact.reshape(-1, 10).astype(np.int32)}
    )


def _bracket(label: str, size: str, length: float) -> Case:
    return Case(f"bracket-{label}", "bracket", size, "tet10", "full", STEEL,
                partial(bracket, length), (0.0, 200.0, -500.0))  # fmt: skip


CASES = (
    *BOX_CASES,
    _uneven("10k", "small", 14),
    _uneven("100k", "standard", 32),
    _bracket("15k", "small", 6.0),
    _bracket("123k", "standard", 2.6),
    _bracket("522k", "full", 1.55),
)
