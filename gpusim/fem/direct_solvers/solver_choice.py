"""Which solver a problem gets: the cheapest one by an estimate made before anything is factorised.

The estimates are operations over rates measured on two processor cores; they needn't be sharp,
because where two of them come close either choice is good.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gpusim.fem.assembly.assembly import Assembled
from gpusim.fem.direct_solvers.banded_cholesky import BandedFactor, band_ordering
from gpusim.fem.direct_solvers.substructuring import SubstructuredFactor, cut_slabs
from gpusim.fem.lattice.lattice import Lattice
from gpusim.parallel.machine import host_memory

__all__ = ["Direct", "direct_solver", "least_seconds", "multigrid_seconds"]

# operations per second
_CHAIN_RATE = 1.2e10
_BAND_RATE = 8.0e9
_PER_UNKNOWN = 3e-6
# share of the free memory that factors may take
_MEMORY = 0.4
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


@dataclass(frozen=True, eq=False)
class Direct:
    """A direct solver that could be used: estimated ``seconds``, bytes, what it is, and a function
    that builds it."""

    seconds: float
    nbytes: int
    description: str
    build: Callable[[], BandedFactor | SubstructuredFactor]

    @property
    def fits(self) -> bool:
        """Whether its factors fit the free memory."""
        return self.nbytes <= _MEMORY * host_memory()


def direct_solver(
    assembled: Assembled,
    free: npt.NDArray[np.bool_],
    points: npt.NDArray[np.float64],
    scale: float,
) -> Direct | None:
    """The cheaper of the direct solvers, or None where neither is to be thought of."""
    unknowns = int(free.sum())
    found = []
    lattice = assembled.lattice
    widest, planes = 0, 0.0
    if lattice is not None:
        group = assembled.lattice_group
        slabs = cut_slabs(group, lattice, free)
        if slabs is not None:
            sizes = [len(one) for one in slabs.planes]
            if _filled(lattice):
                widest, planes = max(sizes), sum(float(size) ** 3 for size in sizes)
            found.append(
                Direct(
                    slabs.operations / _CHAIN_RATE + _PER_UNKNOWN * unknowns,
                    slabs.nbytes,
                    f"congruent sections condensed, {sum(len(r.pairs) for r in slabs.rounds)} "
                    f"distinct of {len(slabs.kind) - 1} joins",
                    lambda: SubstructuredFactor(slabs, group, lattice, scale),
                )
            )
    # a bandwidth that isn't worth a closer look; that of a lattice is about its widest plane
    hopeless = np.sqrt(_HOPELESS * multigrid_seconds(unknowns) * _BAND_RATE / max(unknowns, 1))
    # no numbering of a lattice has a band much narrower than its planes
    beaten = bool(found) and found[0].seconds < _NARROWER * planes / _BAND_RATE
    if unknowns <= _MOST_BANDED and widest <= hopeless and not beaten:
        ordering = band_ordering(assembled.rows, free, points, float(hopeless))
        found.append(
            Direct(
                ordering.operations / _BAND_RATE + _PER_UNKNOWN * unknowns,
                ordering.nbytes,
                f"banded Cholesky, bandwidth {ordering.bandwidth}",
                lambda: BandedFactor(assembled.rows, ordering, scale),
            )
        )
    return min(found, key=lambda one: one.seconds, default=None)


def least_seconds(assembled: Assembled, free: npt.NDArray[np.bool_]) -> float:
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
