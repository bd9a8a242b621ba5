"""A displacement field over time: a mesh, growing times, and each node's displacement at them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from gpusim.arrays.array_types import Float
from gpusim.errors import InputError
from gpusim.mesh import Mesh
from gpusim.validation import require, unmasked

Step = Callable[[int], npt.NDArray[Any]]

_KEPT = 2  # steps in memory: those between which a time lies


@unmasked()
class Field:
    """Displacements of a mesh's nodes at growing times.

    Parameters
    ----------
    mesh : the undeformed body.
    times : (T,) growing numbers: time, load factor, whatever the file counts its steps by.
    displacement : (T, N, 3) in the mesh's unit of length, or a function that gives (N, 3) of a
        step's number; it is called when a step is needed, and the last two steps are kept.
    name : of the file, for messages.

    Where the first time is above 0 the body is taken to be undeformed at time 0: codes write the
    states that they have computed.

    Raises
    ------
    InputError
        Wrong shapes, times that don't grow, values that aren't finite (when a step is read).

    Examples
    --------
    >>> bar = gs.mesh.box(size=(1, 1, 1), divisions=(1, 1, 1))
    >>> field = gs.Field(bar, times=[0, 1], displacement=[0 * bar.points, 0.1 * bar.points])
    >>> print(f"{field.at(0.5).max():.3f}")
    0.050
    """

    def __init__(
        self,
        mesh: Mesh,
        times: npt.ArrayLike,
        displacement: npt.ArrayLike | Step,
        *,
        name: str = "field",
    ) -> None:
        self.mesh, self.name = mesh, name
        self.times: Float = np.atleast_1d(np.array(times, dtype=np.float64))
        known = self.times.ndim == 1 and len(self.times) > 0 and np.isfinite(self.times).all()
        require(known, f"{name}: times", self.times, "finite (T,)")
        wrong = np.flatnonzero(~(np.diff(self.times) > 0.0))
        if len(wrong):
            a, b = self.times[wrong[0]], self.times[wrong[0] + 1]
            raise InputError(f"{name}: times; got {b:g} after {a:g}; expected growing times")
        self.times.setflags(write=False)
        if callable(displacement):
            self._read: Step = displacement
        else:
            values = np.asarray(displacement, dtype=np.float64)
            if values.ndim == 2 and len(self.times) == 1:
                values = values[None]
            shape = (len(self.times), mesh.node_count, 3)
            expected = f"{shape}: times, nodes, components"
            fits = values.shape == shape
            require(fits, f"{name}: displacement", f"shape {values.shape}", expected)
            self._read = values.__getitem__
        self._kept: dict[int, Float] = {}

    def __repr__(self) -> str:
        span = f"times {self.times[0]:g} to {self.times[-1]:g}"
        return f"Field({self.mesh.node_count} nodes, {len(self.times)} steps, {span})"

    @property
    def start(self) -> float:
        """The earliest time: the first of ``times``, or 0 for a body that starts undeformed."""
        return min(0.0, float(self.times[0]))

    @property
    def end(self) -> float:
        """The latest time."""
        return float(self.times[-1])

    def step(self, number: int) -> Float:
        """(N, 3) float64 displacement of step ``number``, counted from 0 as ``times`` is."""
        last = len(self.times) - 1
        require(0 <= number <= last, f"{self.name}: step", number, f"0 to {last}")
        if number not in self._kept:
            u = np.array(self._read(number), dtype=np.float64)
            what, shape = f"{self.name}: displacement at time {self.times[number]:g}", u.shape
            expected = f"({self.mesh.node_count}, 3)"
            require(shape == (self.mesh.node_count, 3), what, f"shape {shape}", expected)
            bad = np.flatnonzero(~np.isfinite(u).all(axis=1))
            if len(bad):
                raise InputError(
                    f"{what}: {len(bad)} nodes without a finite value; got {u[bad[0]].tolist()} at "
                    f"node {bad[0]}; expected one at every node of the solids"
                )
            u.setflags(write=False)
            while len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = u
        return self._kept[number]

    def check(self, time: float) -> None:
        """Raises InputError for a time outside of ``start`` … ``end``."""
        expected = f"{self.start:g} to {self.end:g}, what its steps cover"
        require(self.start <= time <= self.end, f"{self.name}: time", f"{time:g}", expected)

    def at(self, time: float) -> Float:
        """(N, 3) float64 displacement at a time, linear between the steps around it.

        Raises InputError outside of ``start`` … ``end``: nothing is extrapolated.
        """
        self.check(time)
        after = int(np.searchsorted(self.times, time))
        late = self.times[after]
        if late == time:
            return self.step(after)
        if after == 0:  # from the undeformed state at time 0
            return np.asarray(self.step(0) * (time / late))
        early = self.times[after - 1]
        share = (time - early) / (late - early)
        before = self.step(after - 1)
        return np.asarray(before + share * (self.step(after) - before))
