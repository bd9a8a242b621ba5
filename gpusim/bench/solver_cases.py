"""The cases of the solver benchmark that need gpusim alone, by name and size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from gpusim.errors import InputError
from gpusim.fem import Isotropic, Model, face_force
from gpusim.mesh import Mesh, box, plate_with_hole, select_faces

STEEL = Isotropic(210e3, 0.3)
SIZES = ("small", "standard", "full")


@dataclass(frozen=True)
class Case:
    """One model of the benchmark; lengths in mm, forces in N, moduli in MPa.

    ``size``: the smallest of `SIZES` that runs it. ``divisions`` and ``lengths`` of a box clamped
    at x = 0, None for other bodies.
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

    def model(self, load_cases: int = 1) -> Model:
        """Clamped at the least x, loaded on the greatest; a second load case pulls elsewhere."""
        mesh = self.build()
        low, high = mesh.bounds
        fixed = np.repeat(mesh.points[:, :1] <= low[0] + 1e-9 * (high[0] - low[0]), 3, axis=1)
        end = select_faces(mesh, plane=(high, "+x"))
        force = np.array(self.force)
        loads = [face_force(mesh, end, force), face_force(mesh, end, np.roll(force, 1) + 0.3)]
        return Model(mesh, [self.material], fixed=fixed, forces=np.stack(loads[:load_cases]))


def _box(
    family: str, label: str, size: str, lengths: tuple[float, float, float],
    divisions: tuple[int, int, int], *, force: tuple[float, float, float],
    nu: float = 0.3, rule: str = "incompatible",
) -> Case:  # fmt: skip
    return Case(
        f"{family}-{label}", family, size, "hex8", rule, Isotropic(210e3, nu),
        partial(box, lengths, divisions), force, divisions, lengths,
    )  # fmt: skip


def _beam(label: str, size: str, divisions: tuple[int, int, int]) -> Case:
    return _box("beam", label, size, (800.0, 40.0, 4.0), divisions, force=(0.0, 2.0, -10.0))


def _cube(label: str, size: str, n: int) -> Case:
    return _box("cube", label, size, (100.0,) * 3, (n,) * 3, force=(0.0, 300.0, -1000.0))


def _nearly_incompressible(label: str, size: str, n: int) -> Case:
    return _box("cube-nu4999", label, size, (100.0,) * 3, (n,) * 3, force=(0.0, 300.0, -1000.0),
                nu=0.4999, rule="bbar")  # fmt: skip


def _plate(label: str, size: str, around: int, radial: int) -> Case:
    """A thin plate with a hole, swept; cells 4 (fine) to 20 (coarse) times as long as thick."""
    return Case(
        f"plate-{label}", "plate", size, "hex8", "incompatible", STEEL,
        partial(plate_with_hole, 100.0, 40.0, 1.0, 10.0, around=around, radial=radial, through=4),
        (500.0, 0.0, -5.0),
    )  # fmt: skip


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
    _cube("3M", "full", 100),
    _nearly_incompressible("10k", "small", 14),
    _nearly_incompressible("100k", "standard", 32),
    _plate("10k", "small", 32, 16),
    _plate("72k", "standard", 96, 40),
    _plate("280k", "full", 192, 80),
)


def find_cases(size: str, name: str | None = None, cases: Sequence[Case] = CASES) -> list[Case]:
    """The cases of ``size`` and smaller; of them one family, or one case of any size."""
    if size not in SIZES:
        raise InputError(f"bench: size; got {size!r}; expected one of {', '.join(SIZES)}")
    within = [case for case in cases if SIZES.index(case.size) <= SIZES.index(size)]
    if name is None:
        return within
    found = [case for case in cases if case.name == name] or [
        case for case in within if case.family == name
    ]
    if not found:
        known = ", ".join(dict.fromkeys([c.family for c in cases] + [c.name for c in cases]))
        raise InputError(f"bench: case; got {name!r}; expected one of {known}")
    return found
