"""The hard cases of the stability suite, family by family."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from benchmarks.stability.hard_bodies import (
    almost_regular,
    bar,
    barely_held,
    brick20_bar,
    contrast,
    crushed,
    distorted,
    graded,
    islands,
    pulled,
    pulled_plate,
    tet_bar,
    two_bodies,
    unequal_loads,
)
from gpusim.fem import Isotropic, Model

__all__ = ["HardCase", "hard_cases"]

MODES, BBAR, FULL = {"hex8": "incompatible"}, {"hex8": "bbar"}, {"hex8": "full"}


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


def _proportions() -> Iterator[HardCase]:
    """Slender, flat and thin bodies of bricks."""
    for ratio, divisions in ((1.0, (4, 4, 4)), (10.0, (20, 2, 3)), (100.0, (100, 2, 2))):
        yield HardCase("slenderness", ratio, partial(bar, (ratio, 1.0, 0.7), divisions),
                       MODES, ratio == 100)  # fmt: skip
    for ratio, note in ((1e3, "cubes"), (1e3, "long cells"), (1e4, "long cells")):
        count = 1000 if note == "cubes" else 100
        yield HardCase("slenderness", ratio, partial(bar, (ratio, 1.0, 0.7), (count, 1, 1)), MODES,
                       note=note, quick=True)  # fmt: skip
    for ratio in (10.0, 100.0, 1000.0):
        yield HardCase("aspect", ratio, partial(bar, (1.0, 1.0, 1 / ratio), (6, 5, 2)), MODES,
                       ratio == 1000, "flat")  # fmt: skip
        yield HardCase("aspect", ratio, partial(bar, (1.0, 0.9, 0.8), (int(2 * ratio), 2, 2)),
                       MODES, note="stack")  # fmt: skip
        yield HardCase("aspect", ratio, partial(bar, (4.0, 4 / ratio, 3 / ratio), (4, 4, 3)), MODES,
                       note="needles")  # fmt: skip
    for ratio in (100.0, 1000.0):
        yield HardCase("thin plate", ratio, partial(bar, (ratio, ratio, 1.0), (10, 8, 1)), MODES,
                       ratio == 1000)  # fmt: skip
        yield HardCase("thin plate", ratio, partial(bar, (ratio, ratio, 1.0), (10, 8, 1)), FULL)
    for share, thickness in ((1e-4, 0.03), (1e-6, 0.01)):
        for tolerance in (1e-1, 1e-2, 1e-3):
            yield HardCase("pulled plate", share, partial(pulled_plate, share, thickness),
                           {"tet10": "full"}, thickness == 0.03 and tolerance == 1e-1,
                           f"{thickness:g} thick, to {tolerance:g}", tolerance)  # fmt: skip


def _cell_shapes() -> Iterator[HardCase]:
    """Bad cells: moved nodes, small corner Jacobians, grids that are almost regular."""
    for amount in (0.3, 0.6, 0.9):
        yield HardCase("distortion", amount, partial(distorted, amount), MODES)
        yield HardCase("distortion", amount, partial(distorted, amount), FULL)
    for least in (1e-1, 1e-3, 1e-6, 1e-12):
        yield HardCase("corner Jacobian", least, partial(crushed, least), MODES, least == 1e-6)
        yield HardCase("corner Jacobian", least, partial(crushed, least), FULL)
    for amount in (1e-12, 1e-9, 1e-6, 1e-3):
        yield HardCase("almost regular", amount, partial(almost_regular, amount), MODES,
                       amount == 1e-9)  # fmt: skip


def _materials() -> Iterator[HardCase]:
    """Contrasts of stiffness and nearly incompressible bodies."""
    for ratio in (1e2, 1e4, 1e8):
        for layout in ("soft root", "stiff root", "layers", "scattered"):
            yield HardCase("E contrast", ratio, partial(contrast, ratio, layout), MODES,
                           ratio == 1e8, layout)  # fmt: skip
    yield HardCase("E contrast", 1e8, partial(islands, 1e8, 8, 0.6), MODES, True, "islands")
    yield HardCase("E contrast", 1e6, partial(islands, 1e6, 12, 0.4), MODES, note="islands")
    for nu in (-0.9, 0.0, 0.49, 0.4999, 0.49999):
        for rules in (MODES, BBAR, FULL):
            material = Isotropic(210e9, nu)
            yield HardCase("nu", nu, partial(bar, (2.0, 1.0, 0.8), (8, 4, 4), material), rules,
                           nu == 0.49999)  # fmt: skip
    for nu in (0.4999, 0.49999):
        rubber = Isotropic(1e6, nu)
        yield HardCase("nu", nu, partial(distorted, 0.6, rubber), BBAR, note="distorted")
        yield HardCase("nu", nu, partial(bar, (2.0, 1.0, 0.05), (20, 10, 2), rubber), BBAR,
                       note="plate")  # fmt: skip


def _scales() -> Iterator[HardCase]:
    """Far from the origin, other units, small and large loads, weak supports."""
    for cells in (1e3, 1e6, 1e9):
        shift = (0.25 * cells, -0.21 * cells, 0.37 * cells)
        build = partial(bar, (4.0, 1.0, 0.7), (16, 4, 3), shift=shift)
        yield HardCase("offset in cells", cells, build, MODES, cells == 1e6)
    for scale, note in ((1e-6, "um"), (1e-3, "mm"), (1e3, "km")):
        build = partial(bar, (4.0, 1.0, 0.7), (16, 4, 3), scale=scale)
        yield HardCase("unit", scale, build, MODES, note=note)
    for load in (1e-12, 1e12, 1e-150, 1e150):
        build = partial(bar, (4.0, 1.0, 0.7), (16, 4, 3), load=load)
        yield HardCase("load", load, build, MODES)
    for ratio in (1e6, 1e12):
        yield HardCase("loads apart", ratio, partial(unequal_loads, ratio), MODES, ratio == 1e12)
        yield HardCase("prescribed", ratio, partial(pulled, ratio), MODES)
    for k, how in enumerate(("one face", "one edge and a node", "six freedoms")):
        yield HardCase("barely held", k, partial(barely_held, how), MODES, k == 2, how)
    for ratio in (1e2, 1e4):
        yield HardCase("graded", ratio, partial(graded, ratio), MODES, ratio == 1e4)
    for ratio in (1.0, 1e6):
        yield HardCase("two bodies", ratio, partial(two_bodies, ratio), MODES, ratio == 1e6)


def _element_types() -> Iterator[HardCase]:
    """Tetrahedra and 20-node bricks."""
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


def hard_cases() -> Iterator[HardCase]:
    """Every case, family by family."""
    for family in (_proportions, _cell_shapes, _materials, _scales, _element_types):
        yield from family()
