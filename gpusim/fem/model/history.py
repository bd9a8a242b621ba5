"""A history: motion over time, in memory, in a file, or as amplitudes of modes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.fem.model.computation import Computation
from gpusim.files.atomic_files import atomic_path
from gpusim.files.hdf5_file import writing_hdf5
from gpusim.parallel.machine import host_memory
from gpusim.validation import require

if TYPE_CHECKING:
    from gpusim.fem.dynamics.modal_superposition import ModalMotion

# of the free memory, that arrays of a history may take
_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Superposition:
    """(T,N,3): ``amplitudes`` (T,n) times ``shapes`` (n,N,3), formed where it is looked at."""

    amplitudes: Float
    shapes: Float

    @property
    def shape(self) -> tuple[int, ...]:
        """(T,N,3)."""
        return (len(self.amplitudes), *self.shapes.shape[1:])

    def __len__(self) -> int:
        return len(self.amplitudes)

    def __getitem__(self, key: Any) -> Float:
        key = key if isinstance(key, tuple) else (key,)
        for k in [number for number, one in enumerate(key) if one is Ellipsis]:
            key = (*key[:k], *[slice(None)] * (4 - len(key)), *key[k + 1 :])
        when, *where = key
        lists = bool(np.ndim(when)) and any(np.ndim(one) for one in where)
        got, expected = "lists of instants and of nodes", "one of them: the others as slices"
        require(not lists, "history: index", got, expected)
        shapes = self.shapes[(slice(None), *where)]
        return np.asarray(np.tensordot(self.amplitudes[when], shapes, axes=1))

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> Float:
        return np.asarray(self[:], dtype)


# the fields of `EnergyHistory`
ENERGIES = ("kinetic", "strain", "external_work", "dissipated")
FilePath = str | os.PathLike[str] | None
# one of these, or a data set of a file
Series = Any


@dataclass(frozen=True, eq=False)
class EnergyHistory:
    """``kinetic`` and ``strain`` energy, ``external_work`` that loads have done since the beginning
    and what damping (and plastic flow) has ``dissipated``, (T,) each, in the model's units.

    Where the ground moves, all are those of the motion relative to it, and its inertial forces are
    loads.

    Examples
    --------
    >>> energy = gs.fem.EnergyHistory(*np.array([[0.0, 0.5], [1.0, 0.4], [0.0, 0.0], [0.0, 0.1]]))
    >>> energy.drift
    0.0
    """

    kinetic: Float
    strain: Float
    external_work: Float
    dissipated: Float

    @property
    def imbalance(self) -> Float:
        """(T,) kinetic + strain + dissipated - external work, less what it began with: the error of
        the steps, and what HHT and generalized-alpha take out of motions that these don't
        resolve."""
        whole = self.kinetic + self.strain + self.dissipated - self.external_work
        return np.asarray(whole - whole[0])

    @property
    def drift(self) -> float:
        """The greatest ``imbalance`` over the greatest energy."""
        size = float((self.kinetic + self.strain).max())
        return float(np.abs(self.imbalance).max()) / (size if size > 0.0 else 1.0)


@dataclass(frozen=True, eq=False, repr=False)
class History(Computation):
    """A motion over time; units are the model's.

    times : (T,) instants.
    u, v, a : (T,N,3) displacement, velocity and acceleration, relative to the ground where that
        moves; arrays, data sets of ``file``, or, of modal superposition, formed from the modes
        where they are looked at (``history.u[k]``, ``history.u[:, node]``; `numpy.asarray` forms
        all).
    energy : see `gpusim.fem.EnergyHistory`.
    modal : of modal superposition: the motion at any instant, exactly
        (`gpusim.fem.dynamics.modal_superposition.ModalMotion`); None of steps.
    method : "modal", "newmark", "hht" or "generalized-alpha". message, warnings, unknowns, timings,
        model : as all results have them.

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 0.1, 0.1), divisions=(4, 1, 1))
    >>> fixed = np.isclose(bar.points[:, :1], 0.0).repeat(3, axis=1)
    >>> pull = gs.fem.traction(bar, gs.mesh.select_faces(bar, name="x_max"), (2e6, 0, 0))
    >>> model = gs.Model(bar, gs.Isotropic(200e9, 0.0, density=7800.0), fixed, pull)
    >>> history = gs.transient(model, times=np.linspace(0, 2e-3, 11), method="newmark", step=2e-6)
    >>> history.u.shape, bool(history.energy.drift < 1e-6)
    ((11, 20, 3), True)
    >>> u, v = history.at(1.234e-3)
    >>> u.shape
    (20, 3)
    """

    times: Float
    u: Series
    v: Series
    a: Series
    energy: EnergyHistory
    modal: ModalMotion | None = None

    def at(self, time: float) -> tuple[Float, Float]:
        """Displacement and velocity (N,3) at any instant from the first to the last: exact of modal
        superposition, else by cubics between ``times``.

        Raises InputError for an instant outside.
        """
        first, last = float(self.times[0]), float(self.times[-1])
        inside = first <= time <= last
        require(inside, "History.at: time", time, f"{first:.6g} to {last:.6g}")
        if self.modal is not None:
            return self.modal.at(time)
        k = min(int(np.searchsorted(self.times, time, side="right")) - 1, len(self.times) - 2)
        step, both = self.times[k + 1] - self.times[k], slice(k, k + 2)
        share, v = (time - self.times[k]) / step, self.v[both]
        return cubic(share, self.u[both], step * v), cubic(share, v, step * self.a[both])


def cubic(share: float, ends: Float, slopes: Float) -> Float:
    """Between two ``ends`` (2,...), from one slope to the other, per interval."""
    rise = share**2 * (3.0 - 2.0 * share) * (ends[1] - ends[0])
    bend = share * (1.0 - share) * ((1.0 - share) * slopes[0] - share * slopes[1])
    return np.asarray(ends[0] + rise + bend)


@dataclass(frozen=True, eq=False)
class State:
    """Displacement, velocity and acceleration at an instant, and ``gains`` (2,): what loads have
    done until then, and what is dissipated."""

    time: float
    u: Float
    v: Float
    a: Float
    gains: Float


def interpolated(before: State, after: State, share: float) -> tuple[Float, Float, Float]:
    """u, v and a between two states: cubics of displacement and velocity by their slopes."""
    step = after.time - before.time
    u, v, a = (np.stack([getattr(one, name) for one in (before, after)]) for name in "uva")
    return cubic(share, u, step * v), cubic(share, v, step * a), a[0] + share * (a[1] - a[0])


@contextmanager
def storage(times: Float, nodes: int, file: FilePath) -> Iterator[dict[str, Any]]:
    """Arrays to write u, v, a (T,N,3) and energies (T,) to, by name: in memory, or in an HDF5 file
    that is whole or absent afterwards.

    Raises InputError, before anything is allocated, where memory doesn't hold them.
    """
    shapes = dict.fromkeys("uva", (len(times), nodes, 3)) | dict.fromkeys(ENERGIES, times.shape)
    if file is None:
        needed, free = 72 * len(times) * nodes, host_memory()
        got = f"{needed / 1e9:.3g} GB of histories, {free / 1e9:.3g} GB of free memory"
        expected = "at most half of it: fewer times (frames), or of gs.transient also file=..."
        require(needed <= _SHARE * free, "transient", got, expected)
        yield {name: np.empty(shape) for name, shape in shapes.items()}
        return
    with atomic_path(file) as part, writing_hdf5(part) as store:
        store["times"] = times
        yield {name: store.create_dataset(name, at, np.float64) for name, at in shapes.items()}


def written(fields: dict[str, Any], file: FilePath) -> dict[str, Any]:
    """Fields of a `History` from those of `storage`, once they are written."""
    if file is not None:
        import h5py

        fields = h5py.File(file, "r")
    energy = EnergyHistory(*(np.asarray(fields[name]) for name in ENERGIES))
    return {name: fields[name] for name in "uva"} | {"energy": energy}
