"""The cases of the solver benchmark, by name and size."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, face_force
from gpusim.mesh import Mesh, box, plate_with_hole, select_faces

__all__ = ["CASES", "SIZES", "Case", "find_cases"]

Float = npt.NDArray[np.float64]

STEEL = Isotropic(210e3, 0.3)
SIZES = ("small", "standard", "full")


@dataclass(frozen=True)
class Case:
    """One model of the benchmark; lengths in mm, forces in N, moduli in MPa.

    ``size``: the smallest of `SIZES` that runs it. ``divisions`` and ``lengths`` of a box clamped
    at x = 0, None for other bodies. ``peers``: whether a peer can be tried at this size.
    """

    name: str
    family: str
    size: str
    kind: str
    rule: str
    material: Isotropic
    build: Callable[[], Mesh]
    force: tuple[float, float, float]
    divisions: tuple[int, int, int] | None = None
    lengths: tuple[float, float, float] | None = None
    peers: bool = True

    def model(self, load_cases: int = 1) -> Model:
        """Clamped at the least x, loaded on the greatest; a second load case pulls elsewhere."""
        mesh = self.build()
        low, high = mesh.bounds
        fixed = np.repeat(mesh.points[:, :1] <= low[0] + 1e-9 * (high[0] - low[0]), 3, axis=1)
        end = select_faces(mesh, plane=(high, "+x"))
        force = np.array(self.force)
        loads = [face_force(mesh, end, force), face_force(mesh, end, np.roll(force, 1) + 0.3)]
        return Model(mesh, [self.material], fixed=fixed, forces=np.stack(loads[:load_cases]))

    def describe(self) -> dict[str, Any]:
        """What a peer's script needs to know beside the arrays."""
        return {
            "name": self.name, "kind": self.kind, "rule": self.rule, "E": self.material.E,
            "nu": self.material.nu, "divisions": self.divisions, "size": self.lengths,
        }  # fmt: skip


def _box(
    family: str, label: str, size: str, lengths: tuple[float, float, float],
    divisions: tuple[int, int, int], force: tuple[float, float, float], *,
    nu: float = 0.3, rule: str = "incompatible", peers: bool = True,
) -> Case:  # fmt: skip
    return Case(
        f"{family}-{label}", family, size, "hex8", rule, Isotropic(210e3, nu),
        partial(box, lengths, divisions), force, divisions, lengths, peers,
    )  # fmt: skip


def _beam(label: str, size: str, divisions: tuple[int, int, int]) -> Case:
    return _box("beam", label, size, (800.0, 40.0, 4.0), divisions, (0.0, 2.0, -10.0))


def _cube(label: str, size: str, n: int, peers: bool = True) -> Case:
    return _box("cube", label, size, (100.0,) * 3, (n,) * 3, (0.0, 300.0, -1000.0), peers=peers)


def _nearly_incompressible(label: str, size: str, n: int) -> Case:
    return _box("cube-nu4999", label, size, (100.0,) * 3, (n,) * 3, (0.0, 300.0, -1000.0),
                nu=0.4999, rule="bbar")  # fmt: skip


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


def _plate(label: str, size: str, around: int, radial: int) -> Case:
    """A thin plate with a hole, swept; cells 4 (fine) to 20 (coarse) times as long as thick."""
    return Case(
        f"plate-{label}", "plate", size, "hex8", "incompatible", STEEL,
        partial(plate_with_hole, 100.0, 40.0, 1.0, 10.0, around=around, radial=radial, through=4),
        (500.0, 0.0, -5.0),
    )  # fmt: skip


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
    _beam("10k", "small", (100, 10, 2)),
    _beam("100k", "standard", (320, 20, 4)),
    _beam("300k", "standard", (640, 30, 4)),
    _beam("1M", "full", (960, 40, 8)),
    _cube("10k", "small", 14),
    _cube("30k", "small", 20),
    _cube("100k", "standard", 32),
    _cube("345k", "standard", 48),
    _cube("971k", "full", 68),
    _cube("3M", "full", 100, peers=False),
    _nearly_incompressible("10k", "small", 14),
    _nearly_incompressible("100k", "standard", 32),
    _uneven("10k", "small", 14),
    _uneven("100k", "standard", 32),
    _plate("10k", "small", 32, 16),
    _plate("72k", "standard", 96, 40),
    _plate("280k", "full", 192, 80),
    _bracket("15k", "small", 6.0),
    _bracket("123k", "standard", 2.6),
    _bracket("522k", "full", 1.55),
)


def find_cases(size: str, name: str | None = None) -> list[Case]:
    """The cases of ``size`` and smaller; or those whose name begins with ``name``, of any size."""
    if size not in SIZES:
        raise InputError(f"bench: size; got {size!r}; expected one of {', '.join(SIZES)}")
    if name is None:
        return [case for case in CASES if SIZES.index(case.size) <= SIZES.index(size)]
    found = [case for case in CASES if case.name == name] or [
        case
        for case in CASES
        if case.family == name and SIZES.index(case.size) <= SIZES.index(size)
    ]
    if not found:
        known = ", ".join(dict.fromkeys([c.family for c in CASES] + [c.name for c in CASES]))
        raise InputError(f"bench: case; got {name!r}; expected one of {known}")
    return found
