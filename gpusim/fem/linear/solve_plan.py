"""Every choice of a solve, made once before work, each with its reason in words.

Which solver is cheaper is an estimate before anything is factorised: operations over rates measured
on two processor cores. It needn't be sharp, because where two of them come close either is good.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np

from gpusim.arrays.array_types import Bool, Float
from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.assembly.element_batches import only_group
from gpusim.fem.assembly.system import System
from gpusim.fem.direct_solvers.banded_cholesky import BandedFactor, band_ordering
from gpusim.fem.direct_solvers.substructuring import SubstructuredFactor, cut_slabs
from gpusim.fem.krylov.outer_iteration import UNEVEN_STIFFNESS
from gpusim.fem.lattice.lattice import Lattice
from gpusim.fem.model.model import Model
from gpusim.fem.sparse.block_rows import BlockRows
from gpusim.gpu import Device, default_device, software_adapter
from gpusim.parallel.machine import host_memory
from gpusim.validation import require

# operations per second
_CHAIN_RATE = 1.2e10
_BAND_RATE = 8.0e9
_PER_UNKNOWN = 3e-6
# share of the free memory that factors may take
_MEMORY = 0.4
# where multigrid has failed, a direct solver may take this long (s, estimated)
_LONGEST = 600.0
# a band this many times slower than multigrid isn't looked at any closer
_HOPELESS = 30.0
# share of the work in bands as wide as a lattice's planes that any band takes at least: that of a
# cube can be three quarters as wide
_NARROWER = 0.5
# share of its grid that a lattice's cells fill from which on its planes are as narrow as any cut:
# those of a frame lie along its members
_FILLED = 0.5
# unknowns beyond which it isn't worth looking for a band
_MOST_BANDED = 2_000_000
METHODS = ("auto", "direct", "multigrid")
# where stiffnesses differ greatly a direct solver may take this many times as long as multigrid
# would, or (s)
_UNEVEN_PATIENCE, _UNEVEN_SECONDS = 30.0, 30.0
# ratio of greatest and least modulus, 300 at nu = 0.495, from which on a material is stiff in bulk
_STIFF_IN_BULK = 300.0


@dataclass(frozen=True, eq=False)
class Direct:
    """A direct solver that could be used: estimated ``seconds``, bytes, what it is, the ``rows``
    of K, and a function that factorises these, or others of the same pattern."""

    seconds: float
    nbytes: int
    description: str
    rows: BlockRows
    build: Callable[[BlockRows], BandedFactor | SubstructuredFactor]

    @property
    def fits(self) -> bool:
        """Whether its factors fit the free memory."""
        return self.nbytes <= _MEMORY * host_memory()

    @property
    def in_reach(self) -> bool:
        """Whether it may be waited for where multigrid has failed."""
        return self.fits and self.seconds <= _LONGEST


def direct_solver(
    assembled: Assembled,
    free: Bool,
    points: Float,
    scale: float,
) -> Direct | None:
    """The cheaper of the direct solvers, or None where neither is to be thought of."""
    unknowns = int(free.sum())
    solvers = []
    lattice = assembled.lattice
    widest, planes = 0, 0.0
    if lattice is not None:
        group = only_group(assembled.groups)
        slabs = cut_slabs(group, lattice, free)
        if slabs is not None:
            sizes = [len(one) for one in slabs.planes]
            if _filled(lattice):
                widest, planes = max(sizes), sum(float(size) ** 3 for size in sizes)
            solvers.append(
                Direct(
                    slabs.operations / _CHAIN_RATE + _PER_UNKNOWN * unknowns,
                    slabs.nbytes,
                    f"congruent sections condensed, {sum(len(r.pairs) for r in slabs.rounds)} "
                    f"distinct of {len(slabs.kind) - 1} joins",
                    assembled.rows,
                    # one of congruent sections has no other values
                    lambda _: SubstructuredFactor(slabs, group, lattice, scale),
                )
            )
    # a bandwidth that isn't worth a closer look; that of a lattice is about its widest plane
    hopeless = np.sqrt(_HOPELESS * multigrid_seconds(unknowns) * _BAND_RATE / max(unknowns, 1))
    # no numbering of a lattice has a band much narrower than its planes
    beaten = bool(solvers) and solvers[0].seconds < _NARROWER * planes / _BAND_RATE
    if unknowns <= _MOST_BANDED and widest <= hopeless and not beaten:
        ordering = band_ordering(assembled.rows, free, points, float(hopeless))
        solvers.append(
            Direct(
                ordering.operations / _BAND_RATE + _PER_UNKNOWN * unknowns,
                ordering.nbytes,
                f"banded Cholesky, bandwidth {ordering.bandwidth}",
                assembled.rows,
                lambda rows: BandedFactor(rows, ordering, scale),
            )
        )
    return min(solvers, key=lambda one: one.seconds, default=None)


def least_seconds(assembled: Assembled, free: Bool) -> float:
    """Less than ``direct_solver`` estimates, found by counting the unknowns of a lattice's planes;
    0 where there is no lattice, or that of a frame. Bodies as thick as they are long needn't be
    looked at any closer.
    """
    lattice = assembled.lattice
    layers = 0 if lattice is None else max(lattice.cell.shape)
    if lattice is None or layers < 3 or not _filled(lattice):
        return 0.0
    place = lattice.place[:, int(np.argmax(lattice.cell.shape))]
    sizes = sum(np.bincount(place[free[:, axis]], minlength=layers + 1) for axis in range(3))
    inner = np.asarray(sizes)[1:-1]
    # one join a round at least, of planes that are no smaller, with one neighbour at least
    chain = np.ceil(np.log2(layers)) * 7.0 / 3.0 * float(inner.min()) ** 3 / _CHAIN_RATE
    band = _NARROWER * float((np.asarray(sizes, dtype=np.float64) ** 3).sum()) / _BAND_RATE
    return min(float(chain), band)


def _filled(lattice: Lattice) -> bool:
    return float((lattice.cell >= 0).mean()) >= _FILLED


def multigrid_seconds(unknowns: int) -> float:
    """What multigrid takes for a body of compact shape."""
    return 0.15 + 2e-5 * unknowns


@dataclass
class Clock:
    """Seconds since the last mark, per part."""

    timings: dict[str, float] = field(default_factory=dict)
    last: float = field(default_factory=time.perf_counter)

    def mark(self, name: str) -> None:
        now = time.perf_counter()
        self.timings[name] = self.timings.get(name, 0.0) + now - self.last
        self.last = now


@dataclass(frozen=True)
class Options:
    """How to solve, the ``formulation`` per cell type, and the clock that times the parts."""

    method: str
    device: Device | None
    backend: str
    tolerance: float
    most: int | None
    start: Float | None
    progress: Callable[[int, float], None] | None
    formulation: Mapping[str, str]
    clock: Clock


@dataclass(frozen=True, eq=False)
class SolvePlan:
    """``attempts`` are tried in turn until one converges: "none" (nothing to solve), "direct",
    "pressures" (conjugate gradients on displacements and pressures), "multigrid" (on displacements
    alone). Multigrid iterates ``on_device`` or on the host; its levels heed ``uneven_stiffness``
    and materials that are ``stiff_in_bulk``. ``direct`` looks for the cheaper direct solver, once.
    ``reasons`` say why, choice by choice."""

    attempts: tuple[str, ...]
    on_device: bool
    uneven_stiffness: bool
    stiff_in_bulk: bool
    direct: Callable[[], Direct | None]
    device: Device | None
    reasons: Mapping[str, str]

    def __str__(self) -> str:
        return "\n".join(f"{choice}: {reason}" for choice, reason in self.reasons.items())

    @property
    def lines(self) -> tuple[str, ...]:
        """The choices in words, one a line."""
        return tuple(str(self).split("\n"))

    def adapter(self) -> Device:
        """The device that was given, or the process-wide one."""
        return self.device if self.device is not None else default_device()


def plan_solve(model: Model, assembled: Assembled, system: System, options: Options) -> SolvePlan:
    """The plan of one static solve.

    Raises InputError for method "direct" and a body whose factors don't fit.
    """
    direct = cache(partial(direct_solver, assembled, system.free, model.mesh.points, system.scale))
    attempts: tuple[str, ...]
    uneven_stiffness, stiff, on_device = system.contrast > UNEVEN_STIFFNESS, False, False
    if not system.right.any():
        attempts, why = ("none",), "no load: the solution is what is prescribed"
    elif options.method == "direct":
        attempts, why = ("direct",), f"asked for; {_fitting(direct()).description}"
    elif options.method == "multigrid":
        attempts, why = ("multigrid",), "multigrid, asked for"
    else:
        attempts, why = _cheaper(assembled, system, direct)
    reasons = {"solver": why}
    if "multigrid" in attempts:
        on_device, reasons["iterations"] = _place(options)
        stiff = _stiff_in_bulk(model)
    if stiff and options.formulation == {"hex8": "bbar"} and not model.constraints:
        attempts = ("pressures", *attempts)
        reasons["material"] = "nearly incompressible: displacements and pressures together"
    elif stiff:
        reasons["material"] = (
            "nearly incompressible: displacements alone, as pressures go with mean-dilatation "
            "bricks ('bbar') without constraints"
        )
    if uneven_stiffness:
        reasons["stiffness"] = (
            f"differs by {system.contrast:.0e} from node to node: coarse levels in float64, gone "
            "through once"
        )
    lattice = assembled.lattice is not None
    reasons["numbering"] = "a lattice, whose rows repeat" if lattice else "general"
    return SolvePlan(attempts, on_device, uneven_stiffness, stiff, direct, options.device, reasons)


def _cheaper(
    assembled: Assembled, system: System, direct: Callable[[], Direct | None]
) -> tuple[tuple[str, ...], str]:
    """Attempts of method "auto", and why."""
    patience = multigrid_seconds(int(system.free.sum()))
    if system.contrast > UNEVEN_STIFFNESS:
        # multigrid takes many times as long there, and its error is harder to tell
        patience = max(_UNEVEN_PATIENCE * patience, _UNEVEN_SECONDS)
    least = least_seconds(assembled, system.free)
    if least > patience:
        return ("multigrid", "direct"), _slower(least / patience, "at least ")
    solver = direct()
    if solver is None:
        return ("multigrid", "direct"), "multigrid: no direct solver is to be thought of"
    if solver.seconds <= patience and solver.fits:
        share = solver.seconds / patience
        return ("direct",), f"direct: {share:.2g} of multigrid's time; {solver.description}"
    why = f"{_slower(solver.seconds / patience)} and {solver.nbytes / 1e9:.2g} GB"
    return ("multigrid", "direct"), why


def _slower(times: float, least: str = "") -> str:
    return f"multigrid: a direct solver takes {least}{times:.2g} times as long"


def _fitting(direct: Direct | None) -> Direct:
    need = "can't be ordered" if direct is None else f"need {direct.nbytes / 1e9:.1f} GB"
    expected = "one that fits the free memory, or method 'multigrid'"
    fits = direct is not None and direct.fits
    require(fits, "solve: method 'direct'", f"a body whose factors {need}", expected)
    assert direct is not None
    return direct


def _place(options: Options) -> tuple[bool, str]:
    """Whether multigrid iterates on a device, and why."""
    if options.backend == "gpu":
        return True, "on the device, asked for"
    if options.backend == "numpy":
        return False, "on the host, asked for"
    if options.device is not None:
        return True, "on the device that was given"
    if software_adapter():
        return False, "on the host: the adapter is the host's own processors, or there is none"
    return True, "on the device: the adapter is real hardware"


def _stiff_in_bulk(model: Model) -> bool:
    """Whether some material's bulk modulus outweighs its shear modulus beyond Jacobi smoothing."""
    moduli = [np.linalg.eigvalsh(material.stiffness()) for material in model.materials]
    return max(float(one.max() / one.min()) for one in moduli) > _STIFF_IN_BULK
